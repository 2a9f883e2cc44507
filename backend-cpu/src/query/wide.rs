//! Wide nodes: the tree with several levels in one node, made when queries get it.
//!
//! A wide node has up to 8 or 16 children, as many as a vector has lanes. Each stands for a subtree of
//! the kd-tree, a leaf's block of triangles, or a run of them, and has a box: the part of its cell that
//! its triangles reach into. A ray tests all boxes at once. The cells are apart, and the planes between
//! them say which come first for rays of an octant: so the order of the children is known for every
//! octant when the node is made, and nothing is sorted while a ray is under way. Empty leaves and the
//! planes beside them vanish in the boxes.
//!
//! Which levels go together is chosen as for wide bounding volume hierarchies (Ylitie, Karras and
//! Laine 2017, section 3.1): bottom up, the least sum of the nodes' surface areas for every number
//! of children that a subtree may stand for.

use std::collections::VecDeque;

use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::tree::KdTreeView;
use splitplane_core::triangle::Triangle;

use super::blocks::{self, WalkNode};
use super::record::Record;
use super::simd::MOST_LANES;
use crate::lookout::{self, Lookout};
use crate::scatter::Scatter;

/// Set in a child that is a block: the other bits are its first unit, or in the compact layout the leaf's
/// place among the tree's nodes. Otherwise they are a node.
pub(crate) const LEAF_MARK: u32 = 1 << 31;
/// Subtrees of more nodes are looked at by several tasks.
const LARGE: usize = 1 << 12;
/// Subtrees that are emitted by tasks of their own.
const TASKS: usize = 64;

/// 64 bytes.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
pub(crate) struct Line(pub [u32; 16]);

const EMPTY_LINE: Line = Line([0; 16]);

/// The nodes of a tree, the root first.
///
/// For N lanes a node takes 8 N words: N lower bounds on x, on y, on z, as many upper bounds, N children,
/// and four times N bytes: the places of the children from far to near for rays whose direction is
/// positive on all axes, negative on x, on y, on x and y. Octants that are negative on z take the
/// order of the opposite octant backwards. Places without a child have bounds that no ray is within.
#[derive(Debug)]
pub(crate) struct WideNodes {
    lanes: usize,
    lines: Vec<Line>,
    /// Most nodes on a way down.
    depth: usize,
}

/// What is to become a node, the node and place that it is a child at, and its level.
type Open = (Item, Option<(usize, usize)>, usize);

/// What nodes are made with, kept for the next tree.
#[derive(Debug, Default)]
pub(crate) struct WideScratch {
    /// Boxes of the tree's nodes, and how their subtrees are laid out.
    boxes: Vec<Aabb>,
    plans: Vec<Plan>,
    /// The nodes next to the root, what is left to tasks, what those make, and where it goes.
    top: Vec<Line>,
    open: VecDeque<Open>,
    parts: Vec<Part>,
    starts: Vec<usize>,
}

impl WideScratch {
    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let parts = self.parts.iter().map(|part| part.lines.capacity()).sum::<usize>();
        let lines = (parts + self.top.capacity()) * size_of::<Line>();
        let boxes = self.boxes.capacity() * size_of::<Aabb>();
        (lines + boxes + self.plans.capacity() * size_of::<Plan>()) as u64
    }
}

/// For each number of places that a subtree may take, one less than it: how many of them its left child
/// takes.
type Plan = [u8; MOST_LANES];
/// One place: the subtree is a node.
const NODE: u8 = 0;
/// One place fewer is no worse.
const FEWER: u8 = 0xff;
/// The left child is empty, the right one takes all places; and the other way round.
const RIGHT: u8 = 0xfe;
const LEFT: u8 = 0xfd;

/// Least costs of a subtree for each number of places.
type Costs = [f32; MOST_LANES];

/// What one task emits.
#[derive(Debug, Default)]
struct Part {
    lines: Vec<Line>,
    depth: usize,
}

