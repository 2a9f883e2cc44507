//! The format of wide nodes.
//!
//! For N lanes a node takes 8 N words: N lower bounds on x, on y, on z, as many upper bounds, N children,
//! and four times N bytes: the places of the children from far to near for rays whose direction is
//! positive on all axes, negative on x, on y, on x and y. Octants that are negative on z take the
//! order of the opposite octant backwards. Places without a child have bounds that no ray is within.
//!
//! A child is the number of a wide node, or a leaf: bit 31 set, and below it the unit of a block, or in the compact layout
//! the leaf's number among the tree's nodes. All bits set are no child but the end of a traversal's stack.

use splitplane_core::aabb::Aabb;

use super::order::Order;
use crate::simd::MOST_LANES;

/// Set in a child that is a leaf.
const LEAF_MARK: u32 = 1 << 31;
/// The sentinel at the bottom of a stack of children: the ray is done.
pub(crate) const DONE: u32 = u32::MAX;
/// Leaves that children can address, except for [`DONE`].
pub(crate) const MOST_LEAVES: usize = (1 << 31) - 1;

/// 64 bytes.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
pub(crate) struct CacheLine(pub [u32; 16]);

/// Cache lines of a node.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) const fn lines_of_node(lanes: usize) -> usize {
    lanes / 2
}

/// Bytes before the bounds on an axis, lower or upper.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) const fn bounds_offset(lanes: usize, axis: usize, upper: bool) -> usize {
    4 * lanes * if upper { axis + 3 } else { axis }
}

/// Bytes before the children.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) const fn children_offset(lanes: usize) -> usize {
    24 * lanes
}

/// Bytes before one of the four orders.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) const fn order_offset(lanes: usize, order: usize) -> usize {
    (28 + order) * lanes
}

/// A leaf as a child.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) const fn leaf_child(number: u32) -> u32 {
    LEAF_MARK | number
}

/// Whether a child is a leaf, as is [`DONE`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) const fn is_leaf(child: u32) -> bool {
    child & LEAF_MARK != 0
}

/// 1 for a leaf, 0 for a node: for code without branches.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) const fn leaf_bit(child: u32) -> usize {
    (child >> 31) as usize
}

/// 0 for a node, 1 for a leaf, 2 for [`DONE`]: for code without branches.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) const fn kind_of(child: u32) -> u64 {
    // Nodes stay below 2^31 with one more, leaves below 2^32, and the sentinel comes to that.
    (child as u64 + 1) >> 31
}

/// The number of a leaf.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) const fn leaf_number(child: u32) -> u32 {
    child & !LEAF_MARK
}

/// Writes a node: the boxes of its children, what they are (as many as there are lanes), and their orders.
pub(crate) fn write(
    lanes: usize,
    bounds: impl Iterator<Item = Aabb>,
    children: &[u32; MOST_LANES],
    (order, count): (&Order, usize),
    lines: &mut [CacheLine],
) {
    let n = lanes;
    let words: &mut [u32] = bytemuck::cast_slice_mut(lines);
    let (rows, rest) = words.split_at_mut(6 * n);
    let (lower, upper) = rows.split_at_mut(3 * n);
    lower.fill(f32::INFINITY.to_bits());
    upper.fill(f32::NEG_INFINITY.to_bits());
    for (place, bounds) in bounds.enumerate() {
        for axis in 0..3 {
            lower[axis * n + place] = bounds.lo[axis].to_bits();
            upper[axis * n + place] = bounds.hi[axis].to_bits();
        }
    }
    let (row, orders) = rest.split_at_mut(n);
    row.copy_from_slice(&children[..n]);
    let orders: &mut [u8] = bytemuck::cast_slice_mut(orders);
    for (octant, to) in orders.chunks_exact_mut(n).enumerate() {
        order.write(octant, count, to);
    }
}
