//! Scenes that are built: what answers rays through many objects.
//!
//! A batch is answered in *waves*. In each wave every ray that is not done finds the next instance that it enters, nearest
//! boxes first; the rays that enter instances of one geometry go into its space together, one array for all of them, and the geometry's own
//! batch query answers that. What it finds is merged by (t, instance, triangle), and a ray's next instance has to begin before its
//! best hit. So whatever a backend's batches can do, they do for scenes, and answers are the same on all of them.

mod accelerator;
mod all_hits;
mod block;
mod built;
mod closest_point;
mod cost;
mod extents;
mod filtered;
mod host;
mod lists;
mod locate;
mod near_shapes;
mod nearness;
mod needed;
mod overlap;
pub mod packed;
mod pending;
mod repeats;
mod shapes;
mod shared;
mod single;
mod spares;
mod update;
mod within;
mod write_file;

pub use accelerator::SceneAccelerator;
pub use all_hits::{SceneAllHits, SceneAllHitsOptions, SceneCrossing};
pub use block::{Asked, Block, BlockScratch, SceneAnswer, limit_within, seen_by};
pub use built::{BuildGeometry, BuiltGeometry, BuiltScene};
pub use closest_point::{SceneClosestPoint, SceneClosestPointOptions, closest_in_world};
pub use filtered::Kept;
pub use host::HostScene;
pub use overlap::{SceneOverlapOptions, SceneOverlaps, SceneTriangle};
pub use packed::GeometryChange;
pub use pending::{FinishError, PendingUpdate};
pub use shared::SharedGeometry;
#[doc(hidden)]
pub use shared::bytes_of;
pub use spares::SceneUpdater;
pub use update::{Becoming, TopUpdate, UpdateReport};
pub use write_file::{SceneWriteError, write_file};
