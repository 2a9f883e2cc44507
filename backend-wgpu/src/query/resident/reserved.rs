//! What is reserved on a device for a scene that is going to be.

use splitplane_core::backend::scene::packed::PackedPlaces;
use splitplane_core::scene::GeometryId;

/// Buffers that do not depend on geometries alone come first: these are as many.
pub(super) const OF_INSTANCES: usize = 2;

/// The buffers of a scene: nodes of the tree over instances, instances, nodes, references, corners, shapes.
pub(super) type Buffers = [wgpu::Buffer; 6];

/// What is to be sent of the geometries.
#[derive(Debug)]
pub(super) enum Sending {
    /// All, one behind the other.
    All,
    /// Those that changed, to these places. The others are there.
    Changed { places: Box<PackedPlaces>, geometries: Vec<GeometryId> },
}

/// What is reserved on the device for a scene that is going to be. Nothing is written yet.
#[derive(Debug)]
pub(super) struct Room {
    pub(super) buffers: Buffers,
    pub(super) sending: Sending,
}

/// What came of reserving room.
#[derive(Debug)]
pub(super) enum Reserved {
    /// It is there, beside what the device holds of the old scene.
    Room(Room),
    /// The limit of memory has no place for it beside the old scene: that has to go first, which it may once the update is in place on the host.
    Afterwards,
    /// The scene is not going to be on the device, for this reason.
    Refused(String),
}
