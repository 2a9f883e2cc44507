use bytemuck::Zeroable;

use super::classify_references::goes;
use super::range;
use super::scatter_references::cut;
use super::split_median::split_median_while;
use crate::aabb::Aabb;
use crate::arithmetic::Arithmetic;
use crate::build::middle::{ACTIVE_NODES, LEVEL_REFERENCES, NO_NODE, hand_over_limit};
use crate::config::BuildConfig;
use crate::layout::{Decision, LargeNode, MiddleRoot, Reference, Sides, SmallRoot, TopNode};
use crate::triangle::Triangle;

/// The memory in which a middle root is finished.
#[derive(Debug)]
pub struct MiddleRegion<'a> {
    /// References of a level and of the next: [`LEVEL_REFERENCES`] each.
    pub levels: [&'a mut [Reference]; 2],
    /// What is left: regions as [`Region`](crate::build::middle::Region) says. The references of the leaves, in their order.
    pub references: &'a mut [Reference],
    /// The tree: the root, then two nodes for each cut and each split, level by level.
    pub nodes: &'a mut [TopNode],
    /// Its leaves. The first reference counts from the start of the region.
    pub leaves: &'a mut [SmallRoot],
}

/// Finishes a node that the levels have handed over: splits it and its children by the rules of the large-node stage,
/// see [`super::split_median()`], [`super::classify_references()`] and [`super::scatter_references()`], until each has T
/// references or is transferred. Level by level, in the order of the nodes.
///
/// `right` of a leaf is its successor in preorder, [`NO_NODE`] for the last one.
///
/// Where references, nodes or leaves outgrow their regions, or a level has more than [`ACTIVE_NODES`] nodes or
/// [`LEVEL_REFERENCES`] references, only [`MiddleRoot::outgrown`] says so; it says so too of a root with more references than
/// [`hand_over_limit`] allows.
pub fn build_middle<A: Arithmetic>(
    config: &BuildConfig,
    root: usize,
    small_roots: &[SmallRoot],
    small_references: &[Reference],
    triangles: &[Triangle],
    region: &mut MiddleRegion<'_>,
) -> MiddleRoot {
    let root = &small_roots[root];
    let outgrown = MiddleRoot {
        node: root.node,
        first: root.first,
        count: root.count,
        outgrown: 1,
        ..MiddleRoot::zeroed()
    };
    if root.count > hand_over_limit(config) {
        return outgrown;
    }
    let own = &small_references[range(root.first, root.count)];
    let middle = MiddleRoot { levels: root.level, nodes: 1, outgrown: 0, ..outgrown };
    let mut stage = Stage { config, root, own, triangles, region, middle };
    match stage.run::<A>() {
        Some(()) => stage.middle,
        None => outgrown,
    }
}

/// A middle root that is being finished.
struct Stage<'a, 'b> {
    config: &'a BuildConfig,
    root: &'a SmallRoot,
    /// The references that were handed over, which the first level reads.
    own: &'a [Reference],
    triangles: &'a [Triangle],
    region: &'a mut MiddleRegion<'b>,
    middle: MiddleRoot,
}

/// Where the references of a level are.
#[derive(Clone, Copy)]
enum Source {
    /// Those that were handed over.
    Own,
    /// In one of the lists of [`MiddleRegion::levels`].
    List(usize),
}

impl Source {
    /// The list of the next level.
    fn next(self) -> usize {
        match self {
            Source::Own => 0,
            Source::List(list) => 1 - list,
        }
    }
}

/// The nodes of a level.
struct Level {
    nodes: [LargeNode; ACTIVE_NODES as usize],
    count: usize,
    /// References of all of them.
    references: u32,
}

/// What is left of a node, and its place in the tree.
#[derive(Clone, Copy)]
struct Part {
    node: u32,
    cell: Aabb,
    depth: u32,
}

