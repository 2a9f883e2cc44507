//! The subtree of one root: the rest of the large-node stage and the small-node stage, depth first.

use core::marker::PhantomData;
use std::collections::TryReserveError;

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::build::bins::{BinAxis, NodeBins};
use splitplane_core::build::decide::cut_empty_space;
use splitplane_core::config::{BuildConfig, MAX_BINS, Planes};
use splitplane_core::layout::{Decision, Extent, LargeNode, Reference, SmallRoot};
use splitplane_core::tree::node::{Axis, KdNode};
use splitplane_core::triangle::Triangle;

use super::caps::Caps;
use super::task_scratch::{ColumnNode, Next, ScratchPool, TaskScratch};
use crate::build::twin::count_bins::count_axis;
use crate::build::twin::executor::StageCounts;
use crate::build::twin::kernels::{split_binned, split_median};
use crate::build::twin::small_root::SmallRootCosts;
use crate::build::twin::subtrees::Subtrees;
use crate::cancel::ProgressMeter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::simd::columns::Columns;
use crate::simd::references::TILE;
use crate::simd::{Compiled, InstructionSet, Simd, WIDTH};
use crate::span;

/// What all tasks read.
#[derive(Debug)]
pub(super) struct SubtreeInputs<'a> {
    pub meter: &'a ProgressMeter<'a>,
    /// The configuration of the tree.
    pub config: &'a BuildConfig,
    pub planes: Planes,
    /// Most references of a node that one task builds; a root with more is a leaf too large to split.
    pub limit: u32,
    pub set: InstructionSet,
    pub roots: &'a [SmallRoot],
    pub references: &'a [Reference],
    pub triangles: &'a [Triangle],
    /// First top node of each level so far.
    pub level_starts: &'a [u32],
    pub caps: &'a Caps,
}

/// Builds the subtree of every root. `subtrees` and `totals` have an element for each.
///
/// # Errors
/// Not enough memory.
pub(super) fn run<A: Arithmetic>(
    inputs: &SubtreeInputs<'_>,
    workers: &ScratchPool,
    sizes: &mut [Extent],
    totals: &mut [StageCounts],
    subtrees: &mut [Subtrees],
) -> Result<(), TryReserveError> {
    let roots = inputs.roots.par_iter().zip(sizes).zip(totals).zip(subtrees);
    let _loop = span::pieces_of(1);
    roots.with_max_len(1).try_for_each(|(((root, size), totals), out)| {
        let _piece = span::piece();
        out.clear();
        *totals = StageCounts::default();
        *size = Extent::default();
        if inputs.meter.is_cancelled() || inputs.caps.exceeded() {
            return Ok(());
        }
        let mut worker = workers.take()?;
        let one = OneRoot::<A> {
            inputs,
            root,
            worker: &mut worker,
            totals,
            out,
            arithmetic: PhantomData,
        };
        // SAFETY: the executor holds only sets that the processor has.
        let done = unsafe { inputs.set.run(one) };
        workers.give_back(worker);
        *size = Extent { nodes: out.nodes.len() as u32, references: out.references.len() as u32 };
        inputs.meter.advance(u64::from(root.count));
        done
    })
}

/// [`one_root`], compiled for each set.
struct OneRoot<'a, A> {
    inputs: &'a SubtreeInputs<'a>,
    root: &'a SmallRoot,
    worker: &'a mut TaskScratch,
    totals: &'a mut StageCounts,
    out: &'a mut Subtrees,
    arithmetic: PhantomData<A>,
}

impl<A: Arithmetic> Compiled for OneRoot<'_, A> {
    type Output = Result<(), TryReserveError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<(), TryReserveError> {
        let OneRoot { inputs, root, worker, totals, out, .. } = self;
        one_root::<A, S>(inputs, root, worker, totals, out)
    }
}

/// One task under way.
struct SubtreeTask<'a> {
    inputs: &'a SubtreeInputs<'a>,
    costs: SmallRootCosts,
    worker: &'a mut TaskScratch,
    totals: &'a mut StageCounts,
    out: &'a mut Subtrees,
}