/// A subtree or a run of a leaf's blocks, its cell and its box.
#[derive(Clone, Copy, Debug)]
struct Item {
    kind: Kind,
    cell: Aabb,
    bounds: Aabb,
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    /// An interior node of the tree.
    Subtree(u32),
    /// Blocks of a leaf that follow each other: the first one's unit and how many. Or a leaf of the tree, as
    /// one: its place among the nodes.
    Blocks(u32, u32),
}

/// The planes between the children of a node being made.
#[derive(Clone, Copy)]
enum Shape {
    Place(u8),
    /// Axis (3: no plane, any order), left and right.
    Split(u8, u8, u8),
}

/// What the leaves of the nodes given have.
#[derive(Clone, Copy)]
pub(crate) enum Content<'a> {
    /// Blocks, in these words, and the unit of one without triangles.
    Blocks(&'a [u32], u32),
    /// References, and the corners of all triangles: the tree's own leaves, which are children as they
    /// are, however many triangles they have.
    References(&'a [u32], &'a [Triangle]),
}

/// What emission reads.
#[derive(Clone, Copy)]
struct Source<'a> {
    lanes: usize,
    nodes: &'a [WalkNode],
    content: Content<'a>,
    boxes: &'a [Aabb],
    plans: &'a [Plan],
}

fn is_empty(bounds: &Aabb) -> bool {
    bounds.lo[0] > bounds.hi[0]
}

/// Half the surface area, in whatever unit; 0 for an empty box.
fn area(bounds: &Aabb) -> f32 {
    let [x, y, z] = [0, 1, 2].map(|k| (bounds.hi[k] - bounds.lo[k]).max(0.0));
    x * y + y * z + z * x
}

fn halves(cell: &Aabb, axis: usize, split: f32) -> (Aabb, Aabb) {
    let (mut left, mut right) = (*cell, *cell);
    (left.hi[axis], right.lo[axis]) = (split, split);
    (left, right)
}

/// Axis, plane and right child; `None` for a leaf.
fn interior(node: &WalkNode) -> Option<(usize, f32, u32)> {
    let axis = (node.tagged & 3) as usize;
    (axis < 3).then(|| (axis, f32::from_bits(node.word), node.tagged >> WalkNode::SHIFT))
}

fn box_of<'a>(records: impl Iterator<Item = Record<'a>>, cell: &Aabb) -> Aabb {
    let mut bounds = Aabb::EMPTY;
    let mut any = false;
    for record in records {
        any = true;
        for axis in 0..3 {
            let (lo, hi) = record.extent(axis);
            bounds.lo[axis] = bounds.lo[axis].min(lo);
            bounds.hi[axis] = bounds.hi[axis].max(hi);
        }
    }
    within(cell, &bounds, any)
}

/// The part of some triangles' bounds in their cell.
fn within(cell: &Aabb, bounds: &Aabb, any: bool) -> Aabb {
    let bounds = bounds.intersection(cell);
    // Whatever rounding did to a box: what the leaf has is not to be lost.
    let lost = any && (0..3).any(|axis| bounds.lo[axis] > bounds.hi[axis]);
    if lost { *cell } else { bounds }
}

impl WideNodes {
    /// No nodes yet, for vectors of so many lanes.
    pub fn new(lanes: usize) -> WideNodes {
        WideNodes { lanes, lines: Vec::new(), depth: 0 }
    }

    /// Children of a node.
    pub fn lanes(&self) -> usize {
        self.lanes
    }

    /// The nodes, one after the other.
    #[inline(always)]
    pub fn lines(&self) -> &[Line] {
        &self.lines
    }

    /// Entries that a stack needs: of every node on the way down all children but one, and as many
    /// more as are written without counting.
    pub fn stack(&self) -> usize {
        (self.depth + 2) * self.lanes + MOST_LANES
    }

    /// Bytes of the nodes.
    pub fn bytes(&self) -> u64 {
        size_of_val(&self.lines[..]) as u64
    }

