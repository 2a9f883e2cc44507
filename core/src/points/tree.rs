//! The point tree.
//!
//! *Layout.* Points stand in blocks of [`BLOCK`]; the last block may have fewer. The tree over the blocks is implicit: the node of height h that begins at block
//! b holds the blocks from b to b + 2^h, as far as there are any, and its children divide them at b + 2^(h - 1). Each place between two blocks
//! divides one node, so node m - 1 is the one divided at block m: nodes stand in order, not in preorder, and have no pointers.
//!
//! *Order.* At a node points are ordered by (coordinate, index) along its axis; the left child has the first. In a block points stand by index.

#[doc(hidden)]
pub mod summary;

use crate::arithmetic::{Strict, ordered_bits};
use crate::points::distance::Unit;
use crate::tree::digest::{Digest, Xxh64};
use alloc::vec::Vec;
use summary::{Mark, Summary, node_of};

/// Points of a block.
pub const BLOCK: usize = 16;

/// How the axis of a node is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Axes {
    /// Along which the node's points reach farthest; the first of those that are equal.
    #[default]
    Widest,
    /// One after the other by level, the root by the first (Bentley 1975).
    Cycle,
}

/// A place where the tree is divided.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct PointNode {
    /// The least coordinate of the right child along the axis, in the tree's unit; no point of the left one has a greater.
    pub plane: f32,
    /// The axis, from 0.
    pub axis: u32,
}

/// A point in a builder: coordinates as [`ordered_bits`] of units, and the index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record<const N: usize> {
    /// The coordinates.
    pub bits: [u32; N],
    /// Index in the caller's points.
    pub point: u32,
}

impl<const N: usize> Record<N> {
    /// What orders points along an axis.
    #[inline(always)]
    pub fn key(&self, axis: usize) -> u64 {
        u64::from(self.bits[axis]) << 32 | u64::from(self.point)
    }

    /// The point of units with this index.
    #[inline]
    pub fn new(point: [f32; N], index: u32) -> Record<N> {
        let mut bits = [0; N];
        for axis in 0..N {
            bits[axis] = ordered_bits(point[axis]);
        }
        Record { bits, point: index }
    }

    /// The coordinates.
    #[inline]
    pub fn coordinates(&self) -> [f32; N] {
        let mut point = [0.0; N];
        for axis in 0..N {
            point[axis] = from_ordered(self.bits[axis]);
        }
        point
    }
}

/// The float of [`ordered_bits`].
#[inline]
pub fn from_ordered(bits: u32) -> f32 {
    f32::from_bits(if bits >> 31 == 1 { bits & 0x7fff_ffff } else { !bits })
}

/// What a build did with its input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct PointReport {
    /// Points given.
    pub points: u32,
    /// Points left out: a coordinate that is not finite.
    pub dropped: u32,
}

/// A kd-tree over points of `N` dimensions, 1 to 4.
#[derive(Clone, Debug, PartialEq)]
pub struct PointTree<const N: usize> {
    pub(crate) axes: Axes,
    pub(crate) unit: Unit,
    pub(crate) report: PointReport,
    pub(crate) nodes: Vec<PointNode>,
    pub(crate) points: Vec<[f32; N]>,
    pub(crate) indices: Vec<u32>,
    pub(crate) summary: Summary<N>,
}

impl<const N: usize> PointTree<N> {
    /// A tree of nodes, points and indices that a builder has made. `None` where their numbers do not fit one another, or an axis or an index
    /// does not exist; that planes divide points is not checked.
    pub fn from_parts(
        axes: Axes,
        unit: Unit,
        given: u32,
        nodes: Vec<PointNode>,
        points: Vec<[f32; N]>,
        indices: Vec<u32>,
    ) -> Option<PointTree<N>> {
        let dropped = given.checked_sub(u32::try_from(points.len()).ok()?)?;
        let fit = nodes.len() == points.len().div_ceil(BLOCK).saturating_sub(1)
            && indices.len() == points.len()
            && nodes.iter().all(|node| (node.axis as usize) < N)
            && indices.iter().all(|&index| index < given);
        let report = PointReport { points: given, dropped };
        fit.then(|| PointTree::new(axes, unit, report, nodes, points, indices))
    }

    pub(crate) fn new(
        axes: Axes,
        unit: Unit,
        report: PointReport,
        nodes: Vec<PointNode>,
        points: Vec<[f32; N]>,
        indices: Vec<u32>,
    ) -> PointTree<N> {
        let summary = Summary::of(&nodes, &points, &indices);
        PointTree { axes, unit, report, nodes, points, indices, summary }
    }

    /// What searches know of the subtree below each node, in the order of nodes. Empty where the system had no memory for it.
    #[doc(hidden)]
    pub fn marks(&self) -> &[Mark] {
        &self.summary.marks
    }

    /// The box around all points, in the tree's unit.
    #[doc(hidden)]
    pub fn bounds(&self) -> [[f32; N]; 2] {
        self.summary.bounds
    }

    /// An index that none of a subtree is below. The subtree is that of this height which begins at a block.
    #[doc(hidden)]
    #[inline]
    pub fn least_index(&self, block: usize, height: u32) -> u32 {
        match node_of(self.nodes.len(), block, height) {
            Some(node) => self.summary.marks.get(node).map_or(0, |mark| mark.least()),
            None => self.indices[block * BLOCK],
        }
    }

    /// Bytes of what searches know of the subtrees of so many points.
    #[doc(hidden)]
    pub const fn summary_bytes(points: usize) -> u64 {
        Summary::<N>::bytes(points.div_ceil(BLOCK).saturating_sub(1)) as u64
    }

    /// How axes were chosen.
    pub fn axes(&self) -> Axes {
        self.axes
    }

    /// The unit of [`PointTree::points`] and of planes.
    pub fn unit(&self) -> Unit {
        self.unit
    }

    /// What the build did with its input.
    pub fn report(&self) -> PointReport {
        self.report
    }

    /// The nodes, in order: see the module's text.
    pub fn nodes(&self) -> &[PointNode] {
        &self.nodes
    }

    /// The points that were kept, block by block, in the tree's unit.
    pub fn points(&self) -> &[[f32; N]] {
        &self.points
    }

    /// The index that each of [`PointTree::points`] has among the caller's.
    pub fn indices(&self) -> &[u32] {
        &self.indices
    }

    /// Points in the tree.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// True where no point was kept.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// A point as the tree measures it.
    pub fn in_units(&self, point: [f32; N]) -> [f32; N] {
        self.unit.point::<Strict, N>(point)
    }

    /// The height of the root: the least h so that 2^h blocks hold all points.
    pub fn height(&self) -> u32 {
        height(self.points.len())
    }

    /// XXH64 with seed 1 over little-endian words: dimensions, axes (0 widest, 1 cycle), points given, the unit's exponent, points kept,
    /// nodes, coordinates, indices.
    pub fn digest(&self) -> Digest {
        let mut hash = Xxh64::new(1);
        let axes = u32::from(self.axes == Axes::Cycle);
        let unit = self.unit.exponent().cast_unsigned();
        hash.write_words(&[N as u32, axes, self.report.points, unit, self.points.len() as u32]);
        for node in &self.nodes {
            hash.write_words(&[node.plane.to_bits(), node.axis]);
        }
        for point in &self.points {
            hash.write_words(&point.map(f32::to_bits));
        }
        hash.write_words(&self.indices);
        Digest(hash.finish())
    }
}

/// The height of a tree of so many points.
pub fn height(points: usize) -> u32 {
    points.div_ceil(BLOCK).next_power_of_two().trailing_zeros()
}
