//! The rays under way by what they wait for.

use crate::layout::wide_node::{DONE, kind_of, leaf_bit};

/// Rays under way, at most 16.
pub(crate) const FLIGHT: usize = 16;

/// The lanes by what their rays wait for: one bit per lane, 16 bits for each [`Turn`]. In a
/// register: memory would have to be written and read back in every step.
#[derive(Clone, Copy)]
pub(crate) struct Queues(u64);

/// What a ray waits for.
#[derive(Clone, Copy)]
pub(crate) enum Turn {
    Node,
    Block,
    /// Another ray, or for this one another instance.
    Refill,
    /// To go into the instance that it has found.
    Enter,
}

impl Queues {
    /// All lanes wait for a ray.
    pub(crate) const IDLE: Queues = Queues(0xffff << (16 * Turn::Refill as u32));

    /// Whether no lane waits for anything.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn is_empty(&self) -> bool {
        self.0 == 0
    }

    /// Puts a lane into the queue that its child calls for, without a branch, since no predictor could get it right.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn put(&mut self, lane: usize, child: u32) {
        const { assert!(DONE == u32::MAX && leaf_bit(DONE - 1) == 1 && FLIGHT == 16) };
        let queue = kind_of(child);
        self.0 |= 1 << (16 * queue + lane as u64);
    }

    /// Puts a lane into a queue.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn wait(&mut self, lane: usize, turn: Turn) {
        self.0 |= 1 << (16 * turn as u32 + lane as u32);
    }

    /// Empties a queue.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn take(&mut self, turn: Turn) -> Members {
        let shift = 16 * turn as u32;
        let lanes = self.0 >> shift & 0xffff;
        self.0 ^= lanes << shift;
        Members(lanes)
    }
}

/// Lanes as bits.
pub(crate) struct Members(u64);

impl Iterator for Members {
    type Item = usize;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn next(&mut self) -> Option<usize> {
        let lane = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (lane < FLIGHT).then_some(lane)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::MOST_NODES;
    use crate::layout::wide_node::{MOST_LEAVES, leaf_child};

    #[test]
    fn children_call_for_their_queue() {
        let last = leaf_child((MOST_LEAVES - 1) as u32);
        let cases = [
            (0, Turn::Node),
            (1, Turn::Node),
            (MOST_NODES, Turn::Node),
            (leaf_child(0), Turn::Block),
            (leaf_child(7), Turn::Block),
            (last, Turn::Block),
            (DONE, Turn::Refill),
        ];
        for lane in [0, 5, FLIGHT - 1] {
            for (child, turn) in cases {
                let mut queues = Queues(0);
                queues.put(lane, child);
                let there: Vec<usize> = queues.take(turn).collect();
                assert_eq!((there, queues.is_empty()), (vec![lane], true), "{child:#x}");
            }
        }
    }
}
