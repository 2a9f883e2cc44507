//! What a device holds of a scene, and how that is brought up to date.

use bytemuck::Pod;
use splitplane_core::backend::scene::BuiltScene;
use splitplane_core::backend::scene::packed::{
    PackedInstance, PackedPlaces, PackedScene, PackedTopNode, Unpackable,
};
use splitplane_core::scene::GeometryId;

use super::reserved::{Buffers, OF_INSTANCES, Room, Sending};
use crate::device::gpu::Gpu;
use crate::device::scope::checked;
use crate::error::GpuError;

/// Records that did not change, between two that did, are sent with them rather than in two pieces.
const GAP: usize = 4;

/// A scene in the memory of a device.
#[derive(Debug)]
pub(super) struct HeldScene {
    pub(super) buffers: Buffers,
    /// Where geometries lie in the others.
    pub(super) places: PackedPlaces,
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

/// Bytes that were sent.
type Sent = u64;

impl HeldScene {
    /// Sends a scene to what is reserved for it: of the geometries all or those that changed, and of the rest what is not as in `held`.
    ///
    /// # Errors
    /// No memory, or a device that fails: what the buffers hold may then be neither the old scene nor the new one.
    pub(super) fn put(
        gpu: &Gpu,
        held: Option<&HeldScene>,
        room: Room,
        scene: &BuiltScene,
    ) -> Result<(HeldScene, Sent), GpuError> {
        let Room { buffers, sending } = room;
        let mut packed = PackedScene::default();
        let (places, sent) = match sending {
            Sending::All => {
                packed = scene.packed().map_err(unpackable)?;
                let sent = send_all(gpu, &buffers, &packed)?;
                (PackedPlaces::of(scene).map_err(unpackable)?, sent)
            }
            Sending::Changed { places, geometries } => {
                if let Some(held) = held {
                    copy_grown(gpu, &held.buffers, &buffers)?;
                }
                let sent = send_geometries(gpu, &buffers, scene, &places, &geometries)?;
                scene.pack_instances(&mut packed, &places).map_err(unpackable)?;
                (*places, sent)
            }
        };
        let PackedScene { box_nodes, instances, .. } = packed;
        let was = |place: usize| held.filter(|held| held.buffers[place] == buffers[place]);
        let of_instances = checked(gpu, "what changed of a scene", || {
            let nodes_were = was(0).map_or(&[][..], |held| &held.box_nodes);
            let instances_were = was(1).map_or(&[][..], |held| &held.instances);
            Ok(send_changes(gpu, &buffers[0], nodes_were, &box_nodes)
                + send_changes(gpu, &buffers[1], instances_were, &instances))
        })?;
        let (way, masked, has_shapes) = (way(scene), scene.has_opacity(), scene.has_shapes());
        let own = HeldScene { buffers, places, box_nodes, instances, way, masked, has_shapes };
        Ok((own, sent + of_instances))
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

/// Copies what is on the device from the buffers of geometries that are replaced to the larger ones that replace them.
fn copy_grown(gpu: &Gpu, from: &Buffers, to: &Buffers) -> Result<(), GpuError> {
    let pairs = || from.iter().zip(to).skip(OF_INSTANCES).filter(|(from, to)| from != to);
    if pairs().next().is_none() {
        return Ok(());
    }
    checked(gpu, "a scene that grows", || {
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        for (from, to) in pairs() {
            encoder.copy_buffer_to_buffer(from, 0, to, 0, from.size().min(to.size()));
        }
        gpu.submit([encoder.finish()])?;
        Ok(())
    })
}

/// Sends all geometries at once: pieces would be many where geometries are small.
fn send_all(gpu: &Gpu, buffers: &Buffers, packed: &PackedScene) -> Result<Sent, GpuError> {
    let parts: [&[u8]; 4] = [
        bytemuck::cast_slice(&packed.nodes),
        bytemuck::cast_slice(&packed.references),
        bytemuck::cast_slice(&packed.triangles),
        bytemuck::cast_slice(&packed.shapes),
    ];
    checked(gpu, "the geometries of a scene", || {
        let pairs = buffers[OF_INSTANCES..].iter().zip(parts);
        pairs.for_each(|(buffer, bytes)| gpu.write(buffer, 0, bytes));
        Ok(parts.iter().map(|bytes| bytes.len() as u64).sum())
    })
}

/// Sends geometries to their places, one after the other.
fn send_geometries(
    gpu: &Gpu,
    buffers: &Buffers,
    scene: &BuiltScene,
    places: &PackedPlaces,
    names: &[GeometryId],
) -> Result<Sent, GpuError> {
    checked(gpu, "the geometries of a scene", || {
        let mut sent = 0;
        for &name in names {
            let piece = scene.packed_piece(name, places).map_err(unpackable)?;
            for (buffer, (at, bytes)) in buffers[OF_INSTANCES..].iter().zip(piece.parts()) {
                if !bytes.is_empty() {
                    gpu.write(buffer, at, bytes);
                    sent += bytes.len() as u64;
                }
            }
        }
        Ok(sent)
    })
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
