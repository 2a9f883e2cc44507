//! The rest of the large-node stage, and the small-node stage, for nodes that fit a cache: one task each.
//!
//! No kernel of the schedule, but the same tree. The schedule goes level by level, since devices have no
//! other way: every level reads and writes all references in memory, and all wait for the last. Here
//! the levels run until nodes have few references (see `limit`); a task then takes one such node, keeps its
//! references as a structure of arrays, and builds its subtree depth first, left before right, writing
//! nodes in preorder. What becomes of a node depends on its references, its cell, its depth and whether it
//! was inseparable, never on its neighbours, so the subtree is the one that the levels give. The one exception
//! are the caps on references and nodes, which bind in the order of levels: where they might, the
//! build is void ([`Caps`]) and the schedule builds the tree as it stands.

use core::marker::PhantomData;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::collections::TryReserveError;
use std::sync::Mutex;

use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::bins::{BinAxis, NodeBins};
use splitplane_core::config::{BuildConfig, MAX_BINS, MAX_DEPTH, Planes};
use splitplane_core::decide::cut_empty_space;
use splitplane_core::layout::{Decision, Extent, LargeNode, Reference, SmallRoot};
use splitplane_core::node::{Axis, KdNode};
use splitplane_core::triangle::Triangle;

use super::columns::Columns;
use super::count_bins::count_axis;
use super::cut::{Cut, TILE};
#[cfg(target_arch = "x86_64")]
use super::lanes::Avx512;
use super::lanes::{Lanes, Plain, WIDTH};
use super::small_root::{Costs, Root, Subtrees};
use crate::buffers::boxed;
use crate::kernels::{split_binned, split_large};
use crate::lookout::Lookout;
use crate::query::{Compiled, InstructionSet, Simd};

/// Tasks for each thread: enough that the last ones to end keep no other waiting long.
const TASKS: usize = 8;
/// Fewest references of a task: levels cost little beside what they save from here on.
const LEAST: usize = 1024;
/// Most: columns of so many references fit the last level of cache of most machines.
const MOST: usize = 1 << 17;

/// Most references of a node that one task builds.
pub fn limit(references: usize, threads: usize) -> u32 {
    (references / (TASKS * threads)).clamp(LEAST, MOST) as u32
}

/// Whether a cap on references or nodes might have bound. A cap compares what would be alive in the order of
/// levels; that is at most what there is in the end when nothing that vanished is taken off.
#[derive(Debug, Default)]
pub struct Caps {
    /// References of the root, and those that splits added.
    references: AtomicU64,
    /// Nodes of the large-node stage.
    nodes: AtomicU64,
    most: [u64; 2],
    exceeded: AtomicBool,
}

impl Caps {
    /// With what the levels have made so far.
    pub fn new(config: &BuildConfig, triangles: u32, references: u64, nodes: u64) -> Caps {
        let caps = Caps {
            references: AtomicU64::new(0),
            nodes: AtomicU64::new(0),
            most: [config.reference_cap(triangles), config.node_cap(triangles)].map(u64::from),
            exceeded: AtomicBool::new(false),
        };
        caps.add(references, nodes);
        caps
    }

    fn add(&self, references: u64, nodes: u64) {
        let references = self.references.fetch_add(references, Relaxed) + references;
        let nodes = self.nodes.fetch_add(nodes, Relaxed) + nodes;
        // A node may emit up to 14 at once.
        if references > self.most[0] || nodes + 14 > self.most[1] {
            self.exceeded.store(true, Relaxed);
        }
    }

    /// Whether the build is void.
    pub fn exceeded(&self) -> bool {
        self.exceeded.load(Relaxed)
    }
}

/// What a subtree counts for the summary of the build.
#[derive(Clone, Copy, Debug, Default)]
pub struct Totals {
    /// Levels of the large-node stage.
    pub levels: u32,
    /// Small roots.
    pub small_roots: u32,
}

/// What tasks need on the way, kept between builds.
#[derive(Debug, Default)]
pub(crate) struct Workers {
    spare: Mutex<Vec<Box<Worker>>>,
}

