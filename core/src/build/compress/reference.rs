//! The kernels that make compressed nodes, stated serially: the specification of a device's.

use alloc::vec::Vec;
use core::convert::Infallible;
use core::mem;

use super::root;
use crate::aabb::Aabb;
use crate::arithmetic::{Arithmetic, Strict};
use crate::build::lockstep::Inspect;
use crate::build::schedule::Executor;
use crate::kernel::{CompressBuffer, CompressCounter, CompressKernel, NodeCompressor};
use crate::layout::{Compress, CompressCounters, Part};
use crate::query::compressed::{
    CHILDREN, CompressedNode, CompressedNodes, LEAF_MOST, lower, share, upper,
};
use crate::query::traverse::Triangles;
use crate::tree::KdTreeView;
use crate::tree::node::NodeKind;

/// Runs the kernels one part after the other.
#[derive(Debug)]
pub struct Reference<'a, T: ?Sized> {
    tree: KdTreeView<'a>,
    triangles: &'a T,
    inputs: Compress,
    counters: CompressCounters,
    parts: Vec<Part>,
    children: Vec<[Part; CHILDREN]>,
    child_counts: Vec<[u32; 2]>,
    places: Vec<[u32; 2]>,
    nodes: Vec<CompressedNode>,
    references: Vec<u32>,
}

impl<'a, T: Triangles + ?Sized> Reference<'a, T> {
    /// With the whole tree queued. The tree must be valid (see [`tree::validate`](crate::tree::validate)).
    pub fn new(tree: KdTreeView<'a>, triangles: &'a T, inputs: Compress) -> Reference<'a, T> {
        Reference {
            parts: Vec::from([root(&tree.bounds)]),
            tree,
            triangles,
            inputs,
            counters: CompressCounters::at_start(),
            children: Vec::new(),
            child_counts: Vec::new(),
            places: Vec::new(),
            nodes: Vec::new(),
            references: Vec::new(),
        }
    }

    /// What was made.
    pub fn into_nodes(self) -> CompressedNodes {
        CompressedNodes { nodes: self.nodes, references: self.references }
    }

    fn count(&self, counter: CompressCounter) -> usize {
        self.counters[counter] as usize
    }

    fn open_parts(&mut self) {
        let first = self.count(CompressCounter::Made);
        let batch = &self.parts[first..first + self.count(CompressCounter::Waiting)];
        self.children.clear();
        self.child_counts.clear();
        for part in batch {
            let (children, counts) = children_of(&self.tree, self.triangles, part);
            self.children.push(children);
            self.child_counts.push(counts);
        }
    }

    fn place_children(&mut self) {
        self.places.clear();
        let counters = &mut self.counters;
        let mut next = [counters[CompressCounter::Queued], counters[CompressCounter::References]];
        for counts in &self.child_counts {
            self.places.push(next);
            next = [next[0] + counts[0], next[1] + counts[1]];
        }
        let beyond = next[0].saturating_sub(self.inputs.part_room);
        // Once it is outgrown nothing more is done.
        counters[CompressCounter::Outgrown] = match counters[CompressCounter::Outgrown] {
            0 => beyond,
            before => before,
        };
        if counters[CompressCounter::Outgrown] > 0 {
            (counters[CompressCounter::Waiting], counters[CompressCounter::Active]) = (0, 0);
            self.places.clear();
            return;
        }
        let batch = mem::take(&mut counters[CompressCounter::Waiting]);
        counters[CompressCounter::Active] = batch;
        counters[CompressCounter::Made] += batch;
        counters[CompressCounter::Queued] = next[0];
        counters[CompressCounter::References] = next[1];
        counters[CompressCounter::Waiting] =
            self.inputs.batch_room.min(next[0] - counters[CompressCounter::Made]);
    }

    fn emit_nodes(&mut self) {
        for place in 0..self.count(CompressCounter::Active) {
            let [first_child, first_reference] = self.places[place];
            let children = &self.children[place];
            let inner = children.iter().take_while(|child| is_node(child)).count();
            let leaves = children[inner..].iter().take_while(|child| child.count > 0);
            let mut counts = [0; CHILDREN];
            let mut count = inner;
            for (leaf, own) in leaves.zip(&mut counts) {
                *own = leaf.count;
                count += 1;
                self.references.extend_from_slice(self.tree.leaf(leaf.first, leaf.count));
            }
            let mut node =
                CompressedNode { first_child, first_reference, ..CompressedNode::default() };
            let boxes = children.map(|child| widened(&child, self.inputs.slack));
            node.set_boxes(&boxes[..count]);
            node.set_children(inner, &counts[..count - inner]);
            self.nodes.push(node);
            self.parts.extend_from_slice(&children[..inner]);
        }
    }
}

impl<T: Triangles + ?Sized> Executor<NodeCompressor> for Reference<'_, T> {
    type Error = Infallible;

    fn dispatch(&mut self, kernel: CompressKernel) -> Result<(), Infallible> {
        match kernel {
            CompressKernel::OpenParts => self.open_parts(),
            CompressKernel::PlaceChildren => self.place_children(),
            CompressKernel::EmitNodes => self.emit_nodes(),
        }
        Ok(())
    }

    fn swap(&mut self, _: CompressBuffer, _: CompressBuffer) -> Result<(), Infallible> {
        Ok(())
    }

    fn pending(&mut self, counter: CompressCounter, _rounds: u32) -> Result<bool, Infallible> {
        Ok(self.counters[counter] > 0)
    }
}

