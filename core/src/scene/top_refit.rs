//! Instances that move: the nodes above them change, nothing else.

use super::top_tree::{NO_PARENT, Place, TopTree};
use super::world_box::WorldBox;

/// A tree whose cost has grown by more than this is built anew.
const GROWTH_MOST: f64 = 1.5;
/// And one whose cost has fallen by more than this: it was built around something far larger that is gone, beside which the cost of the rest cannot be
/// told.
const FALL_MOST: f64 = 32.0;

impl TopTree {
    /// Whether an instance has a place.
    pub fn has(&self, instance: u32) -> bool {
        self.places.get(instance as usize).is_some_and(|&place| place != Place::NOWHERE)
    }

    /// Gives an instance that has a place another box. Returns how many nodes changed.
    pub fn move_to(&mut self, instance: u32, to: &WorldBox) -> usize {
        let Some(&place) = self.places.get(instance as usize) else { return 0 };
        let (mut place, mut to, mut changed) = (place, *to, 0);
        while place.node != NO_PARENT {
            let Some(node) = self.nodes.get_mut(place.node as usize) else { break };
            let slot = place.slot as usize;
            let was = node.child_box(slot);
            if was == to {
                break;
            }
            node.set_child_box(slot, &to);
            self.cost += to.half_area() - was.half_area();
            changed += 1;
            to = node.whole_box();
            place = self.parents[place.node as usize];
        }
        changed
    }

    /// Whether a tree built anew would be worth it: whether rays cost half as much again as when it was built, or far less.
    pub fn is_worn(&self) -> bool {
        // Finite, even where boxes are as large as floats go.
        self.cost > self.cost_when_built * GROWTH_MOST
            || self.cost * FALL_MOST < self.cost_when_built
    }
}