impl Workers {
    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        self.spare.lock().map_or(0, |spare| spare.iter().map(|worker| worker.bytes()).sum())
    }

    /// Makes as many as there are threads, each with as much room as any of them needed before, so that the
    /// next build of the kind allocates nothing, whichever takes what.
    ///
    /// # Errors
    /// Less memory than that room.
    pub fn prepare(&mut self, threads: usize) -> Result<(), TryReserveError> {
        let Ok(spare) = self.spare.get_mut() else { return Ok(()) };
        spare.try_reserve_exact(threads.saturating_sub(spare.len()))?;
        while spare.len() < threads {
            spare.push(Worker::new()?);
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

    fn take(&self) -> Result<Box<Worker>, TryReserveError> {
        // A poisoned lock means that another thread panicked; a new one serves.
        let spare = self.spare.lock().map_or(None, |mut spare| spare.pop());
        spare.map_or_else(Worker::new, Ok)
    }

    /// Keeps a worker; one that there is no room for is let go.
    fn give_back(&self, worker: Box<Worker>) {
        if let Ok(mut spare) = self.spare.lock()
            && spare.try_reserve(1).is_ok()
        {
            spare.push(worker);
        }
    }
}

/// What one task needs.
#[derive(Debug)]
struct Worker {
    columns: Columns,
    cut: Cut,
    root: Root,
    bins: NodeBins,
    /// References of a node that a plane did not separate.
    references: Vec<Reference>,
    stack: Vec<Next>,
}

impl Worker {
    /// One more, of which nothing is large that its box does not hold.
    fn new() -> Result<Box<Worker>, TryReserveError> {
        let mut stack = Vec::new();
        // A cut or a split each for every level.
        stack.try_reserve_exact(MAX_DEPTH as usize + 2)?;
        boxed(|| Worker {
            columns: Columns::default(),
            cut: Cut::new(),
            root: Root::new(),
            bins: NodeBins::EMPTY,
            references: Vec::new(),
            stack,
        })
    }

    fn bytes(&self) -> u64 {
        let listed = self.references.capacity() * size_of::<Reference>();
        let stack = self.stack.capacity() * size_of::<Next>();
        (size_of::<Worker>() + listed + stack) as u64 + self.columns.bytes()
    }
}

/// What all tasks read.
#[derive(Debug)]
pub(crate) struct Inputs<'a> {
    pub look: &'a Lookout<'a>,
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

/// Builds the subtree of every root. `subtrees` and `totals` hold an element for each.
///
/// # Errors
/// Less memory than that takes.
pub(crate) fn run<A: Arithmetic>(
    inputs: &Inputs<'_>,
    workers: &Workers,
    sizes: &mut [Extent],
    totals: &mut [Totals],
    subtrees: &mut [Subtrees],
) -> Result<(), TryReserveError> {
    let roots = inputs.roots.par_iter().zip(sizes).zip(totals).zip(subtrees);
    roots.with_max_len(1).try_for_each(|(((root, size), totals), out)| {
        out.clear();
        *totals = Totals::default();
        *size = Extent::default();
        if inputs.look.is_over() || inputs.caps.exceeded() {
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
        inputs.look.advance(u64::from(root.count));
        done
    })
}

/// [`one_root`], for the lanes of each set.
struct OneRoot<'a, A> {
    inputs: &'a Inputs<'a>,
    root: &'a SmallRoot,
    worker: &'a mut Worker,
    totals: &'a mut Totals,
    out: &'a mut Subtrees,
    arithmetic: PhantomData<A>,
}

impl<A: Arithmetic> Compiled for OneRoot<'_, A> {
    type Output = Result<(), TryReserveError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<(), TryReserveError> {
        let OneRoot { inputs, root, worker, totals, out, .. } = self;
        #[cfg(target_arch = "x86_64")]
        if S::AVX512 {
            return one_root::<A, Avx512>(inputs, root, worker, totals, out);
        }
        one_root::<A, Plain>(inputs, root, worker, totals, out)
    }
}

/// A node of a task's subtree: a range of the columns.
#[derive(Clone, Copy, Debug)]
struct Node {
    first: usize,
    count: usize,
    /// From this row on, and [`WIDTH`] rows behind its own, there is nothing that is needed.
    free: usize,
    cell: Aabb,
    depth: u32,
    /// Levels of the large-node stage before its own.
    level: u32,
    /// Whether the plane that made it separated nothing.
    inseparable: bool,
}

/// What comes next in preorder.
#[derive(Clone, Copy, Debug)]
enum Next {
    /// The right child of the interior node `parent`, whose rows stand at `from`.
    Right { node: Node, from: usize, parent: usize },
    /// An empty leaf, the right child of the interior node `parent`.
    Empty { parent: usize },
}

/// One task under way.
struct Task<'a> {
    inputs: &'a Inputs<'a>,
    costs: Costs,
    worker: &'a mut Worker,
    totals: &'a mut Totals,
    out: &'a mut Subtrees,
}

/// Builds the subtree of one root.
#[cfg_attr(not(unoptimised), inline(always))]
fn one_root<A: Arithmetic, L: Lanes>(
    inputs: &Inputs<'_>,
    root: &SmallRoot,
    worker: &mut Worker,
    totals: &mut Totals,
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
    let costs = Costs::of(inputs.config);
    let node = Node {
        first: 0,
        count,
        free: count + WIDTH,
        cell: root.cell(),
        depth: root.depth,
        level,
        inseparable: false,
    };
    Task { inputs, costs, worker, totals, out }.subtree::<A, L>(node)
}

