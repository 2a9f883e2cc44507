//! Where a geometry's triangles are within its bounds, roughly: for boxes of turned instances that are tighter than the box of a turned
//! box.

use super::transform::{SUM_ERROR, Transform};
use crate::aabb::{Aabb, max, min};
use crate::tree::KdTreeView;
use crate::tree::node::NodeKind;

/// Cells of an outline.
const CELLS: usize = 8;
/// Whether boxes are what triangles leave of cells. In browsers they are the cells: what a page loads is limited, and no hit depends on them.
const OF_TRIANGLES: bool = !cfg!(target_family = "wasm");

/// A few boxes that hold all triangles of a geometry: what of them is in cells of its tree that are not empty, the greatest divided first. By axis, their
/// middles and half their extents; where there are fewer, some stand there again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    middle: [[f64; CELLS]; 3],
    half: [[f64; CELLS]; 3],
    /// By axis, how far from 0 one of them reaches.
    reach: [f64; 3],
}

/// An outline's cells, and what of the triangles so far is in each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OutlineCells {
    /// Lower ends of the cells, by axis, and upper ones. Nothing is in those that are not there.
    lo: [[f32; CELLS]; 3],
    hi: [[f32; CELLS]; 3],
    held: [Aabb; CELLS],
}

/// A node with its cell.
#[derive(Clone, Copy)]
struct Cell {
    node: u32,
    bounds: Aabb,
    is_leaf: bool,
}

impl OutlineCells {
    /// The cells of a tree, without triangles.
    pub(crate) fn of(tree: &KdTreeView<'_>) -> OutlineCells {
        let none = [[f32::MAX; CELLS]; 3];
        let mut own = OutlineCells {
            lo: none,
            hi: none.map(|row| row.map(|x| -x)),
            held: [Aabb::EMPTY; CELLS],
        };
        for (place, bounds) in cells(tree).enumerate() {
            for axis in 0..3 {
                (own.lo[axis][place], own.hi[axis][place]) = (bounds.lo[axis], bounds.hi[axis]);
            }
            if !OF_TRIANGLES {
                own.held[place] = bounds;
            }
        }
        own
    }

    /// Takes a triangle of the tree, by its box.
    #[inline]
    pub(crate) fn add(&mut self, bounds: &Aabb) {
        if !OF_TRIANGLES {
            return;
        }
        // By vectors; hardly ever more than one cell.
        let mut meets = [u32::MAX; CELLS];
        for axis in 0..3 {
            let (lo, hi) = (bounds.lo[axis], bounds.hi[axis]);
            let (cell_lo, cell_hi) = (&self.lo[axis], &self.hi[axis]);
            for place in 0..CELLS {
                let below = u32::from(lo <= cell_hi[place]).wrapping_neg();
                meets[place] &= u32::from(hi >= cell_lo[place]).wrapping_neg() & below;
            }
        }
        let mut left = 0;
        for (place, meets) in meets.iter().enumerate() {
            left |= meets & 1 << place;
        }
        while left != 0 {
            let place = left.trailing_zeros() as usize % CELLS;
            left &= left - 1;
            let held = &mut self.held[place];
            for axis in 0..3 {
                let lo = max(bounds.lo[axis], self.lo[axis][place]);
                let hi = min(bounds.hi[axis], self.hi[axis][place]);
                held.lo[axis] = min(held.lo[axis], lo);
                held.hi[axis] = max(held.hi[axis], hi);
            }
        }
    }

    /// The outline of these triangles; `None` without any.
    pub(crate) fn outline(&self) -> Option<Outline> {
        let mut held = self.held.iter().filter(|held| !held.is_empty());
        let first = held.next()?;
        let mut outline =
            Outline { middle: [[0.0; CELLS]; 3], half: [[0.0; CELLS]; 3], reach: [0.0; 3] };
        for place in 0..CELLS {
            let own = if place == 0 { first } else { held.next().unwrap_or(first) };
            for axis in 0..3 {
                let (lo, hi) = (f64::from(own.lo[axis]), f64::from(own.hi[axis]));
                outline.middle[axis][place] = 0.5 * (lo + hi);
                outline.half[axis][place] = 0.5 * (hi - lo);
                outline.reach[axis] = outline.reach[axis].max(lo.abs()).max(hi.abs());
            }
        }
        Some(outline)
    }
}

