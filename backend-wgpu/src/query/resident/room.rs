//! Room on a device for what a scene is going to be, before anything changes.

use splitplane_core::backend::scene::Becoming;
use splitplane_core::backend::scene::packed::PackedSizes;

use super::held::HeldScene;
use super::reserved::{Buffers, OF_INSTANCES, Room, Sending};
use crate::device::gpu::{Gpu, LEAST_BUFFER};
use crate::device::halves::binding_limit;
use crate::device::scope::checked;
use crate::error::GpuError;

/// What each buffer is, for messages.
const NAMES: [&str; 6] = [
    "the tree over instances",
    "the instances",
    "the nodes of all geometries",
    "the references of all geometries",
    "the triangles of all geometries",
    "the shapes of all geometries",
];
/// What the buffers are used for: they are copied when they grow.
const USAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE
    .union(wgpu::BufferUsages::COPY_DST)
    .union(wgpu::BufferUsages::COPY_SRC);

/// How a scene may get its room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    /// Geometries that do not change stay where they are. Buffers that are too small get a quarter more than they need, since those that grow once may grow again.
    StaySpare,
    /// The same without more than is needed.
    Stay,
    /// All are sent, to the buffers that are there where they suffice.
    All,
    /// All are sent, to buffers of no more than is needed.
    AllExact,
}

impl Room {
    /// Reserves room, or says why the scene will not be on the device. `held` is what the device holds of the old scene, which stays as it is.
    ///
    /// # Errors
    /// No memory on the device, or a device that fails.
    pub(super) fn reserve(
        gpu: &Gpu,
        held: Option<&HeldScene>,
        becoming: &Becoming<'_>,
        max_memory: Option<u64>,
    ) -> Result<Result<Room, String>, GpuError> {
        if let Some(reason) = becoming.host_only {
            return Ok(Err(reason.into()));
        }
        let stays = held.and_then(|held| Stays::of(held, becoming));
        let all = becoming.sizes.bytes();
        // What comes to a scene of nothing is its first content, not growth.
        let is_first = |held: &HeldScene| {
            held.places.used() == PackedSizes::default() && !becoming.changes.is_empty()
        };
        let ways: &[Way] = match (&held, &stays) {
            (None, _) => &[Way::AllExact],
            (Some(held), _) if is_first(held) => &[Way::AllExact],
            (_, None) => &[Way::All, Way::AllExact],
            (_, Some(stays)) if stays.wastes => {
                &[Way::AllExact, Way::StaySpare, Way::Stay, Way::All]
            }
            _ => &[Way::StaySpare, Way::Stay, Way::All, Way::AllExact],
        };
        let there = held.map(|held| &held.buffers);
        let mut outcome = Ok(String::new());
        for &way in ways {
            let needed = match (way, &stays) {
                (Way::StaySpare | Way::Stay, Some(stays)) => stays.bytes,
                _ => all,
            };
            let bytes = bytes_by(gpu, way, there, needed);
            if let Some(reason) = exceeded(gpu, &bytes, becoming.held, max_memory) {
                outcome = outcome.map(|_| reason);
                continue;
            }
            let kept = there.filter(|_| way != Way::AllExact);
            match made(gpu, kept, &bytes) {
                Ok(buffers) => {
                    let sending = match (way, stays) {
                        (Way::StaySpare | Way::Stay, Some(stays)) => stays.sending,
                        _ => Sending::All,
                    };
                    return Ok(Ok(Room { buffers, sending }));
                }
                Err(error) => outcome = Err(error),
            }
        }
        outcome.map(Err)
    }

    /// With new buffers in place of those that are too small for the scene as it came to be: a worn tree over instances that was built anew may have more nodes.
    /// The scene is updated and takes what it takes: where the limit has no place for it beside what was reserved, room to spare is given up, and then all
    /// is sent to buffers of no more than is needed.
    ///
    /// # Errors
    /// Why the scene cannot be on the device.
    pub(super) fn grown(
        self,
        gpu: &Gpu,
        sizes: &PackedSizes,
        held: u64,
        max_memory: Option<u64>,
    ) -> Result<Room, String> {
        let Room { mut buffers, mut sending } = self;
        let mut reserved = buffers.each_ref().map(wgpu::Buffer::size);
        for (own, needed) in reserved.iter_mut().zip(sizes.bytes()).take(OF_INSTANCES) {
            *own = needed.max(*own);
        }
        let all = sizes.bytes();
        let staying = match &sending {
            Sending::All => all,
            Sending::Changed { places, .. } => {
                let PackedSizes { top_nodes, instances, .. } = *sizes;
                PackedSizes { top_nodes, instances, ..places.ends() }.bytes()
            }
        };
        let mut outcome = Err(String::new());
        for bytes in [reserved, staying, all] {
            outcome = exceeded(gpu, &bytes, held, max_memory).map_or(Ok(bytes), Err);
            if outcome.is_ok() {
                break;
            }
        }
        let bytes = outcome?;
        if bytes != reserved && bytes != staying {
            sending = Sending::All;
        }
        buffers = made(gpu, Some(&buffers), &bytes).map_err(|error| error.to_string())?;
        Ok(Room { buffers, sending })
    }
}

