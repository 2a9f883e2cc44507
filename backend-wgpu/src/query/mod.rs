//! Rays through a tree on the device.
//!
//! [`DeviceTree`] is a tree in device memory. [`Queries`] traces batches through it, from host
//! memory or recorded into a host's own commands. [`WgpuAccelerator`] puts both behind the core's
//! `Accelerator`. A host's own shader calls the same traversal: see
//! [`splitplane_shaders::traversal`] and [`DeviceTree::bind_group_entries`].

mod accelerator;
mod all_hits;
mod answers;
mod asked;
mod batch;
mod casts;
mod compressed;
mod compressing;
mod counts;
mod error;
mod held;
mod layout;
pub(crate) mod limits;
mod lists;
mod marked;
mod near;
mod pipelines;
mod points;
mod record;
mod resident;
mod scene;
mod settle;
mod slices;
mod staging;
mod tree;
mod windings;

pub use accelerator::WgpuAccelerator;
#[doc(hidden)]
pub use compressing::{CompressExecutor, Compressing};
pub use error::DeviceQueryError;
pub use layout::UNFINISHED;
pub use marked::Marked;
pub use pipelines::Queries;
pub(crate) use pipelines::QueryVariant;
pub use points::WgpuPointTree;
#[doc(hidden)]
pub use points::{BuildingPoints, PointExecutor};
pub use resident::{SceneBindings, WgpuScene};
pub use scene::SceneUniform;
pub use splitplane_core::ray::Hit;
pub use tree::{DeviceTree, TreeParts};
