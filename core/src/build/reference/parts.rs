//! Mutable parts of one slice, for items of a grid that write side by side.

use core::ops::Range;

/// Hands out parts of a slice in ascending order.
///
/// Exclusive scans give every item of a grid a range of its own. The parts are disjoint, so items can
/// write them at the same time.
#[derive(Debug)]
pub struct Parts<'a, T> {
    rest: &'a mut [T],
    /// Where `rest` begins in the slice.
    start: usize,
}

impl<'a, T> Parts<'a, T> {
    /// A whole slice, whose parts will be handed out.
    pub fn new(slice: &'a mut [T]) -> Parts<'a, T> {
        Parts { rest: slice, start: 0 }
    }

    /// The elements of `range`, which is in terms of the whole slice. Elements before it can no
    /// longer be handed out. An empty range is no part, and may lie anywhere.
    ///
    /// # Panics
    /// If `range` begins before the end of an earlier one, or ends beyond the slice.
    pub fn take(&mut self, range: Range<usize>) -> &'a mut [T] {
        if range.is_empty() {
            return &mut [];
        }
        assert!(self.start <= range.start, "parts are handed out in ascending order");
        let rest = core::mem::take(&mut self.rest);
        let (part, rest) = rest[range.start - self.start..].split_at_mut(range.len());
        (self.rest, self.start) = (rest, range.end);
        part
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_lie_where_the_ranges_say() {
        let mut slice: [u32; 8] = core::array::from_fn(|i| i as u32);
        let mut parts = Parts::new(&mut slice);
        let first = parts.take(1..3);
        let nothing = parts.take(0..0);
        let second = parts.take(5..8);
        assert_eq!((&*first, &*nothing, &*second), (&[1, 2][..], &[][..], &[5, 6, 7][..]));
        first[1] = 20;
        assert_eq!(slice[2], 20);
    }

    #[test]
    #[should_panic(expected = "ascending")]
    fn no_element_is_handed_out_twice() {
        let mut slice = [0; 8];
        let mut parts = Parts::new(&mut slice);
        parts.take(0..3);
        parts.take(2..4);
    }
}
