//! What a search knows of a subtree before it enters it.
//!
//! *Ties.* Points at one distance tie, and the lowest index wins. A bound that equals the distance
//! that still counts does not pass a subtree over, so a search of points that coincide would visit
//! all of them. It compares the least index of the subtree too, and enters the child with the lower
//! one first where the bounds of both are equal.
//!
//! *One place.* Bounds by planes are lower than the distance of points that no plane encloses on
//! all sides. So a node says whether all its points are in one place: then the distance of one is
//! the distance of all. Coordinates below [`TINY`] count as 0 here. They cannot be told apart from
//! 0 by a distance: where `|q| <= 2^-65` the square of `q - p` is below 2^-126 and snapped to 0;
//! beyond, half the spacing of floats next to `q` is at least 2^-90, so `q - p` is rounded to `q`.
//!
//! *The box around all points* gives the gaps that a search begins with. Distances of a far query
//! are all equal, and so are its bounds then.

use super::{BLOCK, PointNode};
use alloc::vec::Vec;

/// Coordinates below this, 2^-90 units, count as 0 where points are compared.
pub const TINY: f32 = f32::from_bits((127 - 90) << 23);

/// What is known of a subtree, in a word: the axis of the node in the lowest two bits, then
/// [`Mark::ONE_PLACE`], then the least index, rounded down to a multiple of 8.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mark(pub u32);

impl Mark {
    /// The bit that is set where all points of the subtree are in one place.
    pub const ONE_PLACE: u32 = 4;
    /// The bits of the axis.
    pub const AXIS: u32 = 3;
    /// The bits of the least index.
    pub const LEAST: u32 = 0xffff_fff8;

    fn new(least: u32, is_one_place: bool) -> Mark {
        Mark(least & Mark::LEAST | if is_one_place { Mark::ONE_PLACE } else { 0 })
    }

    /// No index of the subtree is lower.
    pub fn least(self) -> u32 {
        self.0 & Mark::LEAST
    }

    /// Whether all points of the subtree are in one place.
    pub fn is_one_place(self) -> bool {
        self.0 & Mark::ONE_PLACE != 0
    }
}

/// The marks of all nodes, in the order of nodes, and the box around all points. It follows from
/// the tree and is no part of its digest.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Summary<const N: usize> {
    /// None where memory for them was refused: then searches are slower.
    pub(crate) marks: Vec<Mark>,
    pub(crate) bounds: [[f32; N]; 2],
}

impl<const N: usize> Summary<N> {
    /// Bytes of the summary of so many nodes.
    pub(crate) const fn bytes(nodes: usize) -> usize {
        nodes * size_of::<Mark>()
    }

    pub(crate) fn of(nodes: &[PointNode], points: &[[f32; N]], indices: &[u32]) -> Summary<N> {
        let mut marks = Vec::new();
        if marks.try_reserve_exact(nodes.len()).is_ok() {
            marks.resize(nodes.len(), Mark(0));
            mark_all(nodes, points, indices, &mut marks);
        }
        let side = |is_upper| {
            let mut side = [0.0; N];
            for (axis, side) in side.iter_mut().enumerate() {
                *side = farthest(nodes, points, &marks, axis, is_upper);
            }
            side
        };
        let bounds = if points.is_empty() { [[0.0; N]; 2] } else { [side(false), side(true)] };
        Summary { marks, bounds }
    }
}

/// The node that divides a subtree, if it has more than one block: places without a right child are
/// passed over.
#[inline]
pub(crate) fn node_of(nodes: usize, block: usize, mut height: u32) -> Option<usize> {
    while height > 0 {
        height -= 1;
        let right = block + (1 << height);
        if right <= nodes {
            return Some(right - 1);
        }
    }
    None
}

fn mark_all<const N: usize>(
    nodes: &[PointNode],
    points: &[[f32; N]],
    indices: &[u32],
    marks: &mut [Mark],
) {
    let blocks = nodes.len() + 1;
    let of_block = |block: usize| {
        let last = points.len().min((block + 1) * BLOCK);
        let own = &points[block * BLOCK..last];
        Mark::new(indices[block * BLOCK], own.iter().all(|point| coincide(point, &own[0])))
    };
    let mut height = 1;
    while 1 << (height - 1) < blocks {
        let mut block = 0;
        while block + (1 << (height - 1)) < blocks {
            let right = block + (1 << (height - 1));
            let [left_mark, right_mark] = [block, right].map(|child| {
                node_of(nodes.len(), child, height - 1)
                    .map_or_else(|| of_block(child), |node| marks[node])
            });
            let is_one_place = left_mark.is_one_place()
                && right_mark.is_one_place()
                && coincide(&points[block * BLOCK], &points[right * BLOCK]);
            let least = left_mark.least().min(right_mark.least());
            let Mark(mark) = Mark::new(least, is_one_place);
            marks[right - 1] = Mark(mark | nodes[right - 1].axis);
            block += 1 << height;
        }
        height += 1;
    }
}

fn coincide<const N: usize>(a: &[f32; N], b: &[f32; N]) -> bool {
    let place = |x: f32| if x.abs() < TINY { 0.0 } else { x };
    (0..N).all(|axis| place(a[axis]) == place(b[axis]))
}

/// The least or the greatest coordinate along an axis. Of nodes that divide this axis one child
/// decides.
fn farthest<const N: usize>(
    nodes: &[PointNode],
    points: &[[f32; N]],
    marks: &[Mark],
    axis: usize,
    is_upper: bool,
) -> f32 {
    let blocks = nodes.len() + 1;
    let height = blocks.next_power_of_two().trailing_zeros();
    let (mut stack, mut top) = ([(0, height); 32], 1);
    let mut farthest = points[0][axis];
    while top > 0 {
        top -= 1;
        let (mut block, mut height) = stack[top];
        let mut count = BLOCK;
        while height > 0 {
            height -= 1;
            let right = block + (1 << height);
            if right >= blocks {
                continue;
            }
            if marks.get(right - 1).is_some_and(|mark| mark.is_one_place()) {
                count = 1;
                break;
            }
            if nodes[right - 1].axis as usize != axis {
                stack[top] = (right, height);
                top += 1;
            } else if is_upper {
                block = right;
            }
        }
        let own = &points[block * BLOCK..points.len().min(block * BLOCK + count)];
        for point in own {
            let x = point[axis];
            farthest = if is_upper { farthest.max(x) } else { farthest.min(x) };
        }
    }
    farthest
}
