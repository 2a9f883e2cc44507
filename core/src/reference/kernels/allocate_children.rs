use crate::aabb::Aabb;
use crate::config::{BuildConfig, CHUNK};
use crate::kernel::Counter;
use crate::layout::{Counters, Decision, LargeNode, Sides, SmallRoot, TopNode};

/// The lists that grow by a level. Each has room for what [`allocate_children_most`] says besides what is
/// live.
#[derive(Debug)]
pub struct Lists<'a> {
    /// The next list, written from its start.
    pub next_nodes: &'a mut [LargeNode],
    /// The small list.
    pub small_roots: &'a mut [SmallRoot],
    /// The top tree.
    pub top_nodes: &'a mut [TopNode],
    /// First top node that each level emits.
    pub level_starts: &'a mut [u32],
}

/// What a level adds to lists at most, whatever caps do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Most {
    /// Next nodes and small roots together.
    pub children: usize,
    /// Top nodes.
    pub top_nodes: usize,
}

/// What [`allocate_children`] adds to lists at most for nodes with these decisions.
pub fn allocate_children_most(decisions: &[Decision]) -> Most {
    let children = 2 * decisions.len();
    let cuts: usize = decisions.iter().map(|decision| 2 * decision.cut_count as usize).sum();
    Most { children, top_nodes: children + cuts }
}

/// Carries out the decisions about all active nodes, in their order.
///
/// The two caps of the configuration bind first. They are the only rules of the stage that look at
/// more than one node:
/// - A node that would bring the top tree above [`BuildConfig::node_cap`] keeps neither its cuts nor
///   its split. A node after it that needs fewer may still fit.
/// - A split that would bring the references alive above [`BuildConfig::reference_cap`] becomes a
///   transfer; cuts stay. Alive are the references of all small roots so far and of all active nodes, and
///   what every split adds up to and with this one. A split that was refused is still counted, so that one
///   large node does not let smaller ones pass.
///
/// Then each node emits two top nodes for each cut, an empty leaf and the rest, and two for its split. A
/// child goes to the next list where it has more than T references, else to the small list, or stays an
/// empty leaf where it has none. A node that is transferred goes to the small list whatever its size.
/// `Decisions` get the places of the children's references, and counters the new lengths of all lists.
pub fn allocate_children(
    config: &BuildConfig,
    active_nodes: &[LargeNode],
    decisions: &mut [Decision],
    lists: &mut Lists<'_>,
    counters: &mut Counters,
) {
    let triangles = counters[Counter::Triangles];
    let (reference_cap, node_cap) = (config.reference_cap(triangles), config.node_cap(triangles));
    lists.level_starts[counters[Counter::Levels] as usize] = counters[Counter::TopNodes];
    counters[Counter::Levels] += 1;
    counters[Counter::NextNodes] = 0;
    counters[Counter::NextReferences] = 0;
    let mut alive = counters[Counter::SmallReferences] + counters[Counter::ActiveReferences];
    for (node, decision) in active_nodes.iter().zip(decisions) {
        let emitted = 2 * decision.cut_count + 2;
        if u64::from(counters[Counter::TopNodes]) + u64::from(emitted) > u64::from(node_cap) {
            decision.cut_count = 0;
            transfer(node, decision);
        } else if decision.axis != Decision::TRANSFER {
            let children = decision.counts.left + decision.counts.right;
            alive = alive.saturating_add(children.saturating_sub(node.count));
            if alive > reference_cap {
                transfer(node, decision);
            }
        }
        decision.first_node = counters[Counter::TopNodes];
        Emission { config, node, lists, counters }.emit(decision);
    }
}

/// Makes a split a transfer.
fn transfer(node: &LargeNode, decision: &mut Decision) {
    decision.axis = Decision::TRANSFER;
    decision.position = 0.0;
    decision.counts = Sides { left: node.count, right: 0 };
}

/// What one active node adds to the lists.
struct Emission<'a, 'b> {
    config: &'a BuildConfig,
    node: &'a LargeNode,
    lists: &'a mut Lists<'b>,
    counters: &'a mut Counters,
}

