//! Watching work that takes long, and ending it.

use core::fmt;
use core::ops::ControlFlow;

/// What a build or a batch is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stage {
    /// Bounds and references of all triangles; `done` counts triangles, each twice. Of a tree that is
    /// loaded: whether it belongs to the mesh.
    Start,
    /// The large-node stage; `done` counts levels, whose number is not known before the end.
    LargeNodes,
    /// The small-node stage; `done` counts small roots. On the CPU the lower levels of the large-node stage
    /// are part of it, and `done` counts the references of the nodes whose subtrees are finished.
    SmallNodes,
    /// Nodes and references take their places; `done` counts the subtrees of the stage before, or nodes of the
    /// offline builder.
    Output,
    /// The offline builder, in place of the two stages. Every node has a share of the references that the
    /// configuration allows, its children share it; `done` counts the shares of finished leaves.
    Offline,
    /// What queries read is made from the tree; `done` counts nodes and references.
    Layout,
    /// A device works on what it was handed.
    Device,
    /// Rays are traced; `done` counts rays.
    Rays,
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
        }
    }
}

/// How far work has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// What is being done.
    pub stage: Stage,
    /// How much of the stage is done, in the stage's unit.
    pub done: u64,
    /// How much there is to do; 0 where that is not known.
    pub total: u64,
}

/// Is told how far work has come, and may end it.
///
/// Called from any of the threads that work, often (about every millisecond of work
/// of a thread; on devices between submissions and while waiting for one): an answer should take little
/// time. Backends of this project call it from one thread at a time for each build or batch: stages come in
/// their order, and within one `done` never falls. After the first [`ControlFlow::Break`] the work ends with
/// an error that says where; what was built or answered until then is dropped, and everything stays fit for
/// use. So it does when the watch panics; the panic goes to the caller of the build or batch.
pub trait Watch: Sync {
    /// Work has come this far; `Break` ends it.
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
