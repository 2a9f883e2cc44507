//! The build schedule, stated once: Zhou et al. 2008, Algorithm 1. Every backend runs this code over
//! an executor of its own.

use crate::config::{CHUNK, Planes};
use crate::kernel::{Buffer, Counter, Kernel, KernelSet, TreeBuilder};
use crate::layout::Counters;

/// Runs the kernels of one set, in order. Generic over the set, so that one executor can run the
/// tree builder and a renderer.
pub trait Executor<K: KernelSet> {
    /// The errors of running.
    type Error;

    /// Runs a kernel over its grid. Later dispatches see all that it wrote.
    ///
    /// # Errors
    /// The executor's, such as those of memory or device.
    fn dispatch(&mut self, kernel: K::Kernel) -> Result<(), Self::Error>;

    /// Exchanges two buffers of the same type, and the counters of their live lengths.
    ///
    /// # Errors
    /// As for [`Executor::dispatch`].
    fn swap(&mut self, a: K::Buffer, b: K::Buffer) -> Result<(), Self::Error>;

    /// Whether a loop must continue: whether `counter` is above zero after `rounds` rounds. An
    /// executor that cannot read its counters may answer `true` without looking at them, any
    /// number of times: kernels do nothing where there is nothing to do.
    ///
    /// # Errors
    /// As for [`Executor::dispatch`].
    fn pending(&mut self, counter: K::Counter, rounds: u32) -> Result<bool, Self::Error>;
}

impl Counters {
    /// The counters before the first kernel of [`build`], for a mesh of this many triangles; the
    /// chunks are those of the input.
    pub fn at_start(triangles: u32) -> Counters {
        let mut counters = Counters::default();
        counters[Counter::Triangles] = triangles;
        counters[Counter::InputChunks] = triangles.div_ceil(CHUNK);
        counters[Counter::Chunks] = triangles.div_ceil(CHUNK);
        counters
    }
}

/// Builds a tree: Algorithm 1 of the paper.
///
/// The executor must hold the input, and its counters must be as [`Counters::at_start`] makes them.
/// Afterwards [`Buffer::Nodes`] and [`Buffer::LeafReferences`] hold
/// the tree.
///
/// # Errors
/// The executor's.
pub fn build<E: Executor<TreeBuilder>>(executor: &mut E, planes: Planes) -> Result<(), E::Error> {
    start(executor)?;
    resume(executor, planes)
}

/// The rest of a build whose large-node stage has begun: what [`build`] does after its start. An
/// executor that cannot read its counters runs a number of levels and then the other stages; when
/// it turns out that active nodes are left, it runs this again, and the later stages overwrite what
/// they did before.
///
/// # Errors
/// The executor's.
pub fn resume<E: Executor<TreeBuilder>>(executor: &mut E, planes: Planes) -> Result<(), E::Error> {
    let mut level = 0;
    while executor.pending(Counter::ActiveNodes, level)? {
        process_large_nodes(executor, planes)?;
        level += 1;
    }
    finish_middle_nodes(executor, planes)?;
    process_small_nodes(executor)?;
    preorder_traversal(executor, planes)
}

/// Triangle bounds, scene bounds, the root: the start of every builder, including those that do not
/// run the rest of the schedule.
///
/// # Errors
/// The first error of the executor.
pub fn start<E: Executor<TreeBuilder>>(executor: &mut E) -> Result<(), E::Error> {
    executor.dispatch(Kernel::TriangleBounds)?;
    executor.dispatch(Kernel::ScanTriangles)?;
    executor.dispatch(Kernel::GatherReferences)
}

