//! Room on a device for what a scene is going to be, before anything changes.

use splitplane_core::backend::BuildOptions;
use splitplane_core::backend::scene::Becoming;
use splitplane_core::backend::scene::packed::{PackedSizes, Unpackable};
use splitplane_core::scene::SceneBuildError;
use splitplane_core::watch::Watch;

use super::failed::failed;
use super::gone::Gone;
use super::held::HeldScene;
use super::reserved::{Buffers, OF_INSTANCES, Reserved, Room, Sending};
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
    /// Reserves room. `held` is what the device holds of the old scene, which stays as it is: what replaces a buffer of it is there beside it, and both
    /// count towards the limit. So does what is `gone`, as long as the device has it.
    ///
    /// # Errors
    /// No memory on the device, or a device that fails; a watch that cancels the update.
    pub(super) fn reserve(
        gpu: &Gpu,
        held: Option<&HeldScene>,
        becoming: &Becoming<'_>,
        gone: &mut Gone,
        options: &BuildOptions<'_>,
    ) -> Result<Reserved, SceneBuildError> {
        if let Some(reason) = becoming.host_only {
            return Ok(Reserved::Refused(reason.into()));
        }
        let stays = match held {
            Some(held) => Stays::of(held, becoming, options.watch)?,
            None => None,
        };
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
        let plan = |way: Way| {
            let needed = match (way, &stays) {
                (Way::StaySpare | Way::Stay, Some(stays)) => stays.bytes,
                _ => all,
            };
            let bytes = bytes_by(gpu, way, there, needed);
            (kept(there.filter(|_| way != Way::AllExact), &bytes), bytes)
        };
        let refusal = |way: Way, gone: u64| {
            let (kept, bytes) = plan(way);
            let besides = (becoming.held + gone).saturating_add(replaced(there, &kept));
            exceeded(gpu, &bytes, besides, options.max_memory)
        };
        gone.decide(gpu, |gone| ways.iter().position(|&way| refusal(way, gone).is_none()))
            .map_err(failed)?;
        let mut outcome = Ok(String::new());
        for &way in ways {
            if let Some(reason) = refusal(way, gone.bytes()) {
                outcome = outcome.map(|_| reason);
                continue;
            }
            let (kept, bytes) = plan(way);
            match made(gpu, kept, &bytes) {
                Ok(buffers) => {
                    let sending = match (way, stays) {
                        (Way::StaySpare | Way::Stay, Some(stays)) => stays.sending,
                        _ => Sending::All,
                    };
                    return Ok(Reserved::Room(Room { buffers, sending }));
                }
                Err(error) => outcome = Err(error),
            }
        }
        match outcome {
            // Without the old buffers beside them they may fit, unless it is the device that does not bind them.
            Ok(_) if held.is_some() && exceeded(gpu, &all, 0, None).is_none() => {
                Ok(Reserved::Afterwards)
            }
            Ok(reason) => Ok(Reserved::Refused(reason)),
            Err(error) => Err(failed(error)),
        }
    }

    /// With new buffers in place of those that are too small for the scene as it came to be: a worn tree over instances that was built anew may have more nodes.
    /// The scene is updated and takes what it takes, beside `old`: where the limit has no place for it beside what was reserved, room to spare is given up, and then all
    /// is sent to buffers of no more than is needed.
    pub(super) fn grown(
        self,
        gpu: &Gpu,
        old: Option<&HeldScene>,
        sizes: &PackedSizes,
        held: u64,
        gone: &mut Gone,
        max_memory: Option<u64>,
    ) -> Reserved {
        let Room { buffers, mut sending } = self;
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
        let there = old.map(|old| &old.buffers);
        let fits = |bytes: &[u64; 6], gone: u64| {
            let replaced = replaced(there, &kept(Some(&buffers), bytes));
            exceeded(gpu, bytes, (held + gone).saturating_add(replaced), max_memory).is_none()
        };
        let all_ways = [reserved, staying, all];
        let found = |gone| all_ways.into_iter().find(|bytes| fits(bytes, gone));
        let found = match gone.decide(gpu, found) {
            Ok(found) => found,
            Err(error) => return Reserved::Refused(error.to_string()),
        };
        let Some(bytes) = found else {
            let held = held + gone.bytes();
            return match (old, exceeded(gpu, &all, held, max_memory)) {
                (None, Some(reason)) => Reserved::Refused(reason),
                _ => Reserved::Afterwards,
            };
        };
        if bytes != reserved && bytes != staying {
            sending = Sending::All;
        }
        let kept = kept(Some(&buffers), &bytes);
        // Those that are too small go before others are made.
        drop(buffers);
        match made(gpu, kept, &bytes) {
            Ok(buffers) => Reserved::Room(Room { buffers, sending }),
            Err(error) => Reserved::Refused(error.to_string()),
        }
    }

    /// Room for all of a scene that is in place on the host, of which the device holds nothing.
    ///
    /// # Errors
    /// Why the scene cannot be on the device.
    pub(super) fn alone(
        gpu: &Gpu,
        sizes: &PackedSizes,
        held: u64,
        max_memory: Option<u64>,
    ) -> Result<Room, String> {
        let bytes = sizes.bytes();
        match exceeded(gpu, &bytes, held, max_memory) {
            Some(reason) => Err(reason),
            None => made(gpu, Default::default(), &bytes)
                .map(|buffers| Room { buffers, sending: Sending::All })
                .map_err(|error| error.to_string()),
        }
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
    ///
    /// # Errors
    /// A watch that cancels the search.
    fn of(
        held: &HeldScene,
        becoming: &Becoming<'_>,
        watch: Option<&dyn Watch>,
    ) -> Result<Option<Stays>, SceneBuildError> {
        let Becoming { changes, sizes, .. } = becoming;
        let places = match held.places.after_watched(changes, watch) {
            Ok(places) => places,
            Err(Unpackable::Cancelled { progress }) => {
                return Err(SceneBuildError::Cancelled { progress });
            }
            Err(_) => return Ok(None),
        };
        let mut geometries = Vec::new();
        if geometries.try_reserve_exact(changes.len()).is_err() {
            return Ok(None);
        }
        let new = changes.iter().filter(|change| change.sizes.is_some());
        geometries.extend(new.map(|change| change.geometry));
        let PackedSizes { top_nodes, instances, .. } = *sizes;
        let bytes = PackedSizes { top_nodes, instances, ..places.ends() }.bytes();
        let there = held.buffers[OF_INSTANCES..].iter().map(wgpu::Buffer::size);
        let room: u64 = there.zip(&bytes[OF_INSTANCES..]).map(|(own, &end)| own.max(end)).sum();
        let used: u64 = places.used().bytes().iter().sum();
        let wastes = !changes.is_empty() && used < room / 2 && room > LEAST_WASTE;
        let places = Box::new(places);
        let sending = Sending::Changed { places, geometries };
        Ok(Some(Stays { sending, bytes, wastes }))
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

/// Of the buffers that are there those that have these sizes.
fn kept(there: Option<&Buffers>, bytes: &[u64; 6]) -> [Option<wgpu::Buffer>; 6] {
    std::array::from_fn(|place| {
        let own = &there?[place];
        (own.size() == bytes[place].max(LEAST_BUFFER)).then(|| own.clone())
    })
}

/// Bytes of the buffers that are there and are none of those that are kept: they are held until the update has taken their contents.
fn replaced(there: Option<&Buffers>, kept: &[Option<wgpu::Buffer>; 6]) -> u64 {
    let pairs = there.into_iter().flatten().zip(kept);
    pairs.filter(|(own, kept)| kept.as_ref() != Some(*own)).map(|(own, _)| own.size()).sum()
}

/// Buffers of these sizes: those that are kept, and new ones.
fn made(gpu: &Gpu, kept: [Option<wgpu::Buffer>; 6], bytes: &[u64; 6]) -> Result<Buffers, GpuError> {
    checked(gpu, "a scene", || {
        let mut made: Vec<wgpu::Buffer> = Vec::with_capacity(NAMES.len());
        for ((kept, what), &bytes) in kept.into_iter().zip(NAMES).zip(bytes) {
            made.push(match kept {
                Some(buffer) => buffer,
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
    let of_buffers = bytes.iter().map(|&bytes| bytes.max(LEAST_BUFFER));
    let needed = of_buffers.fold(held, u64::saturating_add);
    let limit = max_memory.filter(|limit| needed > *limit)?;
    Some(format!("with the scene on the device it takes {needed} bytes, and {limit} are allowed"))
}