impl Stage<'_, '_> {
    /// `None` where the region is outgrown.
    fn run<A: Arithmetic>(&mut self) -> Option<()> {
        let root = self.root;
        self.region.nodes[0] = leaf(TopNode::EMPTY, 0, NO_NODE);
        let whole = Part { node: 0, cell: root.cell(), depth: root.depth };
        if root.count <= self.config.small_node_limit() {
            let first = self.leaf(whole, root.count)?;
            self.region.references[range(first, root.count)].copy_from_slice(self.own);
            return Some(());
        }
        let mut level =
            Level { nodes: [LargeNode::zeroed(); ACTIVE_NODES as usize], count: 1, references: 0 };
        level.nodes[0] = large(whole, 0, root.count, false);
        let mut source = Source::Own;
        while level.count > 0 {
            self.middle.levels += 1;
            level = self.level::<A>(&level, source)?;
            source = Source::List(source.next());
        }
        Some(())
    }

    /// The references of a level.
    fn source(&self, source: Source) -> &[Reference] {
        match source {
            Source::Own => self.own,
            Source::List(list) => self.region.levels[list],
        }
    }

    /// Splits the nodes of a level. Returns the next one.
    fn level<A: Arithmetic>(&mut self, level: &Level, source: Source) -> Option<Level> {
        let mut decisions = [Decision::zeroed(); ACTIVE_NODES as usize];
        for (node, decision) in level.nodes[..level.count].iter().zip(&mut decisions) {
            *decision = self.decide::<A>(node, source);
        }
        // Leaves and next nodes get their places, then the references of both move there.
        let mut next =
            Level { nodes: [LargeNode::zeroed(); ACTIVE_NODES as usize], count: 0, references: 0 };
        for (node, decision) in level.nodes[..level.count].iter().zip(&mut decisions) {
            self.emit(node, decision, &mut next)?;
        }
        // Devices keep the nodes of both levels behind the leaves.
        let kept = self.middle.leaves as usize + 2 * level.count.max(next.count);
        if kept > self.region.leaves.len() {
            return None;
        }
        for (node, decision) in level.nodes[..level.count].iter().zip(&decisions) {
            self.scatter::<A>(node, decision, source);
        }
        Some(next)
    }

    /// The decision on a node, with the counts of its children.
    fn decide<A: Arithmetic>(&self, node: &LargeNode, source: Source) -> Decision {
        let source = self.source(source);
        let own = range(node.first, node.count);
        let bounds = |tight: Aabb, reference: &Reference| tight.union(&reference.bounds());
        let tight = source[own.clone()].iter().fold(Aabb::EMPTY, bounds);
        let mut decision = split_median_while::<A>(self.config, node, &tight, source, |_| true);
        if decision.axis != Decision::TRANSFER {
            decision.counts = Sides::default();
            for reference in &source[own] {
                let [left, right] = goes::<A>(self.config, reference, self.triangles, &decision);
                decision.counts.left += u32::from(left);
                decision.counts.right += u32::from(right);
            }
        }
        decision
    }

    /// Emits the nodes of one node's cuts and split.
    fn emit(&mut self, node: &LargeNode, decision: &mut Decision, next: &mut Level) -> Option<()> {
        let mut rest = Part { node: node.node, cell: node.cell(), depth: node.depth };
        for index in 0..decision.cut_count {
            let (side, position) = (decision.cut_side(index), decision.cuts[index as usize]);
            let empty = self.middle.nodes;
            let is_low = side.is_multiple_of(2);
            let children = if is_low { [empty, empty + 1] } else { [empty + 1, empty] };
            let parts = self.interior(rest, side / 2, position, children)?;
            rest = parts[usize::from(is_low)];
        }
        if decision.axis == Decision::TRANSFER {
            decision.first.left = self.leaf(rest, node.count)?;
            return Some(());
        }
        let Sides { left: lefts, right: rights } = decision.counts;
        self.middle.growth += (lefts + rights).saturating_sub(node.count);
        let left = self.middle.nodes;
        let children = [left, left + 1];
        let [left, right] =
            self.interior(rest, decision.axis as usize, decision.position, children)?;
        let inseparable = lefts == node.count && rights == node.count;
        decision.first = Sides {
            left: self.child(left, lefts, inseparable, next)?,
            right: self.child(right, rights, inseparable, next)?,
        };
        Some(())
    }

