//! Executors of which one kernel is wrong: planted faults that lockstep must find and name.

use splitplane_core::build::lockstep::Inspect;
use splitplane_core::build::reference::{Buffers, ReferenceExecutor};
use splitplane_core::build::schedule::Executor;
use splitplane_core::error::BuildError;
use splitplane_core::kernel::{Buffer, Counter, Kernel, TreeBuilder};
use splitplane_core::layout::Counters;
use splitplane_core::tree::node::KdNode;

/// What a kernel does wrong: a change to what the right one has just written.
pub type Fault = fn(&mut Buffers);

/// The reference executor with a fault in one kernel.
#[derive(Debug)]
pub struct WrongKernel<'a> {
    inner: ReferenceExecutor<'a>,
    kernel: Kernel,
    fault: Fault,
}

impl<'a> WrongKernel<'a> {
    /// Plants a fault.
    pub fn new(inner: ReferenceExecutor<'a>, kernel: Kernel, fault: Fault) -> WrongKernel<'a> {
        WrongKernel { inner, kernel, fault }
    }
}

impl Executor<TreeBuilder> for WrongKernel<'_> {
    type Error = BuildError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), BuildError> {
        self.inner.dispatch(kernel)?;
        if kernel == self.kernel {
            (self.fault)(self.inner.buffers_mut());
        }
        Ok(())
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), BuildError> {
        self.inner.swap(a, b)
    }

    fn pending(&mut self, counter: Counter, rounds: u32) -> Result<bool, BuildError> {
        self.inner.pending(counter, rounds)
    }
}

impl Inspect<TreeBuilder> for WrongKernel<'_> {
    fn live(&mut self, buffer: Buffer) -> Result<Vec<u8>, BuildError> {
        self.inner.live(buffer)
    }
}

/// One fault or more for every kernel: the last item of its grid, by as little as there is.
pub const FAULTS: &[(Kernel, &str, Fault)] = &[
    (Kernel::TriangleBounds, "counts a snapped triangle twice", |b| {
        last(&mut b.chunk_counts, b.counters, Counter::InputChunks).right += 1;
    }),
    (Kernel::TriangleBounds, "keeps the sign of zero", |b| {
        let all = b.triangles.as_flattened_mut().as_flattened_mut();
        *all.iter_mut().find(|x| **x == 0.0).expect("a zero") = -0.0;
    }),
    (Kernel::ScanTriangles, "counts a dropped triangle too many", |b| {
        b.counters[Counter::Dropped] += 1;
    }),
    (Kernel::GatherReferences, "bounds a triangle too widely", |b| {
        let hi = &mut last(&mut b.references, b.counters, Counter::ActiveReferences).hi[0];
        *hi = hi.next_up();
    }),
    (Kernel::NodeBounds, "bounds a node too widely", |b| {
        let lo = &mut last(&mut b.node_bounds, b.counters, Counter::ActiveNodes).lo[2];
        *lo = lo.next_down();
    }),
    (Kernel::NodeBounds, "names another node", |b| {
        last(&mut b.chunks, b.counters, Counter::Chunks).node += 1;
    }),
    (Kernel::SplitMedian, "forgets a reference", |b| {
        last(&mut b.chunks, b.counters, Counter::Chunks).count -= 1;
    }),
    (Kernel::SplitMedian, "splits beside the median", |b| {
        let position = &mut last(&mut b.decisions, b.counters, Counter::ActiveNodes).position;
        *position = position.next_up();
    }),
    (Kernel::BinReferences, "counts an end too many", |b| {
        last(&mut b.chunk_bins, b.counters, Counter::Chunks).words[1][0] += 1 << 16;
    }),
    (Kernel::SplitBinned, "splits on another axis", |b| {
        let axis = &mut last(&mut b.decisions, b.counters, Counter::ActiveNodes).axis;
        *axis = (*axis + 1) % 3;
    }),
    (Kernel::ClassifyReferences, "sends a reference to another side", |b| {
        last(&mut b.reference_sides, b.counters, Counter::Chunks).right[0] ^= 1;
    }),
    (Kernel::ClassifyReferences, "counts a reference too many", |b| {
        last(&mut b.decisions, b.counters, Counter::ActiveNodes).counts.right += 1;
    }),
    (Kernel::ClassifyReferences, "counts a reference of a chunk twice", |b| {
        last(&mut b.chunk_counts, b.counters, Counter::Chunks).left += 1;
    }),
    (Kernel::ClassifyReferences, "counts a reference of a span twice", |b| {
        b.chunks[0].span_sides += 1 << 16;
    }),
    (Kernel::AllocateChildren, "places a child beside its place", |b| {
        last(&mut b.decisions, b.counters, Counter::ActiveNodes).first.right += 1;
    }),
    (Kernel::AllocateChildren, "counts a chunk too many", |b| b.counters[Counter::NextChunks] += 1),
    (Kernel::AllocateChildren, "forgets a level", |b| b.counters[Counter::Levels] -= 1),
    (Kernel::ScatterReferences, "exchanges two references", |b| {
        let next = b.count(Counter::NextReferences);
        if next > 1 {
            b.next_references.swap(next - 1, next - 2);
        } else {
            b.small_references.swap(0, 1);
        }
    }),
    (Kernel::ScatterReferences, "bounds a child too tightly", |b| {
        let hi = &mut last(&mut b.chunk_bounds, b.counters, Counter::Chunks).sides[0].hi[1];
        *hi = hi.next_down();
    }),
    (Kernel::BuildMiddle, "counts a level too many", |b| {
        last(&mut b.middle_roots, b.counters, Counter::MiddleRoots).levels += 1;
    }),
    (Kernel::ScanMiddle, "leaves a gap before the references of a root", |b| {
        last(&mut b.middle_roots, b.counters, Counter::MiddleRoots).first_reference += 1;
    }),
    (Kernel::PlaceMiddle, "exchanges two references", |b| b.small_references.swap(0, 1)),
    (Kernel::MeasureMiddle, "counts a node too many", |b| {
        last(&mut b.middle_sizes, b.counters, Counter::MiddleRoots).nodes += 1;
    }),
    (Kernel::EmitMiddle, "begins a small root too late", |b| {
        last(&mut b.small_addresses, b.counters, Counter::SmallRoots).references += 1;
    }),
    (Kernel::BuildSmall, "forgets a reference", |b| {
        last(&mut b.small_sizes, b.counters, Counter::SmallRoots).references -= 1;
    }),
    (Kernel::SubtreeSizes, "counts the root twice", |b| b.top_sizes[0].nodes += 1),
    (Kernel::PreorderAddresses, "leaves a gap before a subtree", |b| {
        last(&mut b.top_addresses, b.counters, Counter::TopNodes).nodes += 1;
    }),
    (Kernel::EmitTop, "makes the root a leaf", |b| b.nodes[0] = KdNode::leaf(0, 0)),
    (Kernel::EmitSmall, "names another triangle", |b| {
        *last(&mut b.leaf_references, b.counters, Counter::LeafReferences) ^= 1;
    }),
];

/// The last live element of a buffer.
fn last<T>(buffer: &mut [T], counters: Counters, counter: Counter) -> &mut T {
    &mut buffer[counters[counter] as usize - 1]
}