impl<T: Triangles + ?Sized> Inspect<NodeCompressor> for Reference<'_, T> {
    fn live(&mut self, buffer: CompressBuffer) -> Result<Vec<u8>, Infallible> {
        let bytes: &[u8] = match buffer {
            CompressBuffer::Counters => bytemuck::bytes_of(&self.counters),
            CompressBuffer::Parts => bytemuck::cast_slice(&self.parts),
            CompressBuffer::Children => bytemuck::cast_slice(&self.children),
            CompressBuffer::ChildCounts => bytemuck::cast_slice(&self.child_counts),
            CompressBuffer::Places => bytemuck::cast_slice(&self.places),
            CompressBuffer::CompressedNodes => bytemuck::cast_slice(&self.nodes),
            CompressBuffer::CompressedReferences => bytemuck::cast_slice(&self.references),
            CompressBuffer::Nodes | CompressBuffer::LeafReferences | CompressBuffer::Triangles => {
                &[]
            }
        };
        Ok(bytes.to_vec())
    }
}

/// Whether a child becomes a node.
fn is_node(part: &Part) -> bool {
    part.count > LEAF_MOST
}

/// The children of the node that a part becomes, those that become nodes first, how many these are, and how many references the others have.
fn children_of(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    part: &Part,
) -> ([Part; CHILDREN], [u32; 2]) {
    let (opened, count) = opened(tree, part);
    let mut children = [Part::default(); CHILDREN];
    let mut counts = [0; 2];
    let mut next = 0;
    for nodes in [true, false] {
        // A foreign tree may have parts without references: they are no children.
        let own = |child: &&Part| is_node(child) == nodes && child.count > 0;
        for child in opened[..count].iter().filter(own) {
            children[next] = if nodes { *child } else { bounded(tree, triangles, child) };
            next += 1;
            counts[usize::from(!nodes)] += if nodes { 1 } else { child.count };
        }
    }
    (children, counts)
}

/// The highest part of a subtree with references on both sides of its plane, or its only leaf that has any.
fn resolved(tree: &KdTreeView<'_>, mut part: Part) -> Part {
    while part.count == Part::SUBTREE {
        let Some(node) = tree.nodes.get(part.first as usize) else {
            return Part { first: 0, count: 0, ..part };
        };
        match node.kind() {
            NodeKind::Leaf { first, count } => return Part { first, count, ..part },
            NodeKind::Interior { .. } => {
                let [low, high] = halves(tree, &part);
                match (is_empty(tree, low.first), is_empty(tree, high.first)) {
                    (true, _) => part = high,
                    (_, true) => part = low,
                    _ => return part,
                }
            }
        }
    }
    part
}

/// The two sides of a subtree's plane.
fn halves(tree: &KdTreeView<'_>, part: &Part) -> [Part; 2] {
    match tree.nodes[part.first as usize].kind() {
        NodeKind::Interior { axis, split, right } => {
            let mut low = Part { first: part.first + 1, ..*part };
            let mut high = Part { first: right, ..*part };
            (low.hi[axis.index()], high.lo[axis.index()]) = (split, split);
            [low, high]
        }
        NodeKind::Leaf { .. } => [*part; 2],
    }
}

/// Whether a node is an empty leaf. No subtree of our builders is without references as a whole; those of others may be.
fn is_empty(tree: &KdTreeView<'_>, index: u32) -> bool {
    matches!(tree.nodes[index as usize].kind(), NodeKind::Leaf { count: 0, .. })
}

/// The parts that become the children of the node that a part becomes.
fn opened(tree: &KdTreeView<'_>, part: &Part) -> ([Part; CHILDREN], usize) {
    let mut parts = [Part::default(); CHILDREN];
    let part = resolved(tree, *part);
    if part.count != Part::SUBTREE {
        let mut count = 0;
        if part.count > 0 {
            for (first, own) in share(part.first, part.count, CHILDREN as u32) {
                parts[count] = Part { first, count: own, ..part };
                count += 1;
            }
        }
        return (parts, count);
    }
    parts[0] = part;
    let mut count = 1;
    while count < CHILDREN {
        let mut widest: Option<(usize, f32)> = None;
        for (place, part) in parts[..count].iter().enumerate() {
            if part.count == Part::SUBTREE {
                let area = half_area(part);
                if widest.is_none_or(|(_, most)| area > most) {
                    widest = Some((place, area));
                }
            }
        }
        let Some((place, _)) = widest else { break };
        let [low, high] = halves(tree, &parts[place]);
        parts[place] = resolved(tree, low);
        parts[count] = resolved(tree, high);
        count += 1;
    }
    (parts, count)
}

/// Half the surface area of a cell, of halved extents.
fn half_area(part: &Part) -> f32 {
    let cell = Aabb { lo: part.lo, hi: part.hi };
    let [x, y, z] = [0, 1, 2].map(|axis| cell.half_extent(axis));
    let product = Strict::snapped_product;
    Strict::snapped_sum(Strict::snapped_sum(product(x, y), product(y, z)), product(z, x))
}

/// A leaf with the part of its cell that its triangles' bounds reach into.
fn bounded(tree: &KdTreeView<'_>, triangles: &(impl Triangles + ?Sized), leaf: &Part) -> Part {
    let cell = Aabb { lo: leaf.lo, hi: leaf.hi };
    let mut all = Aabb::EMPTY;
    for &name in tree.leaf(leaf.first, leaf.count) {
        all = all.union(&Aabb::of_points(&triangles.corners(name)));
    }
    let within = all.intersection(&cell);
    // Whatever rounding did to a cell: what the leaf has is not to be lost.
    let own = if within.is_empty() { cell } else { within };
    Part { lo: own.lo, hi: own.hi, ..*leaf }
}

/// The box of a child.
fn widened(part: &Part, slack: f32) -> Aabb {
    Aabb {
        lo: part.lo.map(|x| lower(Strict::snapped_difference(x, slack))),
        hi: part.hi.map(|x| upper(Strict::snapped_sum(x, slack))),
    }
}