    /// Makes a leaf interior, with two empty leaves as children.
    fn interior(
        &mut self,
        part: Part,
        axis: usize,
        position: f32,
        [left, right]: [u32; 2],
    ) -> Option<[Part; 2]> {
        self.middle.nodes += 2;
        if self.middle.nodes as usize > self.region.nodes.len() {
            return None;
        }
        let nodes = &mut self.region.nodes;
        let successor = nodes[part.node as usize].right;
        nodes[left as usize] = leaf(TopNode::EMPTY, 0, right);
        nodes[right as usize] = leaf(TopNode::EMPTY, 0, successor);
        nodes[part.node as usize] =
            TopNode { kind: axis as u32, split: position.to_bits(), left, right };
        let mut parts = [left, right].map(|node| Part { node, depth: part.depth + 1, ..part });
        parts[0].cell.hi[axis] = position;
        parts[1].cell.lo[axis] = position;
        Some(parts)
    }

    /// Puts a child of a split among the next nodes or the leaves. Returns the place of its first reference.
    fn child(
        &mut self,
        part: Part,
        count: u32,
        inseparable: bool,
        next: &mut Level,
    ) -> Option<u32> {
        if count <= self.config.small_node_limit() {
            return self.leaf(part, count);
        }
        let first = next.references;
        if first + count > LEVEL_REFERENCES {
            return None;
        }
        *next.nodes.get_mut(next.count)? = large(part, first, count, inseparable);
        next.count += 1;
        next.references += count;
        Some(first)
    }

    /// Makes a part a leaf. Returns the place of its first reference.
    fn leaf(&mut self, part: Part, count: u32) -> Option<u32> {
        if count == 0 {
            return Some(0);
        }
        let first = self.middle.references;
        let references = first + count;
        if references as usize > self.region.references.len() {
            return None;
        }
        let place = self.middle.leaves;
        *self.region.leaves.get_mut(place as usize)? = SmallRoot {
            lo: part.cell.lo,
            first,
            hi: part.cell.hi,
            count,
            node: self.root.node,
            depth: part.depth,
            level: self.root.level,
            padding: 0,
        };
        let successor = self.region.nodes[part.node as usize].right;
        self.region.nodes[part.node as usize] = leaf(TopNode::SMALL_ROOT, place, successor);
        self.middle.leaves += 1;
        self.middle.references = references;
        Some(first)
    }

    /// Moves the references of a node to its children.
    fn scatter<A: Arithmetic>(&mut self, node: &LargeNode, decision: &Decision, source: Source) {
        let Sides { left: lefts, right: rights } = decision.counts;
        let is_leaf = [lefts, rights].map(|count| {
            count <= self.config.small_node_limit() || decision.axis == Decision::TRANSFER
        });
        let mut places = [decision.first.left, decision.first.right].map(|first| first as usize);
        for index in range(node.first, node.count) {
            let reference = self.source(source)[index];
            if decision.axis == Decision::TRANSFER {
                self.region.references[places[0]] = reference;
                places[0] += 1;
                continue;
            }
            let goes = goes::<A>(self.config, &reference, self.triangles, decision);
            let parts = cut::<A>(self.config, &reference, self.triangles, decision);
            for side in 0..2 {
                if goes[side] {
                    let list = match is_leaf[side] {
                        true => &mut *self.region.references,
                        false => &mut *self.region.levels[source.next()],
                    };
                    list[places[side]] = parts[side];
                    places[side] += 1;
                }
            }
        }
    }
}

fn leaf(kind: u32, left: u32, successor: u32) -> TopNode {
    TopNode { kind, split: 0, left, right: successor }
}

/// A node of a level, whose references begin at `first` among those of the level.
fn large(part: Part, first: u32, count: u32, inseparable: bool) -> LargeNode {
    LargeNode {
        lo: part.cell.lo,
        first,
        hi: part.cell.hi,
        count,
        node: part.node,
        depth: part.depth,
        inseparable: u32::from(inseparable),
        ..LargeNode::zeroed()
    }
}