impl Task<'_> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn subtree<A: Arithmetic, L: Lanes>(&mut self, root: Node) -> Result<(), TryReserveError> {
        // References that splits added, and nodes, since the caps were last told.
        let mut untold = [0u64; 2];
        self.worker.stack.clear();
        let mut node = root;
        loop {
            if node.count > self.inputs.config.small_node_limit as usize {
                if self.inputs.look.worked(2 * node.count as u64) {
                    return Ok(());
                }
                self.totals.levels = self.totals.levels.max(node.level + 1);
                let left = self.large::<A, L>(&node, &mut untold)?;
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
                self.inputs.look.worked(256);
                let Worker { root, columns, .. } = &mut *self.worker;
                root.load_rows(columns, node.first, node.count);
                root.build::<A, L>(&self.costs, &node.cell, node.depth, [0, 0], self.out)?;
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
                        // What stood there is done with: so a task needs little more room than its root.
                        self.worker.columns.move_down(from, node.count, node.first);
                        break node;
                    }
                }
            };
        }
    }

    /// A node of more than T references: its cuts, then a leaf, or a split, of which the left child comes next.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn large<A: Arithmetic, L: Lanes>(
        &mut self,
        node: &Node,
        untold: &mut [u64; 2],
    ) -> Result<Option<Node>, TryReserveError> {
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
        let Worker { columns, cut, .. } = &mut *self.worker;
        (cut.axis, cut.plane) = (axis, position);
        let triangles = self.inputs.config.clip.then_some(self.inputs.triangles);
        let (mut left, mut right) = (0, 0);
        for tile in (0..node.count).step_by(TILE) {
            let count = TILE.min(node.count - tile);
            let from = node.first + tile;
            cut.tile::<A, L>(columns, from, count, triangles);
            let to = [node.first + left, node.free + right];
            let [lefts, rights] = L::divide(columns, cut, from, count, to[0], to[1]);
            left += lefts;
            right += rights;
        }
        untold[0] += (left + right).saturating_sub(node.count) as u64;
        untold[1] += 2;
        let parent = self.interior(axis, position)?;
        let (mut left_cell, mut right_cell) = (cell, cell);
        left_cell.hi[axis] = position;
        right_cell.lo[axis] = position;
        let child = Node {
            first: node.first,
            count: left,
            free: node.free + right + WIDTH,
            cell: left_cell,
            depth: depth + 1,
            level: node.level + 1,
            inseparable: left == node.count && right == node.count,
        };
        let other = Node { count: right, free: node.free, cell: right_cell, ..child };
        self.worker.stack.push(Next::Right { node: other, from: node.free, parent });
        Ok(Some(child))
    }

    /// What is done with a large node: up to the split what `split_large` and `split_binned` do.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn decide<A: Arithmetic>(&mut self, node: &Node) -> Result<Decision, TryReserveError> {
        let Inputs { look, config, planes, .. } = *self.inputs;
        let Worker { columns, references, bins, .. } = &mut *self.worker;
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
                split_large::decide::<A>(look, config, &large, &tight, references)
            }
            Planes::Binned => {
                let (decision, cell) = cut_empty_space::<A>(config, &large, &tight);
                let Some(cell) = cell else { return Ok(decision) };
                count_bins::<A>(config.bins, columns, node, &tight, bins);
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

    /// The node that is appended next is this one's right child.
    fn right_child(&mut self, parent: usize) {
        let right = self.out.nodes.len() as u32;
        let parent = &mut self.out.nodes[parent];
        let [split, tagged] = parent.words();
        *parent = KdNode::from_words([split, tagged | right << 2]);
    }
}