/// Builds the subtree of one root.
#[cfg_attr(not(unoptimised), inline(always))]
fn one_root<A: Arithmetic, S: Simd>(
    inputs: &SubtreeInputs<'_>,
    root: &SmallRoot,
    worker: &mut TaskScratch,
    totals: &mut StageCounts,
    out: &mut Subtrees,
) -> Result<(), TryReserveError> {
    let count = root.count as usize;
    let references = &inputs.references[root.first as usize..][..count];
    if root.count > inputs.limit {
        totals.small_roots += 1;
        return out.leaf(0, references.iter().map(|reference| reference.triangle));
    }
    worker.columns.lengthen(count + WIDTH)?;
    worker.columns.load(references);
    let level = inputs.level_starts.partition_point(|&start| start <= root.node) as u32;
    let costs = SmallRootCosts::of(inputs.config);
    let node = ColumnNode {
        first: 0,
        count,
        free: count + WIDTH,
        cell: root.cell(),
        depth: root.depth,
        level,
        inseparable: false,
    };
    SubtreeTask { inputs, costs, worker, totals, out }.subtree::<A, S>(node)
}

impl SubtreeTask<'_> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn subtree<A: Arithmetic, S: Simd>(&mut self, root: ColumnNode) -> Result<(), TryReserveError> {
        // References that splits added, and nodes, since the caps were last updated.
        let mut untold = [0u64; 2];
        self.worker.stack.clear();
        let mut node = root;
        loop {
            if node.count > self.inputs.config.small_node_limit() as usize {
                if self.inputs.meter.record_work(2 * node.count as u64) {
                    return Ok(());
                }
                self.totals.levels = self.totals.levels.max(node.level + 1);
                let left = self.large::<A, S>(&node, &mut untold)?;
                if untold[0] + untold[1] > 1 << 10 {
                    let [references, nodes] = core::mem::take(&mut untold);
                    self.inputs.caps.add(references, nodes);
                    if self.inputs.caps.exceeded() {
                        return Ok(());
                    }
                }
                if let Some(left) = left {
                    node = left;
                    continue;
                }
            } else if node.count > 0 {
                self.totals.small_roots += 1;
                // A root takes some tens of microseconds.
                self.inputs.meter.record_work(256);
                let TaskScratch { root, columns, .. } = &mut *self.worker;
                root.load_rows(columns, node.first, node.count);
                root.build::<A, S>(&self.costs, &node.cell, node.depth, [0, 0], self.out)?;
            } else {
                self.empty_leaf()?;
            }
            node = loop {
                match self.worker.stack.pop() {
                    None => {
                        self.inputs.caps.add(untold[0], untold[1]);
                        return Ok(());
                    }
                    Some(Next::Empty { parent }) => {
                        self.right_child(parent);
                        self.empty_leaf()?;
                    }
                    Some(Next::Right { node, from, parent }) => {
                        self.right_child(parent);
                        // The old contents are no longer needed: so a task needs little more space
                        // than its root.
                        self.worker.columns.move_down(from, node.count, node.first);
                        break node;
                    }
                }
            };
        }
    }

    /// A node of more than T references: its cuts, then a leaf, or a split, of which the left child comes next.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn large<A: Arithmetic, S: Simd>(
        &mut self,
        node: &ColumnNode,
        untold: &mut [u64; 2],
    ) -> Result<Option<ColumnNode>, TryReserveError> {
        let decision = self.decide::<A>(node)?;
        let mut cell = node.cell;
        let depth = node.depth + decision.cut_count;
        untold[1] += 2 * u64::from(decision.cut_count);
        for index in 0..decision.cut_count {
            let (side, position) = (decision.cut_side(index), decision.cuts[index as usize]);
            let parent = self.interior(side / 2, position)?;
            if side.is_multiple_of(2) {
                cell.lo[side / 2] = position;
                self.empty_leaf()?;
                self.right_child(parent);
            } else {
                cell.hi[side / 2] = position;
                self.worker.stack.push(Next::Empty { parent });
            }
        }
        if decision.axis == Decision::TRANSFER {
            self.totals.small_roots += 1;
            let triangles = self.worker.columns.triangles(node.first, node.count);
            self.out.leaf(0, triangles.iter().copied())?;
            return Ok(None);
        }
        let (axis, position) = (decision.axis as usize, decision.position);
        self.worker.columns.lengthen(node.free + node.count + TILE + WIDTH)?;
        let TaskScratch { columns, cut, .. } = &mut *self.worker;
        (cut.parts.axis, cut.parts.plane) = (axis, position);
        let triangles = self.inputs.config.clip.then_some(self.inputs.triangles);
        let (mut left, mut right) = (0, 0);
        for tile in (0..node.count).step_by(TILE) {
            let count = TILE.min(node.count - tile);
            let from = node.first + tile;
            cut.tile::<A, S>(columns, from, count, triangles);
            let to = [node.first + left, node.free + right];
            let [lefts, rights] = S::divide(columns, &cut.parts, from, count, to[0], to[1]);
            left += lefts;
            right += rights;
        }
        untold[0] += (left + right).saturating_sub(node.count) as u64;
        untold[1] += 2;
        let parent = self.interior(axis, position)?;
        let (mut left_cell, mut right_cell) = (cell, cell);
        left_cell.hi[axis] = position;
        right_cell.lo[axis] = position;
        let child = ColumnNode {
            first: node.first,
            count: left,
            free: node.free + right + WIDTH,
            cell: left_cell,
            depth: depth + 1,
            level: node.level + 1,
            inseparable: left == node.count && right == node.count,
        };
        let other = ColumnNode { count: right, free: node.free, cell: right_cell, ..child };
        self.worker.stack.push(Next::Right { node: other, from: node.free, parent });
        Ok(Some(child))
    }

    /// The decision about a large node, as `split_median` and `split_binned` make it.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn decide<A: Arithmetic>(&mut self, node: &ColumnNode) -> Result<Decision, TryReserveError> {
        let SubtreeInputs { meter, config, planes, .. } = *self.inputs;
        let TaskScratch { columns, references, bins, .. } = &mut *self.worker;
        let tight = columns.bounds(node.first, node.count);
        let large = LargeNode {
            lo: node.cell.lo,
            hi: node.cell.hi,
            count: node.count as u32,
            depth: node.depth,
            inseparable: u32::from(node.inseparable),
            ..bytemuck::Zeroable::zeroed()
        };
        Ok(match planes {
            Planes::Median => {
                if node.inseparable {
                    columns.references(node.first, node.count, references)?;
                }
                split_median::decide::<A>(meter, config, &large, &tight, references)
            }
            Planes::Binned => {
                let (decision, cell) = cut_empty_space::<A>(config, &large, &tight);
                let Some(cell) = cell else { return Ok(decision) };
                count_bins::<A>(config.bins(), columns, node, &tight, bins);
                split_binned::split::<A>(config, &large, &cell, &tight, bins, decision)
            }
        })
    }

    /// Appends a leaf of no references.
    fn empty_leaf(&mut self) -> Result<(), TryReserveError> {
        self.out.leaf(0, core::iter::empty())
    }

    /// Appends an interior node whose right child is not known yet.
    fn interior(&mut self, axis: usize, position: f32) -> Result<usize, TryReserveError> {
        self.out.push(KdNode::interior(Axis::from_index(axis as u32), position, 0))?;
        Ok(self.out.nodes.len() - 1)
    }

    /// Names the node that is appended next as the right child of `parent`.
    fn right_child(&mut self, parent: usize) {
        let right = self.out.nodes.len() as u32;
        let parent = &mut self.out.nodes[parent];
        *parent = parent.with_right(right);
    }
}

/// Counts by bins where the references of a node start and end.
#[cfg_attr(not(unoptimised), inline(always))]
fn count_bins<A: Arithmetic>(
    count: u32,
    columns: &Columns,
    node: &ColumnNode,
    tight: &Aabb,
    bins: &mut NodeBins,
) {
    for axis in 0..3 {
        // A flat axis has no borders: its bins stay empty.
        let mut counted = [[0; MAX_BINS as usize]; 2];
        if let Some(bins) = BinAxis::of::<A>(tight, axis, count) {
            let lo = columns.face(axis, node.first, node.count);
            let hi = columns.face(3 + axis, node.first, node.count);
            counted = count_axis::<A>(&bins, lo, hi);
        }
        [bins.starts[axis], bins.ends[axis]] = counted;
    }
}