/// A scene whose geometries stay where they are, but for those that change.
struct Stays {
    sending: Sending,
    /// What each buffer must have at least.
    bytes: [u64; 6],
    /// Whether more than half of the room would be free.
    wastes: bool,
}

impl Stays {
    /// None where no place is found: the host has no memory, or what is free lies in too small pieces.
    fn of(held: &HeldScene, becoming: &Becoming<'_>) -> Option<Stays> {
        let Becoming { changes, sizes, .. } = becoming;
        let places = held.places.after(changes).ok()?;
        let mut geometries = Vec::new();
        geometries.try_reserve_exact(changes.len()).ok()?;
        let new = changes.iter().filter(|change| change.sizes.is_some());
        geometries.extend(new.map(|change| change.geometry));
        let PackedSizes { top_nodes, instances, .. } = *sizes;
        let bytes = PackedSizes { top_nodes, instances, ..places.ends() }.bytes();
        let there = held.buffers[OF_INSTANCES..].iter().map(wgpu::Buffer::size);
        let room: u64 = there.zip(&bytes[OF_INSTANCES..]).map(|(own, &end)| own.max(end)).sum();
        let used: u64 = places.used().bytes().iter().sum();
        let wastes = !changes.is_empty() && used < room / 2 && room > LEAST_WASTE;
        let places = Box::new(places);
        Some(Stays { sending: Sending::Changed { places, geometries }, bytes, wastes })
    }
}

/// Room of geometries that is not worth a look.
const LEAST_WASTE: u64 = 1 << 12;

/// Bytes of the buffers.
fn bytes_by(gpu: &Gpu, way: Way, there: Option<&Buffers>, needed: [u64; 6]) -> [u64; 6] {
    let (most, _) = binding_limit(gpu.limits());
    std::array::from_fn(|place| {
        let needed = needed[place];
        let own = there.map_or(0, |there| there[place].size());
        match way {
            Way::AllExact => needed,
            // Least buffers hold nothing, or next to it.
            _ if own == LEAST_BUFFER && needed <= own => needed,
            _ if own >= needed => own,
            Way::StaySpare => (needed + needed / 16 * 4).min(most.max(needed)),
            Way::Stay | Way::All => needed,
        }
    })
}

/// Buffers of these sizes: those that are there where they have them, else new ones.
fn made(gpu: &Gpu, there: Option<&Buffers>, bytes: &[u64; 6]) -> Result<Buffers, GpuError> {
    checked(gpu, "a scene", || {
        let mut made: Vec<wgpu::Buffer> = Vec::with_capacity(NAMES.len());
        for (place, (what, &bytes)) in NAMES.iter().zip(bytes).enumerate() {
            let kept = there
                .map(|there| &there[place])
                .filter(|own| own.size() == bytes.max(LEAST_BUFFER));
            made.push(match kept {
                Some(buffer) => buffer.clone(),
                None => gpu.buffer(what, bytes, USAGE)?,
            });
        }
        made.try_into().map_err(|_| GpuError::Refused("buffers of a scene".into()))
    })
}

/// Why a scene of these buffers is not going to be on the device. `held` are the bytes that are held besides.
fn exceeded(gpu: &Gpu, bytes: &[u64; 6], held: u64, max_memory: Option<u64>) -> Option<String> {
    let (allowed, limit) = binding_limit(gpu.limits());
    let too_long = NAMES.iter().zip(bytes).find(|(_, needed)| **needed > allowed);
    if let Some((what, &needed)) = too_long {
        let limit = GpuError::Limit { what: (*what).into(), limit, needed, allowed };
        return Some(limit.to_string());
    }
    let needed = bytes.iter().fold(held, |sum, bytes| sum.saturating_add(*bytes));
    let limit = max_memory.filter(|limit| needed > *limit)?;
    Some(format!("with the scene on the device it takes {needed} bytes, and {limit} are allowed"))
}