/// Counts by bins where the references of a node start and end.
#[cfg_attr(not(unoptimised), inline(always))]
fn count_bins<A: Arithmetic>(
    count: u32,
    columns: &Columns,
    node: &Node,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CpuExecutor;
    use crate::buffers::Buffers;
    use splitplane_core::arithmetic::{Hostile, Strict};
    use splitplane_core::config::Preset;
    use splitplane_core::kernel::Buffer;
    use splitplane_core::mesh::Mesh;
    use splitplane_core::schedule;
    use splitplane_test_support::scenes;

    /// Nodes, references, levels and small roots of a build, and whether it was void.
    fn built<A: Arithmetic>(
        mesh: &Mesh<'_>,
        config: BuildConfig,
        set: InstructionSet,
        cached: bool,
    ) -> (Vec<u8>, Vec<u8>, [u32; 2], bool) {
        let buffers = Buffers::default();
        let mut executor: CpuExecutor<'_, A> =
            CpuExecutor::new(*mesh, config, set, buffers, None).unwrap();
        if cached {
            executor = executor.cached();
        }
        schedule::build(&mut executor, config.preset.planes().unwrap()).unwrap();
        let Totals { levels, small_roots } = executor.totals();
        let live = |buffer| executor.live(buffer).unwrap().to_vec();
        let void = executor.is_void();
        (live(Buffer::Nodes), live(Buffer::LeafReferences), [levels, small_roots], void)
    }

    /// The tree of the levels, over every instruction set, for configurations of all kinds.
    #[test]
    fn tasks_build_what_the_levels_build() {
        let plain = BuildConfig::default();
        let scenes = [(5000, 0.2), (3000, 0.02), (1200, 1.0), (50, 1.0)];
        let scenes =
            scenes.map(|(count, size)| scenes::medley(count, size, count as u64).triangles());
        let mut same = scenes[1].clone();
        same.extend([scenes[1][7]; 1200]);
        for (scene, triangles) in scenes.iter().chain([&same]).enumerate() {
            let mesh = Mesh::soup(triangles).unwrap();
            for preset in [Preset::Fast, Preset::Balanced] {
                for config in [
                    plain,
                    BuildConfig { clip: false, ..plain },
                    BuildConfig { small_node_limit: 5, block_width: 3, empty_cutoff: 10, ..plain },
                    BuildConfig { max_depth: 9, bins: 7, ..plain },
                    BuildConfig { max_depth: 3, ..plain },
                ] {
                    let config = BuildConfig { preset, references_per_triangle: 1 << 10, ..config };
                    let config = BuildConfig { nodes_per_triangle: 1 << 10, ..config };
                    let portable = InstructionSet::Portable;
                    let expected = built::<Strict>(&mesh, config, portable, false);
                    for set in InstructionSet::available() {
                        let found = built::<Strict>(&mesh, config, set, true);
                        assert!(!found.3, "scene {scene}, {config:?}");
                        assert!(found == expected, "scene {scene}, {set:?}, {config:?}");
                    }
                }
                let config = BuildConfig { preset, ..plain };
                let (nodes, references, ..) =
                    built::<Strict>(&mesh, config, InstructionSet::Portable, false);
                let hostile = built::<Hostile>(&mesh, config, InstructionSet::Portable, true);
                assert!((hostile.0, hostile.1) == (nodes, references), "scene {scene}, hostile");
            }
        }
    }

    /// Where a cap binds, or might, the tasks' tree is void, and [`crate::CpuBackend`] builds that of the
    /// levels. With room to spare it is not.
    #[test]
    fn caps_make_it_void() {
        let scene = scenes::medley(9000, 0.3, 5);
        let mesh = scene.mesh();
        let mut voids = 0;
        for preset in [Preset::Fast, Preset::Balanced] {
            for (references_per_triangle, nodes_per_triangle) in
                [(1, 4), (2, 4), (3, 4), (8, 4), (1 << 10, 1), (1 << 10, 1 << 10)]
            {
                let config = BuildConfig {
                    preset,
                    references_per_triangle,
                    nodes_per_triangle,
                    small_node_limit: 8,
                    ..BuildConfig::default()
                };
                let set = InstructionSet::detect();
                let (nodes, references, [levels, small_roots], _) =
                    built::<Strict>(&mesh, config, set, false);
                let found = built::<Strict>(&mesh, config, set, true);
                voids += u32::from(found.3);
                assert!(found.3 || found.0 == nodes && found.1 == references);
                let options = config.into();
                let (tree, summary) = crate::CpuBackend::new().build_tree(&mesh, &options).unwrap();
                assert!(bytemuck::cast_slice::<_, u8>(&tree.nodes) == nodes);
                assert!(bytemuck::cast_slice::<_, u8>(&tree.references) == references);
                assert_eq!([summary.large_levels, summary.small_roots], [levels, small_roots]);
            }
        }
        // Twice the least references, twice the least nodes at least, and never all.
        assert!((4..12).contains(&voids), "{voids}");
    }

    /// However many references a task takes, each root is within its bounds.
    #[test]
    fn tasks_are_neither_too_small_nor_too_large() {
        assert_eq!(limit(0, 1), LEAST as u32);
        assert_eq!(limit(1 << 20, 4), 1 << 15);
        assert_eq!(limit(1 << 28, 1), MOST as u32);
        let caps = Caps::new(&BuildConfig::default(), 100, 0, 0);
        caps.add(4096 + 800, 0);
        assert!(!caps.exceeded());
        caps.add(1, 0);
        assert!(caps.exceeded());
    }
}
