//! What a device holds of a scene, and how that is brought up to date.

use bytemuck::Pod;
use splitplane_core::backend::scene::BuiltScene;
use splitplane_core::backend::scene::packed::{
    PackedInstance, PackedScene, PackedSizes, PackedTopNode, Unpackable,
};

use crate::device::gpu::Gpu;
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
/// Buffers that do not depend on geometries alone come first: these are as many.
const OF_INSTANCES: usize = 2;
/// What the buffers are used for.
const USAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST);
/// Records that did not change, between two that did, are sent with them rather than in two pieces.
const GAP: usize = 4;

/// The buffers of a scene: nodes of the tree over instances, instances, nodes, references, corners, shapes.
pub(super) type Buffers = [wgpu::Buffer; 6];

/// A scene in the memory of a device.
#[derive(Debug)]
pub(super) struct HeldScene {
    pub(super) buffers: Buffers,
    /// What the first two hold, to see what changes.
    box_nodes: Vec<PackedTopNode>,
    instances: Vec<PackedInstance>,
    /// Words of a ray's way.
    pub(super) way: u32,
    /// Whether a geometry has an opacity mask.
    pub(super) masked: bool,
    /// Whether a geometry is a set of shapes.
    pub(super) has_shapes: bool,
}

/// The limit that a scene of this size exceeds, if it does.
pub(super) fn exceeded(gpu: &Gpu, sizes: &PackedSizes) -> Option<GpuError> {
    let (allowed, limit) = binding_limit(gpu.limits());
    let too_long = NAMES.iter().zip(sizes.bytes()).find(|(_, needed)| *needed > allowed);
    too_long.map(|(what, needed)| GpuError::Limit { what: (*what).into(), limit, needed, allowed })
}

/// Buffers for a scene of this size: those that are there and serve, and new ones. Nothing is written.
///
/// # Errors
/// No memory on the device, or a device that fails.
pub(super) fn reserve(
    gpu: &Gpu,
    old: Option<&HeldScene>,
    sizes: &PackedSizes,
    geometries_change: bool,
) -> Result<Buffers, GpuError> {
    checked(gpu, "a scene", || {
        let mut made: Vec<wgpu::Buffer> = Vec::with_capacity(NAMES.len());
        for (place, (what, bytes)) in NAMES.iter().zip(sizes.bytes()).enumerate() {
            let same = place >= OF_INSTANCES && !geometries_change;
            let serves = |buffer: &&wgpu::Buffer| same || buffer.size() >= bytes;
            let kept = old.map(|old| &old.buffers[place]).filter(serves);
            made.push(match kept {
                Some(buffer) => buffer.clone(),
                None => gpu.buffer(what, bytes, USAGE)?,
            });
        }
        made.try_into().map_err(|_| GpuError::Refused("buffers of a scene".into()))
    })
}

/// Reserved buffers, with new ones in place of those that are too small for a scene of this size.
///
/// # Errors
/// As for [`reserve`].
pub(super) fn grown(
    gpu: &Gpu,
    mut buffers: Buffers,
    sizes: &PackedSizes,
) -> Result<Buffers, GpuError> {
    checked(gpu, "a scene", || {
        for ((buffer, what), bytes) in buffers.iter_mut().zip(NAMES).zip(sizes.bytes()) {
            if buffer.size() < bytes {
                *buffer = gpu.buffer(what, bytes, USAGE)?;
            }
        }
        Ok(buffers)
    })
}

/// Bytes that were sent.
type Sent = u64;

