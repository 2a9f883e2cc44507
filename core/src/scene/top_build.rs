//! Builds the tree over instances: a binary tree by binned SAH (Wald 2007), made eight children wide where that costs least (Ylitie,
//! Karras and Laine 2017, section 3).

mod binary;

use alloc::vec::Vec;

use super::top_tree::{INSTANCE, NO_PARENT, Place, TopNode, TopTree, WIDTH};
use super::world_box::WorldBox;
use binary::{Binary, Child, Item};

/// Levels of binary nodes at most, and so of nodes: splits by cost end where halving by number would no longer end by here. 2^28 instances
/// take 28 levels of halving.
pub(super) const LEVELS: usize = 42;

/// Bytes that a build over this many instances holds at once, of which the greatest name is below `names`.
pub fn top_tree_bytes(instances: usize, names: usize) -> u64 {
    // A node has at least two children, or is the root; of binary nodes, each that is divided has at least one item of its own.
    let nodes = instances.max(1);
    (nodes * (size_of::<TopNode>() + size_of::<Place>() + 2 * size_of::<Binary>())
        + names * size_of::<Place>()
        + instances * size_of::<Item>()) as u64
}

/// A node that has to be made: what is below it, and its place.
type Left = (u32, Place, usize);

impl TopTree {
    /// Builds the tree over these instances, by their names, which are below `names`. The same boxes give the same tree.
    /// `None` where the system has no memory for it.
    pub fn build(
        names: usize,
        boxes: impl ExactSizeIterator<Item = (u32, WorldBox)>,
    ) -> Option<TopTree> {
        let mut items = Vec::new();
        items.try_reserve_exact(boxes.len()).ok()?;
        items.extend(boxes.map(|(instance, world_box)| Item::new(instance, &world_box)));
        let mut tree = TopTree::default();
        tree.places.try_reserve_exact(names).ok()?;
        tree.places.resize(names, Place::NOWHERE);
        if items.is_empty() {
            return Some(tree);
        }
        let binary = binary::build(&mut items)?;
        // Depth first; a node takes its place before its children.
        let mut left: Vec<Left> = Vec::new();
        left.try_reserve(WIDTH * LEVELS).ok()?;
        left.push((0, Place { node: NO_PARENT, slot: 0 }, 1));
        while let Some((below, above, level)) = left.pop() {
            tree.nodes.try_reserve(1).ok()?;
            tree.parents.try_reserve(1).ok()?;
            left.try_reserve(WIDTH).ok()?;
            tree.depth = tree.depth.max(level);
            let node = tree.nodes.len() as u32;
            let mut own = TopNode::EMPTY;
            let mut slot = 0;
            binary::children(&binary, below, |child| {
                let place = Place { node, slot: slot as u32 };
                let world_box = match child {
                    Child::Instance(item) => {
                        let Item { instance, .. } = items[item as usize];
                        own.children[slot] = INSTANCE | instance;
                        tree.places[instance as usize] = place;
                        items[item as usize].world_box()
                    }
                    Child::Node(child) => {
                        // Set when the child is made.
                        own.children[slot] = 0;
                        left.push((child, place, level + 1));
                        binary[child as usize].bounds.world_box()
                    }
                };
                own.set_child_box(slot, &world_box);
                tree.cost += world_box.half_area();
                slot += 1;
            });
            if let Some(parent) = tree.nodes.get_mut(above.node as usize) {
                parent.children[above.slot as usize] = node;
            }
            tree.nodes.push(own);
            tree.parents.push(above);
        }
        tree.cost_when_built = tree.cost;
        Some(tree)
    }
}

#[cfg(test)]
mod tests;
