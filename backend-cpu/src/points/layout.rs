//! What a search reads: blocks of points as structures of arrays, and boxes around them and around one another.
//!
//! Boxes stand sixteen to a wide node, which is four levels of the tree. Those of wide level 0 hold blocks, and so on up
//! to one node. The child with the number i of wide node j is number 16 j + i of the level below.

use std::collections::TryReserveError;

use splitplane_core::points::tree::{BLOCK, PointTree};

/// Children of a wide node, and points of a block.
pub(super) const WIDTH: usize = 16;
const _: () = assert!(WIDTH == BLOCK);

/// Most wide levels: 2^30 points are 2^26 blocks.
pub(super) const LEVELS: usize = 7;

/// Sixteen numbers, one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Line(pub [f32; WIDTH]);

#[derive(Debug)]
pub(super) struct PointLayout<const N: usize> {
    /// Points in all blocks; the last block may have places without one.
    pub points: usize,
    /// N lines of coordinates a block.
    pub coordinates: Vec<[Line; N]>,
    /// The points' indices; `u32::MAX` for places without one.
    pub indices: Vec<[u32; WIDTH]>,
    /// Wide levels, the one over the blocks first: lower and upper sides of children, an axis a line. None without points.
    pub levels: Vec<Vec<[[Line; 2]; N]>>,
}

/// A box without points: where everything else is less far.
fn nowhere<const N: usize>() -> [[Line; 2]; N] {
    [[Line([f32::INFINITY; WIDTH]), Line([f32::NEG_INFINITY; WIDTH])]; N]
}

/// The lesser of two numbers, of which none is no number: `f32::min` would ask.
#[inline(always)]
fn less(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The greater of two such numbers.
#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

impl<const N: usize> PointLayout<N> {
    pub(super) fn new(tree: &PointTree<N>) -> Result<PointLayout<N>, TryReserveError> {
        let blocks = tree.len().div_ceil(WIDTH);
        let mut coordinates = Vec::new();
        let mut indices = Vec::new();
        coordinates.try_reserve_exact(blocks)?;
        indices.try_reserve_exact(blocks)?;
        let mut levels: Vec<Vec<[[Line; 2]; N]>> = Vec::new();
        let mut below = blocks;
        while below > 0 {
            let nodes = below.div_ceil(WIDTH);
            let mut level = Vec::new();
            level.try_reserve_exact(nodes)?;
            level.resize(nodes, nowhere());
            levels.push(level);
            below = if nodes == 1 { 0 } else { nodes };
        }
        let chunks = tree.points().chunks(WIDTH).zip(tree.indices().chunks(WIDTH));
        for (block, (points, numbers)) in chunks.enumerate() {
            let mut lines = [Line([f32::INFINITY; WIDTH]); N];
            let mut own = [u32::MAX; WIDTH];
            own[..numbers.len()].copy_from_slice(numbers);
            for axis in 0..N {
                let [lower, upper] = &mut levels[0][block / WIDTH][axis];
                let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
                for (place, point) in points.iter().enumerate() {
                    lines[axis].0[place] = point[axis];
                    least = less(point[axis], least);
                    most = greater(point[axis], most);
                }
                lower.0[block % WIDTH] = least;
                upper.0[block % WIDTH] = most;
            }
            coordinates.push(lines);
            indices.push(own);
        }
        for level in 1..levels.len() {
            let (below, above) = levels.split_at_mut(level);
            for (node, children) in below[level - 1].iter().enumerate() {
                for axis in 0..N {
                    let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
                    for child in 0..WIDTH {
                        least = less(children[axis][0].0[child], least);
                        most = greater(children[axis][1].0[child], most);
                    }
                    let [lower, upper] = &mut above[0][node / WIDTH][axis];
                    lower.0[node % WIDTH] = least;
                    upper.0[node % WIDTH] = most;
                }
            }
        }
        Ok(PointLayout { points: tree.len(), coordinates, indices, levels })
    }

    /// Bytes of the layout of so many points.
    pub(super) fn bytes(points: usize) -> u64 {
        let blocks = points.div_ceil(WIDTH);
        let mut bytes = blocks * (size_of::<[Line; N]>() + size_of::<[u32; WIDTH]>());
        let mut below = blocks;
        while below > 0 {
            let nodes = below.div_ceil(WIDTH);
            bytes += nodes * size_of::<[[Line; 2]; N]>();
            below = if nodes == 1 { 0 } else { nodes };
        }
        bytes as u64
    }
}