impl HeldScene {
    /// Sends all of a scene to buffers that are reserved for it.
    ///
    /// # Errors
    /// No memory, or a device that fails.
    pub(super) fn fill(
        gpu: &Gpu,
        buffers: Buffers,
        scene: &BuiltScene,
    ) -> Result<(HeldScene, Sent), GpuError> {
        let packed = scene.packed().map_err(unpackable)?;
        let PackedScene { box_nodes, instances, nodes, references, triangles, shapes } = packed;
        let parts: [&[u8]; 6] = [
            bytemuck::cast_slice(&box_nodes),
            bytemuck::cast_slice(&instances),
            bytemuck::cast_slice(&nodes),
            bytemuck::cast_slice(&references),
            bytemuck::cast_slice(&triangles),
            bytemuck::cast_slice(&shapes),
        ];
        checked(gpu, "the upload of a scene", || {
            buffers.iter().zip(parts).for_each(|(buffer, bytes)| gpu.write(buffer, 0, bytes));
            Ok(())
        })?;
        let sent = parts.iter().map(|bytes| bytes.len() as u64).sum();
        let (way, masked, has_shapes) = (way(scene), scene.has_opacity(), scene.has_shapes());
        Ok((HeldScene { buffers, box_nodes, instances, way, masked, has_shapes }, sent))
    }

    /// Sends what changed of instances, and of the tree over them. The geometries are those that were sent.
    ///
    /// # Errors
    /// No memory, or a device that fails: what it holds may then be neither the old scene nor the new one.
    pub(super) fn refresh(
        &mut self,
        gpu: &Gpu,
        buffers: Buffers,
        scene: &BuiltScene,
    ) -> Result<Sent, GpuError> {
        let mut packed = PackedScene::default();
        scene.pack_instances(&mut packed).map_err(unpackable)?;
        let moved = [0, 1].map(|place| buffers[place] != self.buffers[place]);
        if moved[0] {
            self.box_nodes.clear();
        }
        if moved[1] {
            self.instances.clear();
        }
        let sent = checked(gpu, "what changed of a scene", || {
            Ok(send_changes(gpu, &buffers[0], &self.box_nodes, &packed.box_nodes)
                + send_changes(gpu, &buffers[1], &self.instances, &packed.instances))
        })?;
        *self = HeldScene {
            buffers,
            box_nodes: packed.box_nodes,
            instances: packed.instances,
            way: way(scene),
            masked: scene.has_opacity(),
            has_shapes: scene.has_shapes(),
        };
        Ok(sent)
    }

    /// Bytes on the device.
    pub(super) fn bytes(&self) -> u64 {
        self.buffers.iter().map(wgpu::Buffer::size).sum()
    }

    /// Nodes of the tree over instances.
    pub(super) fn top_nodes(&self) -> usize {
        self.box_nodes.len()
    }

    /// Names of instances.
    pub(super) fn names(&self) -> usize {
        self.instances.len()
    }
}

/// Words of a ray's way: what it has entered, its number of entries, and of these one a level and one more.
fn way(scene: &BuiltScene) -> u32 {
    match scene.top_tree().nodes() {
        [] => 0,
        _ => scene.top_tree().depth() as u32 + 3,
    }
}

/// Sends the records that are not those of before. Returns the bytes.
fn send_changes<T: Pod + PartialEq>(gpu: &Gpu, to: &wgpu::Buffer, was: &[T], is: &[T]) -> Sent {
    // By bits: zeros of either sign are equal, but not the same.
    let changed = |at: usize| {
        was.get(at).is_none_or(|was| bytemuck::bytes_of(was) != bytemuck::bytes_of(&is[at]))
    };
    let (mut at, mut sent) = (0, 0);
    while at < is.len() {
        if !changed(at) {
            at += 1;
            continue;
        }
        let (start, mut end, mut next) = (at, at + 1, at + 1);
        while next < is.len() && next - end < GAP {
            if changed(next) {
                end = next + 1;
            }
            next += 1;
        }
        let piece: &[u8] = bytemuck::cast_slice(&is[start..end]);
        gpu.write(to, (start * size_of::<T>()) as u64, piece);
        sent += piece.len() as u64;
        at = end;
    }
    sent
}

fn unpackable(error: Unpackable) -> GpuError {
    match error {
        Unpackable::TooMany { what, count, most } => GpuError::Limit {
            what: what.into(),
            limit: "what a packed scene can name",
            needed: count,
            allowed: most,
        },
        Unpackable::Memory { needed } => {
            GpuError::HostMemory { what: "a packed scene".into(), needed }
        }
        _ => GpuError::Refused(format!("{error:?}")),
    }
}