    /// Most bytes that the nodes of a tree may take: nodes with two children.
    pub fn most_bytes(tree: &KdTreeView<'_>, lanes: usize) -> u64 {
        (tree.nodes.len() / 2 + 1) as u64 * 32 * lanes as u64
    }

    /// Bytes of what nodes are made with.
    pub fn scratch_bytes(tree: &KdTreeView<'_>) -> u64 {
        (tree.nodes.len() * (size_of::<Aabb>() + size_of::<Plan>())) as u64
    }

    /// Makes the nodes of a tree from its nodes and what their leaves have. Of no use when the lookout
    /// has ended it.
    pub fn fill(
        &mut self,
        tree: &KdTreeView<'_>,
        nodes: &[WalkNode],
        content: Content<'_>,
        look: &Lookout<'_>,
        scratch: &mut WideScratch,
    ) {
        let WideNodes { lanes, lines, depth } = self;
        let WideScratch { boxes, plans, top, open, parts, starts } = scratch;
        let lanes = *lanes;
        lines.clear();
        *depth = 0;
        if tree.bounds.is_empty() {
            return;
        }
        boxes.resize(nodes.len(), Aabb::EMPTY);
        plans.resize(nodes.len(), [NODE; MOST_LANES]);
        let planner = Planner { lanes, nodes, content, look };
        planner.plan(0, &tree.bounds, boxes, plans);
        if look.is_over() {
            return;
        }
        let source = Source { lanes, nodes, content, boxes, plans };
        // A tree without triangles has a root without children: rays within its bounds read it.
        let bounds = Aabb::EMPTY;
        let none = Item { kind: Kind::Blocks(0, 0), cell: tree.bounds, bounds };
        let root = source.item(0, &tree.bounds).unwrap_or(none);

        // The top: as many nodes as give work to all tasks.
        let size = source.node_lines();
        top.clear();
        open.clear();
        open.push_back((root, None, 1));
        while let Some((item, from, level)) = open.pop_front() {
            if from.is_some() && open.len() + 1 >= TASKS {
                open.push_front((item, from, level));
                break;
            }
            source.link(top, from);
            let node = top.len() / size;
            for (place, item) in source.node(&item, top) {
                open.push_back((item, Some((node, place)), level + 1));
            }
            *depth = level;
        }
        parts.resize_with(open.len().max(parts.len()), Part::default);
        let tasks = open.make_contiguous().par_iter().zip(&mut parts[..]);
        tasks.for_each(|((item, _, level), part)| {
            part.lines.clear();
            part.depth = 0;
            source.emit(item, *level, part, look);
        });
        if look.is_over() {
            return;
        }
        let parts = &parts[..open.len()];
        starts.clear();
        let mut end = top.len();
        for ((_, from, _), part) in open.iter().zip(parts) {
            if let Some((node, place)) = from {
                words_of(top)[node * size * 16 + 6 * lanes + place] = (end / size) as u32;
            }
            *depth = part.depth.max(*depth);
            starts.push(end);
            end += part.lines.len();
        }
        lookout::resize(look, lines, end, &EMPTY_LINE);
        if look.is_over() {
            return;
        }
        lines[..top.len()].copy_from_slice(top);
        let out = Scatter::new(lines);
        starts.par_iter().zip(parts).for_each(|(&start, part)| {
            // SAFETY: parts follow each other without overlap.
            let to = unsafe { out.part(start, part.lines.len()) };
            to.copy_from_slice(&part.lines);
            let first = (start / size) as u32;
            for node in words_of(to).chunks_exact_mut(size * 16) {
                for child in &mut node[6 * lanes..7 * lanes] {
                    // Nodes count from the part's first so far.
                    *child += if *child & LEAF_MARK == 0 { first } else { 0 };
                }
            }
        });
    }
}

