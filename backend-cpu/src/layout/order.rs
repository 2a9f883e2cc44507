//! In which order a node's children are met, for each octant of directions.

use crate::simd::MOST_LANES;

/// For each octant that is positive on z how many children are farther away than a child: a byte each.
///
/// The planes between the children say it: of two sides of a plane, all on the far one are farther than
/// all on the near one.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Order {
    farther: [u128; 4],
}

const _: () = assert!(MOST_LANES == size_of::<u128>());

/// A one in each byte from `start` to `end`.
fn ones(start: usize, end: usize) -> u128 {
    let all = u128::from_ne_bytes([1; MOST_LANES]);
    if start == end { 0 } else { all >> (8 * (MOST_LANES + start - end)) << (8 * start) }
}

impl Order {
    /// A plane on an axis has the children from `start` on to its left, those from `middle` to `end` to its
    /// right.
    pub(crate) fn separate(&mut self, axis: usize, start: usize, middle: usize, end: usize) {
        let left = ones(start, middle) * (end - middle) as u128;
        let right = ones(middle, end) * (middle - start) as u128;
        for (octant, farther) in self.farther.iter_mut().enumerate() {
            let backwards = axis < 2 && octant >> axis & 1 != 0;
            *farther += if backwards { right } else { left };
        }
    }

    /// There is no plane between the children from `start` to `end`: they come as a leaf's triangles do.
    pub(crate) fn in_a_row(&mut self, start: usize, end: usize) {
        for child in start..end {
            let farther = ones(child, child + 1) * (end - 1 - child) as u128;
            self.farther.iter_mut().for_each(|all| *all += farther);
        }
    }

    /// Writes the children from far to near, and then the places without a child.
    pub(crate) fn write(&self, octant: usize, count: usize, order: &mut [u8]) {
        for (place, to) in order.iter_mut().enumerate() {
            *to = place as u8;
        }
        for (child, farther) in self.farther[octant].to_le_bytes()[..count].iter().enumerate() {
            order[*farther as usize] = child as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use splitplane_test_support::random::Random;

    use super::*;

    /// Children in a plane's order, by recursion.
    fn far_to_near(cells: &[(usize, usize, usize, usize)], octant: usize, count: usize) -> Vec<u8> {
        // The plane between two children says which one is behind the other.
        let farther = |a: usize, b: usize| {
            let between = |&&(_, start, middle, end): &&(usize, usize, usize, usize)| {
                start <= a.min(b) && a.min(b) < middle && middle <= a.max(b) && a.max(b) < end
            };
            let (axis, ..) = cells.iter().find(between).expect("a plane between any two");
            let backwards = *axis < 2 && octant >> axis & 1 != 0;
            (a > b) != backwards
        };
        let mut children: Vec<usize> = (0..count).collect();
        children.sort_by(|&a, &b| match a == b {
            true => core::cmp::Ordering::Equal,
            false if farther(a, b) => core::cmp::Ordering::Less,
            false => core::cmp::Ordering::Greater,
        });
        children.into_iter().map(|child| child as u8).collect()
    }

    #[test]
    fn planes_order_children() {
        let mut random = Random::new(3);
        for round in 0..2_000 {
            let count = 1 + round % MOST_LANES;
            let (mut order, mut planes) = (Order::default(), Vec::new());
            let mut open = vec![(0, count)];
            while let Some((start, end)) = open.pop() {
                if end - start > 1 {
                    let (axis, middle) =
                        (random.below(3), start + 1 + random.below(end - start - 1));
                    order.separate(axis, start, middle, end);
                    planes.push((axis, start, middle, end));
                    open.extend([(start, middle), (middle, end)]);
                }
            }
            for octant in 0..4 {
                let mut bytes = [99; MOST_LANES];
                order.write(octant, count, &mut bytes);
                assert_eq!(bytes[..count], far_to_near(&planes, octant, count)[..]);
                assert!((count..MOST_LANES).all(|place| bytes[place] == place as u8));
            }
        }
        let mut order = Order::default();
        order.separate(0, 0, 1, 4);
        order.in_a_row(1, 4);
        let mut bytes = [0; 8];
        order.write(0, 4, &mut bytes);
        assert_eq!(bytes, [3, 2, 1, 0, 4, 5, 6, 7]);
    }
}