/// A part of the node: its place in the top tree, its cell, and its depth.
#[derive(Clone, Copy)]
struct Part {
    top: u32,
    cell: Aabb,
    depth: u32,
}

impl Emission<'_, '_> {
    fn emit(&mut self, decision: &mut Decision) {
        let node = self.node;
        let mut rest = Part { top: node.node, cell: node.cell(), depth: node.depth };
        for index in 0..decision.cut_count {
            let (side, position) = (decision.cut_side(index), decision.cuts[index as usize]);
            // The empty leaf comes first, whichever side it is on.
            let empty = self.pair();
            let is_low = side.is_multiple_of(2);
            let children = if is_low { [empty, empty + 1] } else { [empty + 1, empty] };
            let parts = self.interior(rest, side / 2, position, children);
            rest = parts[usize::from(is_low)];
        }
        if decision.axis == Decision::TRANSFER {
            decision.first = Sides { left: self.small(rest, node.count), right: 0 };
            return;
        }
        let left = self.pair();
        let children = [left, left + 1];
        let [left, right] =
            self.interior(rest, decision.axis as usize, decision.position, children);
        let Sides { left: lefts, right: rights } = decision.counts;
        let inseparable = lefts == node.count && rights == node.count;
        decision.first = Sides {
            left: self.child(left, lefts, 0, inseparable),
            right: self.child(right, rights, 1, inseparable),
        };
    }

    /// Appends two top nodes, empty leaves until something else is known; gives the first one's place.
    fn pair(&mut self) -> u32 {
        let first = self.counters[Counter::TopNodes];
        let empty = TopNode { kind: TopNode::EMPTY, split: 0, left: 0, right: 0 };
        self.lists.top_nodes[first as usize..][..2].fill(empty);
        self.counters[Counter::TopNodes] += 2;
        first
    }

    /// Makes a part interior, and gives the parts left and right of the plane.
    fn interior(
        &mut self,
        part: Part,
        axis: usize,
        position: f32,
        children: [u32; 2],
    ) -> [Part; 2] {
        let [left, right] = children;
        self.lists.top_nodes[part.top as usize] =
            TopNode { kind: axis as u32, split: position.to_bits(), left, right };
        let mut parts = children.map(|top| Part { top, depth: part.depth + 1, ..part });
        parts[0].cell.hi[axis] = position;
        parts[1].cell.lo[axis] = position;
        parts
    }

    /// A child of a split on the list of its class. Gives the place of its first reference.
    fn child(&mut self, part: Part, count: u32, side: u32, inseparable: bool) -> u32 {
        if count <= self.config.small_node_limit {
            return self.small(part, count);
        }
        let first = self.counters[Counter::NextReferences];
        self.counters[Counter::NextReferences] += count;
        let place = self.counters[Counter::NextNodes];
        self.counters[Counter::NextNodes] += 1;
        self.lists.next_nodes[place as usize] = LargeNode {
            lo: part.cell.lo,
            first,
            hi: part.cell.hi,
            count,
            node: part.top,
            depth: part.depth,
            source: self.node.first_chunk,
            source_chunks: self.node.count.div_ceil(CHUNK),
            side,
            inseparable: u32::from(inseparable),
            first_chunk: 0,
            padding: 0,
        };
        first
    }

    /// A part on the small list, unless it is empty. Gives the place of its first reference.
    fn small(&mut self, part: Part, count: u32) -> u32 {
        let first = self.counters[Counter::SmallReferences];
        if count == 0 {
            return first;
        }
        self.counters[Counter::SmallReferences] += count;
        let place = self.counters[Counter::SmallRoots];
        self.counters[Counter::SmallRoots] += 1;
        self.lists.top_nodes[part.top as usize] =
            TopNode { kind: TopNode::SMALL_ROOT, split: 0, left: place, right: 0 };
        self.lists.small_roots[place as usize] = SmallRoot {
            lo: part.cell.lo,
            first,
            hi: part.cell.hi,
            count,
            node: part.top,
            depth: part.depth,
            padding: [0; 2],
        };
        first
    }
}