/// The cells that an outline is of.
fn cells(tree: &KdTreeView<'_>) -> impl Iterator<Item = Aabb> {
    let cell = |node: u32, bounds: Aabb| match tree.nodes.get(node as usize)?.kind() {
        NodeKind::Leaf { count: 0, .. } => None,
        NodeKind::Leaf { .. } => Some(Cell { node, bounds, is_leaf: true }),
        NodeKind::Interior { .. } => Some(Cell { node, bounds, is_leaf: false }),
    };
    let mut cells = [cell(0, tree.bounds); CELLS];
    let mut count = 1;
    // Each step divides a cell, or finds that one half is empty: then it is smaller, and there may be as many steps as the tree has levels.
    while count < CELLS {
        let greatest = cells[..count]
            .iter()
            .enumerate()
            .filter_map(|(place, cell)| {
                cell.filter(|cell| !cell.is_leaf).map(|cell| (place, area(&cell.bounds), cell))
            })
            .reduce(|most, other| if other.1 > most.1 { other } else { most });
        let Some((place, _, Cell { node, bounds, .. })) = greatest else { break };
        let NodeKind::Interior { axis, split, right } = tree.nodes[node as usize].kind() else {
            break;
        };
        let (mut below, mut above) = (bounds, bounds);
        below.hi[axis.index()] = split;
        above.lo[axis.index()] = split;
        match (cell(node + 1, below), cell(right, above)) {
            (Some(one), Some(other)) => {
                (cells[place], cells[count]) = (Some(one), Some(other));
                count += 1;
            }
            (None, None) => break,
            (one, other) => cells[place] = one.or(other),
        }
    }
    cells.into_iter().take(count).flatten().map(|cell| cell.bounds)
}

impl Outline {
    /// A box around all boxes under a transform, rounded outwards.
    pub(super) fn transformed(&self, transform: &Transform) -> [[f64; 3]; 2] {
        let mut ends = [[0.0; 3]; 2];
        for (row, numbers) in transform.iter().enumerate() {
            let [a, b, c, d] = numbers.map(f64::from);
            let (mut lo, mut hi) = ([0.0; CELLS], [0.0; CELLS]);
            let [x, y, z] = &self.middle;
            let [p, q, r] = &self.half;
            let [u, v, w] = [a.abs(), b.abs(), c.abs()];
            for place in 0..CELLS {
                let middle = ((a * x[place] + b * y[place]) + c * z[place]) + d;
                let half = (u * p[place] + v * q[place]) + w * r[place];
                (lo[place], hi[place]) = (middle - half, middle + half);
            }
            // Roundings of middles, halves and sums, each of a part of this.
            let sizes = (u * self.reach[0] + v * self.reach[1]) + (w * self.reach[2] + d.abs());
            let slack = sizes * (4.0 * SUM_ERROR);
            ends[0][row] = least(lo) - slack;
            ends[1][row] = -least(hi.map(|x| -x)) + slack;
        }
        ends
    }
}

/// The least number. By halves, so that it is found by vectors.
fn least(mut numbers: [f64; CELLS]) -> f64 {
    let mut left = CELLS / 2;
    while left > 0 {
        let (first, second) = numbers.split_at_mut(left);
        for (one, other) in first.iter_mut().zip(second) {
            *one = if *other < *one { *other } else { *one };
        }
        left /= 2;
    }
    numbers[0]
}

/// Half the area.
fn area(bounds: &Aabb) -> f64 {
    let [x, y, z] = [0, 1, 2].map(|axis| f64::from(bounds.hi[axis]) - f64::from(bounds.lo[axis]));
    x * y + y * z + z * x
}

#[cfg(test)]
mod tests;
