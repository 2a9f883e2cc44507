//! What is asked of a scene in one batch, and what answering it took.

use splitplane_core::backend::scene::BuiltScene;
use splitplane_core::ray::Ray;
use splitplane_core::scene::SceneOptions;

use super::parts::Geometries;

/// Rays of a block: enough that those in one geometry are many, and few enough that their stacks stay near.
pub(super) const BLOCK: usize = 4096;
/// The same with a watch, so that a wave is soon over.
pub(super) const WATCHED_BLOCK: usize = 256;

/// Rays through a scene on one thread. Geometries must be made for the set.
pub(super) struct SceneBatch<'a, T> {
    pub(super) scene: &'a BuiltScene,
    pub(super) geometries: &'a Geometries<'a>,
    pub(super) rays: &'a [Ray],
    pub(super) answers: &'a mut [T],
    pub(super) options: &'a SceneOptions<'a>,
}

/// What following rays took.
#[derive(Clone, Copy, Default)]
pub(super) struct Work {
    /// Instances entered.
    pub(super) entered: u64,
    /// Hits that did not count.
    pub(super) rejected: u64,
}
