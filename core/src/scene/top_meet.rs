//! The instances whose boxes interest somebody.

use super::top_tree::{INSTANCE, NONE, TopTree, WIDTH};
use super::top_walk::WIDEST_STACK;

impl TopTree {
    /// Shows all instances whose boxes are of interest: `visit` is given the name of an instance, and returns false where that is enough.
    ///
    /// # Errors
    /// Those of `visit`, which end the search.
    pub(crate) fn meeting<E>(
        &self,
        is_of_interest: impl Fn([[f64; 3]; 2]) -> bool,
        mut visit: impl FnMut(u32) -> Result<bool, E>,
    ) -> Result<(), E> {
        if self.nodes.is_empty() {
            return Ok(());
        }
        let mut stack = [0u32; WIDEST_STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let child = stack[top];
            if child & INSTANCE != 0 {
                if !visit(child & !INSTANCE)? {
                    return Ok(());
                }
                continue;
            }
            let node = &self.nodes[child as usize];
            for slot in (0..WIDTH).filter(|&slot| node.children[slot] != NONE) {
                let lo = [0, 1, 2].map(|axis| f64::from(node.lo[axis][slot]));
                let hi = [0, 1, 2].map(|axis| f64::from(node.hi[axis][slot]));
                if is_of_interest([lo, hi]) {
                    stack[top] = node.children[slot];
                    top += 1;
                }
            }
        }
        Ok(())
    }
}