/// The words of some lines.
fn words_of(lines: &mut [Line]) -> &mut [u32] {
    bytemuck::cast_slice_mut(lines)
}

/// What planning reads.
struct Planner<'a> {
    lanes: usize,
    nodes: &'a [WalkNode],
    content: Content<'a>,
    look: &'a Lookout<'a>,
}

impl Planner<'_> {
    /// The box of a leaf.
    fn leaf_box(&self, leaf: &WalkNode, cell: &Aabb) -> Aabb {
        let (references, triangles) = match self.content {
            Content::Blocks(words, _) => return box_of(blocks::leaf(words, leaf), cell),
            Content::References(references, triangles) => (references, triangles),
        };
        let references = leaf.references(references);
        let count = references.len() as u64;
        if self.look.worked(2 * count) {
            return Aabb::EMPTY;
        }
        let corners = |&triangle: &u32| Aabb::of_points(&triangles[triangle as usize]);
        let bounds = references.iter().map(corners).fold(Aabb::EMPTY, |all, one| all.union(&one));
        self.look.advance(count);
        within(cell, &bounds, count > 0)
    }

    /// Boxes and plans of a subtree, whose nodes follow each other from `node` on; its costs.
    fn plan(&self, node: u32, cell: &Aabb, boxes: &mut [Aabb], plans: &mut [Plan]) -> Costs {
        let mut costs = [0.0; MOST_LANES];
        let walk = &self.nodes[node as usize];
        let Some((axis, split, right)) = interior(walk) else {
            boxes[0] = self.leaf_box(walk, cell);
            // Where there are too few places for a leaf's blocks they get a node of their own.
            let count = match self.content {
                Content::Blocks(..) => (walk.tagged >> WalkNode::SHIFT) as usize,
                Content::References(..) => 1,
            };
            let area = area(&boxes[0]);
            for cost in costs.iter_mut().take(count.saturating_sub(1)) {
                *cost = area;
            }
            return costs;
        };
        let (left_cell, right_cell) = halves(cell, axis, split);
        let middle = (right - node) as usize;
        let (first_box, rest) = boxes.split_at_mut(1);
        let (left_boxes, right_boxes) = rest.split_at_mut(middle - 1);
        let (first_plan, rest) = plans.split_at_mut(1);
        let (left_plans, right_plans) = rest.split_at_mut(middle - 1);
        let nodes = right_boxes.len().min(left_boxes.len());
        let mut one = || self.plan(node + 1, &left_cell, left_boxes, left_plans);
        let mut other = || self.plan(right, &right_cell, right_boxes, right_plans);
        let (left, right) = if nodes > LARGE { rayon::join(one, other) } else { (one(), other()) };
        if self.look.worked(8) {
            return costs;
        }
        let (bounds, plan) = (&mut first_box[0], &mut first_plan[0]);
        if is_empty(&left_boxes[0]) {
            (*bounds, *plan) = (right_boxes[0], [RIGHT; MOST_LANES]);
            return right;
        }
        if is_empty(&right_boxes[0]) {
            (*bounds, *plan) = (left_boxes[0], [LEFT; MOST_LANES]);
            return left;
        }
        *bounds = left_boxes[0].union(&right_boxes[0]);
        for places in 2..=self.lanes {
            let (mut least, mut best) = (f32::INFINITY, 1);
            for to_left in 1..places {
                let cost = left[to_left - 1] + right[places - to_left - 1];
                if cost < least {
                    (least, best) = (cost, to_left as u8);
                }
            }
            (costs[places - 1], plan[places - 1]) = (least, best);
        }
        (costs[0], plan[0]) = (area(bounds) + costs[self.lanes - 1], NODE);
        for places in 2..=self.lanes {
            if costs[places - 2] <= costs[places - 1] {
                (costs[places - 1], plan[places - 1]) = (costs[places - 2], FEWER);
            }
        }
        costs
    }
}