/// One level of the large-node stage: Algorithm 2 of the paper.
fn process_large_nodes<E: Executor<TreeBuilder>>(
    executor: &mut E,
    planes: Planes,
) -> Result<(), E::Error> {
    // Group references into chunks; bounds by segmented reduction; empty-space cutoff and split.
    match planes {
        Planes::Median => executor.dispatch(Kernel::SplitMedian)?,
        Planes::Binned => {
            executor.dispatch(Kernel::NodeBounds)?;
            executor.dispatch(Kernel::BinReferences)?;
            executor.dispatch(Kernel::SplitBinned)?;
        }
    }
    // Sort references into children, counting first: order comes from counts, never from atomics.
    executor.dispatch(Kernel::ClassifyReferences)?;
    executor.dispatch(Kernel::AllocateChildren)?;
    executor.dispatch(Kernel::ScatterReferences)?;
    // The next list becomes the active one.
    executor.swap(Buffer::ActiveNodes, Buffer::NextNodes)?;
    executor.swap(Buffer::References, Buffer::NextReferences)
}

/// The rest of the large-node stage for nodes of few references, all levels of a node in one go: see
/// [`build::middle`](crate::build::middle). An executor that hands nothing over leaves its kernels out.
fn finish_middle_nodes<E: Executor<TreeBuilder>>(
    executor: &mut E,
    planes: Planes,
) -> Result<(), E::Error> {
    match planes {
        Planes::Median => {
            executor.dispatch(Kernel::BuildMiddle)?;
            executor.dispatch(Kernel::ScanMiddle)?;
            executor.dispatch(Kernel::PlaceMiddle)
        }
        Planes::Binned => Ok(()),
    }
}

/// The small-node stage: each small root's subtree, on 64-bit masks.
fn process_small_nodes<E: Executor<TreeBuilder>>(executor: &mut E) -> Result<(), E::Error> {
    executor.dispatch(Kernel::BuildSmall)
}

/// One preorder array from all subtrees.
fn preorder_traversal<E: Executor<TreeBuilder>>(
    executor: &mut E,
    planes: Planes,
) -> Result<(), E::Error> {
    let middle = planes == Planes::Median;
    if middle {
        executor.dispatch(Kernel::MeasureMiddle)?;
    }
    executor.dispatch(Kernel::SubtreeSizes)?;
    executor.dispatch(Kernel::PreorderAddresses)?;
    if middle {
        executor.dispatch(Kernel::EmitMiddle)?;
    }
    executor.dispatch(Kernel::EmitTop)?;
    executor.dispatch(Kernel::EmitSmall)
}

/// Writes each step of a schedule as a line, and passes it on. A snapshot pins its text.
#[derive(Debug)]
pub struct Trace<'a, E> {
    inner: E,
    out: &'a mut dyn TraceSink,
}

/// Where [`Trace`] writes its lines.
pub trait TraceSink: core::fmt::Debug {
    /// Takes one line.
    fn line(&mut self, line: core::fmt::Arguments<'_>);
}

#[cfg(feature = "alloc")]
impl TraceSink for alloc::string::String {
    fn line(&mut self, line: core::fmt::Arguments<'_>) {
        use core::fmt::Write;
        // Writing to a string cannot fail.
        let _ = writeln!(self, "{line}");
    }
}

impl<'a, E> Trace<'a, E> {
    /// A decorator over `inner` that writes to `out`.
    pub fn new(inner: E, out: &'a mut dyn TraceSink) -> Trace<'a, E> {
        Trace { inner, out }
    }

    /// The executor within.
    pub fn into_inner(self) -> E {
        self.inner
    }
}

impl<K: KernelSet, E: Executor<K>> Executor<K> for Trace<'_, E> {
    type Error = E::Error;

    fn dispatch(&mut self, kernel: K::Kernel) -> Result<(), E::Error> {
        self.out.line(format_args!("dispatch {kernel:?}"));
        self.inner.dispatch(kernel)
    }

    fn swap(&mut self, a: K::Buffer, b: K::Buffer) -> Result<(), E::Error> {
        self.out.line(format_args!("swap {a:?} {b:?}"));
        self.inner.swap(a, b)
    }

    fn pending(&mut self, counter: K::Counter, rounds: u32) -> Result<bool, E::Error> {
        let pending = self.inner.pending(counter, rounds)?;
        self.out.line(format_args!("pending {counter:?} after {rounds}: {pending}"));
        Ok(pending)
    }
}
