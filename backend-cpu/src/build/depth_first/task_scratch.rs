//! Scratch memory of tasks, kept between builds.

use std::collections::TryReserveError;
use std::sync::Mutex;

use splitplane_core::aabb::Aabb;
use splitplane_core::build::bins::NodeBins;
use splitplane_core::config::MAX_DEPTH;
use splitplane_core::layout::Reference;

use super::cut::Cut;
use crate::build::twin::small_root::SmallRootBuilder;
use crate::memory::boxed;
use crate::simd::columns::Columns;

/// Scratch memory of all tasks, kept between builds.
#[derive(Debug, Default)]
pub(super) struct ScratchPool {
    spare: Mutex<Vec<Box<TaskScratch>>>,
}

impl ScratchPool {
    /// Bytes held.
    pub(super) fn bytes(&self) -> u64 {
        self.spare.lock().map_or(0, |spare| spare.iter().map(|worker| worker.bytes()).sum())
    }

    /// Makes scratch for each thread, with as much space as any thread has needed so far. So the
    /// next build of the kind allocates nothing, whichever thread takes which.
    ///
    /// # Errors
    /// Less memory than that.
    pub(super) fn prepare(&mut self, threads: usize) -> Result<(), TryReserveError> {
        let Ok(spare) = self.spare.get_mut() else { return Ok(()) };
        spare.try_reserve_exact(threads.saturating_sub(spare.len()))?;
        while spare.len() < threads {
            spare.push(TaskScratch::new()?);
        }
        let rows = spare.iter().map(|worker| worker.columns.room()).max().unwrap_or(0);
        let listed = spare.iter().map(|worker| worker.references.capacity()).max().unwrap_or(0);
        for worker in spare {
            worker.columns.lengthen(rows)?;
            worker.references.clear();
            worker.references.try_reserve_exact(listed)?;
        }
        Ok(())
    }

    pub(super) fn take(&self) -> Result<Box<TaskScratch>, TryReserveError> {
        // A poisoned lock means that another thread panicked; a new one serves.
        let spare = self.spare.lock().map_or(None, |mut spare| spare.pop());
        spare.map_or_else(TaskScratch::new, Ok)
    }

    /// Keeps scratch for later tasks. Drops it if the list has no space.
    pub(super) fn give_back(&self, worker: Box<TaskScratch>) {
        if let Ok(mut spare) = self.spare.lock()
            && spare.try_reserve(1).is_ok()
        {
            spare.push(worker);
        }
    }
}

/// Scratch memory of one task.
#[derive(Debug)]
pub(super) struct TaskScratch {
    pub columns: Columns,
    pub cut: Cut,
    pub root: SmallRootBuilder,
    pub bins: NodeBins,
    /// References of a node that a plane did not separate.
    pub references: Vec<Reference>,
    pub stack: Vec<Next>,
}

impl TaskScratch {
    /// Scratch without references; its fixed parts are allocated with it.
    fn new() -> Result<Box<TaskScratch>, TryReserveError> {
        let mut stack = Vec::new();
        // A cut or a split each for every level.
        stack.try_reserve_exact(MAX_DEPTH as usize + 2)?;
        boxed(|| TaskScratch {
            columns: Columns::default(),
            cut: Cut::new(),
            root: SmallRootBuilder::new(),
            bins: NodeBins::EMPTY,
            references: Vec::new(),
            stack,
        })
    }

    fn bytes(&self) -> u64 {
        let listed = self.references.capacity() * size_of::<Reference>();
        let stack = self.stack.capacity() * size_of::<Next>();
        (size_of::<TaskScratch>() + listed + stack) as u64 + self.columns.bytes()
    }
}

/// A node of a task's subtree: a range of the columns.
#[derive(Clone, Copy, Debug)]
pub(super) struct ColumnNode {
    pub first: usize,
    pub count: usize,
    /// From this row on, and [`simd::WIDTH`](crate::simd::WIDTH) rows after its own, the rows are free.
    pub free: usize,
    pub cell: Aabb,
    pub depth: u32,
    /// Levels of the large-node stage before its own.
    pub level: u32,
    /// Whether the plane that made it separated nothing.
    pub inseparable: bool,
}

/// What comes next in preorder.
#[derive(Clone, Copy, Debug)]
pub(super) enum Next {
    /// The right child of the interior node `parent`, whose rows begin at `from`.
    Right { node: ColumnNode, from: usize, parent: usize },
    /// An empty leaf, the right child of the interior node `parent`.
    Empty { parent: usize },
}