/// A node being made.
struct Made {
    items: [Option<Item>; MOST_LANES],
    count: usize,
    shapes: [Shape; 2 * MOST_LANES],
    shape_count: usize,
}

impl Source<'_> {
    /// The words of the blocks.
    fn words(&self) -> &[u32] {
        match self.content {
            Content::Blocks(words, _) => words,
            Content::References(..) => &[],
        }
    }

    /// A child that nobody goes to; who did would lose nothing by it.
    fn nothing(&self) -> u32 {
        match self.content {
            Content::Blocks(_, unit) => LEAF_MARK | unit,
            // In preorder the last node is a leaf.
            Content::References(..) => LEAF_MARK | (self.nodes.len() - 1) as u32,
        }
    }

    /// Lines of a node.
    fn node_lines(&self) -> usize {
        self.lanes / 2
    }

    /// A subtree with its box; `None` for an empty one.
    fn item(&self, mut node: u32, cell: &Aabb) -> Option<Item> {
        let mut cell = *cell;
        loop {
            let bounds = self.boxes[node as usize];
            if is_empty(&bounds) {
                return None;
            }
            let walk = &self.nodes[node as usize];
            let Some((axis, split, right)) = interior(walk) else {
                let kind = match self.content {
                    Content::Blocks(..) => Kind::Blocks(walk.word, walk.tagged >> WalkNode::SHIFT),
                    Content::References(..) => Kind::Blocks(node, 1),
                };
                return Some(Item { kind, cell, bounds });
            };
            let (left_cell, right_cell) = halves(&cell, axis, split);
            match self.plans[node as usize][0] {
                RIGHT => (node, cell) = (right, right_cell),
                LEFT => (node, cell) = (node + 1, left_cell),
                _ => return Some(Item { kind: Kind::Subtree(node), cell, bounds }),
            }
        }
    }

    /// A run of blocks with its box.
    fn run(&self, unit: u32, count: u32, cell: &Aabb) -> Item {
        let node = WalkNode { word: unit, tagged: count << WalkNode::SHIFT };
        let bounds = box_of(blocks::leaf(self.words(), &node), cell);
        Item { kind: Kind::Blocks(unit, count), cell: *cell, bounds }
    }

    /// Names the next node as the child of one before it.
    fn link(&self, lines: &mut [Line], from: Option<(usize, usize)>) {
        let next = (lines.len() / self.node_lines()) as u32;
        if let Some((node, place)) = from {
            let at = node * self.node_lines() * 16 + 6 * self.lanes + place;
            words_of(lines)[at] = next;
        }
    }

    /// Distributes a subtree over some places of a node.
    fn spread(&self, item: Item, mut places: usize, shape: usize, whole: bool, made: &mut Made) {
        let split = match item.kind {
            _ if places == 1 && !whole => None,
            Kind::Blocks(_, 0 | 1) => None,
            Kind::Blocks(unit, count) => {
                let half = count / 2;
                let node = WalkNode { word: unit, tagged: half << WalkNode::SHIFT };
                let units = blocks::leaf(self.words(), &node).map(|record| record.units());
                let middle = unit + units.sum::<u32>();
                let left = self.run(unit, half, &item.cell);
                let right = self.run(middle, count - half, &item.cell);
                Some((3, left, right, places / 2))
            }
            Kind::Subtree(node) => {
                let plan = &self.plans[node as usize];
                while plan[places - 1] == FEWER && places > if whole { 2 } else { 1 } {
                    places -= 1;
                }
                match plan[places - 1] {
                    NODE => None,
                    to_left => {
                        let to_left = if to_left == FEWER { 1 } else { to_left as usize };
                        self.children(node, &item.cell)
                            .map(|(axis, left, right)| (axis, left, right, to_left))
                    }
                }
            }
        };
        let Some((axis, left, right, to_left)) = split else {
            made.shapes[shape] = Shape::Place(made.count as u8);
            made.items[made.count] = Some(item);
            made.count += 1;
            return;
        };
        let next = made.shape_count;
        made.shape_count += 2;
        made.shapes[shape] = Shape::Split(axis, next as u8, next as u8 + 1);
        self.spread(left, to_left, next, false, made);
        self.spread(right, places - to_left, next + 1, false, made);
    }

    /// Axis and children of a subtree of which neither is empty.
    fn children(&self, node: u32, cell: &Aabb) -> Option<(u8, Item, Item)> {
        let (axis, split, right) = interior(&self.nodes[node as usize])?;
        let (left_cell, right_cell) = halves(cell, axis, split);
        let left = self.item(node + 1, &left_cell)?;
        Some((axis as u8, left, self.item(right, &right_cell)?))
    }

    /// Writes the node of an item behind what is there. Gives the places and items of the children that
    /// need nodes.
    fn node(
        &self,
        item: &Item,
        out: &mut Vec<Line>,
    ) -> impl Iterator<Item = (usize, Item)> + use<> {
        let mut made = Made {
            items: [None; MOST_LANES],
            count: 0,
            shapes: [Shape::Place(0); 2 * MOST_LANES],
            shape_count: 1,
        };
        self.spread(*item, self.lanes, 0, true, &mut made);
        let (start, n) = (out.len(), self.lanes);
        out.resize(start + self.node_lines(), EMPTY_LINE);
        let words = words_of(&mut out[start..]);
        words[..3 * n].fill(f32::INFINITY.to_bits());
        words[3 * n..6 * n].fill(f32::NEG_INFINITY.to_bits());
        words[6 * n..7 * n].fill(self.nothing());
        for (place, item) in made.items.iter().enumerate() {
            let Some(item) = item else { continue };
            for axis in 0..3 {
                words[axis * n + place] = item.bounds.lo[axis].to_bits();
                words[(3 + axis) * n + place] = item.bounds.hi[axis].to_bits();
            }
            if let Kind::Blocks(_, 0) = item.kind {
                words[6 * n + place] = self.nothing();
            } else if let Kind::Blocks(unit, 1) = item.kind {
                words[6 * n + place] = LEAF_MARK | unit;
            }
        }
        let orders: &mut [u8] = bytemuck::cast_slice_mut(&mut words[7 * n..]);
        for (octant, order) in orders.chunks_exact_mut(n).enumerate() {
            order_children(&made, octant, order);
        }
        let needs = |item: &Item| !matches!(item.kind, Kind::Blocks(_, 0 | 1));
        made.items.into_iter().enumerate().filter_map(move |(place, item)| {
            item.filter(|item| needs(item)).map(|item| (place, item))
        })
    }

    /// Writes the nodes of a subtree, `level` levels below the root.
    fn emit(&self, item: &Item, level: usize, part: &mut Part, look: &Lookout<'_>) {
        part.depth = part.depth.max(level);
        let node = part.lines.len() / self.node_lines();
        if look.worked(8) {
            return;
        }
        for (place, item) in self.node(item, &mut part.lines) {
            self.link(&mut part.lines, Some((node, place)));
            self.emit(&item, level + 1, part, look);
        }
    }
}

/// The places of the children from far to near, for an octant whose direction is positive on z; then
/// the places without a child.
fn order_children(made: &Made, octant: usize, order: &mut [u8]) {
    let mut open = [0u8; 2 * MOST_LANES];
    let (mut top, mut end) = (1, 0);
    while top > 0 {
        top -= 1;
        match made.shapes[open[top] as usize] {
            Shape::Place(place) => {
                order[end] = place;
                end += 1;
            }
            Shape::Split(axis, left, right) => {
                let backwards = axis < 2 && octant >> axis & 1 != 0;
                // The far one comes off first.
                (open[top], open[top + 1]) = if backwards { (right, left) } else { (left, right) };
                top += 2;
            }
        }
    }
    for (place, to) in order.iter_mut().enumerate().skip(end) {
        *to = place as u8;
    }
}
