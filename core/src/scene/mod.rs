//! Scenes of many objects: geometries, and instances of them.
//!
//! A [`Scene`] is a description that its user edits: meshes and sets of [shapes](shape), and instances that place them in the world. A backend
//! makes of it what answers rays ([`Backend::build_scene`](crate::backend::Backend::build_scene)), and brings that up to
//! date after edits, remaking only what changed.
//!
//! A ray goes into an object's space by guarded operations in a stated order ([`ObjectSpace`]); the direction keeps its
//! length, so that `t` is the caller's and one `t` orders all instances. There the geometry's own query answers it, by
//! whatever backend and accuracy. Which instances a ray has to enter is found by a tree over their boxes
//! ([`TopTree`]), which are wide enough for what the transforms' roundings move ([`WorldBox`]). So no hit depends on
//! that tree, and it may be refitted while instances move.

mod bake;
mod description;
mod digest;
mod error;
pub mod file;
mod hit;
pub mod moved;
mod opacity;
mod options;
mod outline;
mod placement;
pub mod shape;
mod shape_tree;
mod top_build;
mod top_meet;
mod top_near;
mod top_refit;
mod top_tree;
mod top_walk;
mod transform;
mod world_box;

pub use bake::{BakeError, BakedTable};
pub use description::{Changes, Edits, GeometryMesh, Instance, Scene, State};
pub(crate) use digest::SceneDigest;
pub use error::{SceneBuildError, SceneError};
pub use hit::{GeometryId, InstanceId, MAX_INSTANCES, MAX_OPACITY_LEVEL, SceneHit};
pub use opacity::OpacityMask;
pub(crate) use opacity::opacity_bit;
pub use options::{Filter, IgnoredTriangle, SceneOptions, SceneReport};
pub use outline::Outline;
pub(crate) use outline::OutlineCells;
pub use placement::{LEAST_OF_RAY, LEAST_OF_WAY, Placement};
pub use shape_tree::ShapeTree;
pub(crate) use shape_tree::is_culled;
pub use top_build::top_tree_bytes;
pub use top_tree::{
    INSTANCE as TOP_INSTANCE, NONE as TOP_NONE, TopNode, TopTree, WIDTH as TOP_WIDTH,
};
pub use top_walk::{ScalarWalker, TopRay, TopStack, TopWalk, TopWalker, WIDEST_STACK};
pub(crate) use transform::{Defect, transformed};
pub use transform::{IDENTITY, ObjectSpace, Transform, translation};
pub use world_box::WorldBox;
