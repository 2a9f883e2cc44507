//! The instances whose boxes are near a point.

use super::top_tree::{INSTANCE, NONE, TopTree, WIDTH};
use super::top_walk::WIDEST_STACK;
use crate::query::closest_point::widened;

impl TopTree {
    /// Shows all instances whose boxes are within a distance of a point, nearest boxes first as far as a traversal by depth gets
    /// them so. `visit` is given the name of an instance, and returns the square of the distance within which
    /// boxes are still of interest; it may fall from call to call.
    ///
    /// Boxes are wider than what is in them ([`WorldBox`](super::WorldBox)) by far more than the roundings of `f64`.
    ///
    /// # Errors
    /// Those of `visit`, which end the search.
    pub(crate) fn near<E>(
        &self,
        point: [f64; 3],
        within: f64,
        mut visit: impl FnMut(u32) -> Result<f64, E>,
    ) -> Result<(), E> {
        if self.nodes.is_empty() {
            return Ok(());
        }
        let mut stack = [(0.0f64, 0u32); WIDEST_STACK];
        let (mut top, mut stop) = (1, widened(within, 0.0));
        while top > 0 {
            top -= 1;
            let (squared, child) = stack[top];
            if squared > stop {
                continue;
            }
            if child & INSTANCE != 0 {
                stop = widened(visit(child & !INSTANCE)?, 0.0);
                continue;
            }
            let node = &self.nodes[child as usize];
            let bottom = top;
            for slot in (0..WIDTH).filter(|&slot| node.children[slot] != NONE) {
                let mut squared = 0.0;
                for axis in 0..3 {
                    let below = f64::from(node.lo[axis][slot]) - point[axis];
                    let above = point[axis] - f64::from(node.hi[axis][slot]);
                    let outside = below.max(above).max(0.0);
                    squared += outside * outside;
                }
                if squared > stop {
                    continue;
                }
                // The farthest first; of equals, the first child is the next.
                let mut at = top;
                while at > bottom && stack[at - 1].0 <= squared {
                    stack[at] = stack[at - 1];
                    at -= 1;
                }
                stack[at] = (squared, node.children[slot]);
                top += 1;
            }
        }
        Ok(())
    }
}
