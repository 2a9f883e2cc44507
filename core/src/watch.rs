//! Progress and cancellation of long work.

use core::fmt;
use core::ops::ControlFlow;

/// What a build or a batch is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stage {
    /// Bounds and references of all triangles; `done` counts triangles, each twice. For a loaded
    /// tree: the check whether it belongs to the mesh.
    Start,
    /// The large-node stage; `done` counts levels, whose number is not known before the end.
    LargeNodes,
    /// The small-node stage; `done` counts small roots. On the CPU the lower levels of the large-node stage
    /// are part of it, and `done` counts the references of the nodes whose subtrees are finished.
    SmallNodes,
    /// Nodes and references take their places; `done` counts the subtrees of the stage before, or nodes of the
    /// offline builder.
    Output,
    /// The offline builder, which replaces the two stages. Each node gets a share of the allowed
    /// references and divides it among its children; `done` counts the shares of finished leaves.
    Offline,
    /// The query layout is made from the tree; `done` counts nodes and references.
    Layout,
    /// A device executes submitted work.
    Device,
    /// Rays are traced; `done` counts rays.
    Rays,
    /// The geometries of a scene are built, one after the other; `done` counts those that are finished. The stages of
    /// each come in between.
    Geometries,
    /// A tree of points is built; `done` counts points in finished subtrees.
    Points,
}

impl Stage {
    /// The stage in a few words.
    pub const fn name(self) -> &'static str {
        match self {
            Stage::Start => "triangle bounds",
            Stage::LargeNodes => "large-node stage",
            Stage::SmallNodes => "small-node stage",
            Stage::Output => "output stage",
            Stage::Offline => "offline builder",
            Stage::Layout => "query layout",
            Stage::Device => "device",
            Stage::Rays => "rays",
            Stage::Geometries => "geometries",
            Stage::Points => "point tree",
        }
    }
}

/// How far the work has progressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// What is being done.
    pub stage: Stage,
    /// How much of the stage is done, in the stage's unit.
    pub done: u64,
    /// The total amount of work; 0 where that is not known.
    pub total: u64,
}

/// Observes the progress of a build or batch and may cancel it.
///
/// Called from any worker thread, and often, so it should return quickly. The CPU backend divides its work so
/// that a thread does at most about two milliseconds of it between two calls (a single ray that takes longer is
/// not interrupted); calls may come many times per millisecond. Devices call it between submissions and while
/// they wait for one. The default batches of the trait `Accelerator` call it every 65,536 rays.
/// Backends of this project call it from one thread at a time for each build or batch: stages come in their order,
/// and within one `done` never falls. After the first [`ControlFlow::Break`] the work ends with an
/// error that says how far it got. Partial results are dropped, and all objects stay usable. The
/// same holds when the watch panics; the panic is passed on to the caller of the build or batch.
pub trait Watch: Sync {
    /// Receives the progress; `Break` cancels the work.
    fn progress(&self, progress: &Progress) -> ControlFlow<()>;
}

/// A closure is a watch.
impl<F: Fn(&Progress) -> ControlFlow<()> + Sync> Watch for F {
    #[inline]
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        self(progress)
    }
}

impl fmt::Debug for dyn Watch + '_ {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a watch")
    }
}
