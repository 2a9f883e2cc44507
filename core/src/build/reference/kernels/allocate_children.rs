use crate::aabb::Aabb;
use crate::config::{BuildConfig, CHUNK};
use crate::kernel::Counter;
use crate::layout::{Counters, Decision, LargeNode, Sides, SmallRoot, TopNode};

/// The lists that grow by a level. In addition to its live part, each has space for what
/// [`allocate_children_most`] says.
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

/// The most that a level adds to lists, whatever caps do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Most {
    /// Next nodes and small roots together.
    pub children: usize,
    /// Top nodes.
    pub top_nodes: usize,
}

/// The most that [`allocate_children`] adds to lists for nodes with these decisions.
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
    counters[Counter::NextChunks] = 0;
    let before = counters[Counter::SmallReferences] + counters[Counter::ActiveReferences];
    let mut alive = before;
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
    counters[Counter::Growth] = counters[Counter::Growth].saturating_add(alive - before);
}

/// Makes a split a transfer.
fn transfer(node: &LargeNode, decision: &mut Decision) {
    decision.axis = Decision::TRANSFER;
    decision.position = 0.0;
    decision.counts = Sides { left: node.count, right: 0 };
}

/// The additions of one active node to the lists.
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
            // No level has split it.
            let level = self.counters[Counter::Levels] - 1;
            decision.first = Sides { left: self.small(rest, node.count, level), right: 0 };
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

    /// Appends two top nodes, empty leaves for now. Returns the first one's place.
    fn pair(&mut self) -> u32 {
        let first = self.counters[Counter::TopNodes];
        let empty = TopNode { kind: TopNode::EMPTY, split: 0, left: 0, right: 0 };
        self.lists.top_nodes[first as usize..][..2].fill(empty);
        self.counters[Counter::TopNodes] += 2;
        first
    }

    /// Makes a part interior, and returns the parts left and right of the plane.
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

    /// Puts a child of a split on the list of its class. Returns the place of its first reference.
    fn child(&mut self, part: Part, count: u32, side: u32, inseparable: bool) -> u32 {
        if count <= self.config.small_node_limit() {
            return self.small(part, count, self.counters[Counter::Levels]);
        }
        let first = self.counters[Counter::NextReferences];
        self.counters[Counter::NextReferences] += count;
        let place = self.counters[Counter::NextNodes];
        self.counters[Counter::NextNodes] += 1;
        let first_chunk = self.counters[Counter::NextChunks];
        self.counters[Counter::NextChunks] += count.div_ceil(CHUNK);
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
            first_chunk,
            padding: 0,
        };
        first
    }

    /// Puts a part on the small list, unless it is empty. Returns the place of its first reference.
    fn small(&mut self, part: Part, count: u32, level: u32) -> u32 {
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
            level,
            padding: 0,
        };
        first
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    /// A level of nodes of one triangle's configuration, and lists with space for it.
    struct Level<const N: usize> {
        config: BuildConfig,
        nodes: [LargeNode; N],
        decisions: [Decision; N],
        next: [LargeNode; 8],
        small: [SmallRoot; 8],
        top: [TopNode; 32],
        counters: Counters,
    }

    impl<const N: usize> Level<N> {
        /// Nodes of 100 references each, whose splits send this many to each side.
        fn new(splits: [[u32; 2]; N]) -> Level<N> {
            let cell = Aabb { lo: [0.0; 3], hi: [8.0; 3] };
            let mut counters = Counters::default();
            counters[Counter::ActiveNodes] = N as u32;
            counters[Counter::ActiveReferences] = 100 * N as u32;
            counters[Counter::TopNodes] = N as u32;
            Level {
                config: BuildConfig::default().with_stages(|stages| stages.small_node_limit = 10),
                nodes: core::array::from_fn(|i| LargeNode {
                    lo: cell.lo,
                    hi: cell.hi,
                    first: 100 * i as u32,
                    count: 100,
                    node: i as u32,
                    first_chunk: i as u32,
                    ..LargeNode::zeroed()
                }),
                decisions: splits.map(|[left, right]| Decision {
                    axis: 1,
                    position: 2.0,
                    counts: Sides { left, right },
                    ..Decision::zeroed()
                }),
                next: [LargeNode::zeroed(); 8],
                small: [SmallRoot::zeroed(); 8],
                top: [TopNode::zeroed(); 32],
                counters,
            }
        }

        fn run(&mut self) {
            let mut lists = Lists {
                next_nodes: &mut self.next,
                small_roots: &mut self.small,
                top_nodes: &mut self.top,
                level_starts: &mut [0],
            };
            let (nodes, decisions) = (&self.nodes, &mut self.decisions);
            allocate_children(&self.config, nodes, decisions, &mut lists, &mut self.counters);
        }
    }

    /// Children by their class: more than T, up to T, none.
    #[test]
    fn children_go_to_the_list_of_their_class() {
        let mut level = Level::new([[95, 5], [0, 100], [100, 100]]);
        level.run();
        let count = |counter| level.counters[counter];
        assert_eq!((count(Counter::NextNodes), count(Counter::NextReferences)), (4, 395));
        assert_eq!((count(Counter::SmallRoots), count(Counter::SmallReferences)), (1, 5));
        assert_eq!(count(Counter::NextChunks), 4);
        assert_eq!((count(Counter::TopNodes), count(Counter::Levels)), (9, 1));
        let firsts = level.decisions.map(|decision| (decision.first.left, decision.first.right));
        assert_eq!(firsts, [(0, 0), (5, 95), (195, 295)]);
        let kinds: [u32; 9] = core::array::from_fn(|i| level.top[i].kind);
        assert_eq!(kinds, [1, 1, 1, 4, 3, 4, 4, 4, 4]);
        let next = &level.next[..4];
        assert!(next.iter().zip([3, 6, 7, 8]).all(|(node, top)| node.node == top));
        assert!(next.iter().zip([0, 0, 1, 1]).all(|(node, flag)| node.inseparable == flag));
        assert!(next.iter().zip([0, 1, 0, 1]).all(|(node, side)| node.side == side));
        assert!(next.iter().zip(0..).all(|(node, chunk)| node.first_chunk == chunk));
        assert_eq!((level.small[0].lo, level.small[0].hi), ([0.0, 2.0, 0.0], [8.0; 3]));
    }

    /// Cuts make empty leaves, and the remaining node keeps the rest of the cell.
    #[test]
    fn cuts_come_before_the_split() {
        let mut level = Level::new([[100, 50]]);
        let decision = &mut level.decisions[0];
        // Off the lower end of x, then off the upper end of z.
        (decision.cut_count, decision.cut_sides) = (2, 0x50);
        (decision.cuts[0], decision.cuts[1]) = (3.0, 5.0);
        level.run();
        let kinds: [u32; 7] = core::array::from_fn(|i| level.top[i].kind);
        assert_eq!(kinds, [0, 4, 2, 4, 1, 4, 4], "children of the split are still empty");
        let children = |i: usize| (level.top[i].left, level.top[i].right);
        assert_eq!([children(0), children(2), children(4)], [(1, 2), (4, 3), (5, 6)]);
        let left = &level.next[0];
        assert_eq!((left.lo, left.hi, left.depth), ([3.0, 0.0, 0.0], [8.0, 2.0, 5.0], 3));
    }

    /// With a cap that the first split passes: the second one would fit alone, but the first still counts.
    #[test]
    fn a_split_that_was_refused_still_counts() {
        let mut level = Level::new([[100, 60], [100, 50], [60, 40]]);
        // No triangle: 4,096 references.
        level.counters[Counter::SmallReferences] = 4096 - 300 - 55;
        level.run();
        let axes = level.decisions.map(|decision| decision.axis);
        assert_eq!(axes, [Decision::TRANSFER; 3], "the third adds nothing, but is above the cap");
        assert_eq!(level.counters[Counter::SmallRoots], 3);
        let mut level = Level::new([[100, 55], [60, 40], [100, 1]]);
        level.counters[Counter::SmallReferences] = 4096 - 300 - 55;
        level.run();
        let axes = level.decisions.map(|decision| decision.axis);
        assert_eq!(axes, [1, 1, Decision::TRANSFER]);
    }

    /// A node that needs four top nodes does not fit, one after it that needs two does.
    #[test]
    fn the_cap_on_nodes_lets_smaller_ones_pass() {
        let mut level = Level::new([[50, 50], [50, 50]]);
        level.decisions[0].cut_count = 1;
        let mut top = [TopNode::zeroed(); 4096];
        level.counters[Counter::TopNodes] = 4094;
        let mut lists = Lists {
            next_nodes: &mut level.next,
            small_roots: &mut level.small,
            top_nodes: &mut top,
            level_starts: &mut [0],
        };
        let (config, nodes) = (&level.config, &level.nodes);
        let decisions = &mut level.decisions;
        allocate_children(config, nodes, decisions, &mut lists, &mut level.counters);
        let [first, second] = level.decisions;
        assert_eq!((first.axis, first.cut_count), (Decision::TRANSFER, 0));
        assert_eq!((second.axis, second.first_node), (1, 4094));
        assert_eq!(level.counters[Counter::TopNodes], 4096);
    }
}
