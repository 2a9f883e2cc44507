//! Compressed wide nodes: several levels of a finished kd-tree in one node of up to eight children, whose boxes are
//! quantised to eight bits a side (Ylitie, Karras and Laine 2017). For devices, where a ray waits for memory at every node.
//!
//! They are made from the tree and belong to no digest or file. Hits are the tree's, bit for bit: triangles are tested
//! by the same operations on the same corners, and every leaf that the tree's traversal visits for the sake of a hit is
//! within a box that this one visits. A box holds the part of its cells that the triangles' bounds reach into, widened
//! by the slack that the sizes of its triangles and of the scene need. On the device it is one quantum wider still,
//! which covers what the distance to a quantised side may err but for a part of that distance, for which there is
//! [`BOX_FACTOR`].

//!
//! Which levels go together is chosen in one of two ways: [`CompressedNodes::new`] finds the least cost by surface area,
//! bottom up; [`CompressedNodes::greedy`] follows a rule top down that a device can follow as well.

mod encode;
mod make;
mod plan;
mod walk;

use alloc::vec::Vec;

pub use encode::CompressedChild;
pub(crate) use encode::{lower, upper};
pub(crate) use make::share;

use bytemuck::{Pod, Zeroable};

/// Children of a node.
pub const CHILDREN: usize = 8;
/// Most references of a leaf among the children of a node; longer leaves become several.
pub const LEAF_MOST: u32 = 31;
/// Bits of [`CompressedNode::first_reference`] below the number of children that are nodes.
pub const REFERENCE_BITS: u32 = 26;
/// Entries of a ray's stack on a device. Rays that need more are traced through the tree itself.
pub const BOX_ENTRIES: u32 = 16;
/// By this factor a ray leaves a box later than is computed. The distance to a side is computed in 11 roundings of 2^-24
/// at most where a device errs as far as WGSL lets it, and `PLANE_SLACK` has 4 for the images of corners: 2^-18 is twice
/// the sum, for entering and leaving together.
pub const BOX_FACTOR: f32 = 1.000_003_8; // 1 + 2^-18

/// A node: 80 bytes. Sides of boxes are `origin + q * 2^(exponent - 127)`, of the exponents of quanta. The children that
/// are nodes come first, then those that are leaves.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CompressedNode {
    /// Below all sides.
    pub origin: [f32; 3],
    /// The biased exponents of 2^15 quanta on x, y and z, a byte each from the lowest on: what a device multiplies by.
    pub exponents: u32,
    /// The first of the children that are nodes; they follow one another.
    pub first_child: u32,
    /// In the lowest [`REFERENCE_BITS`] bits, the first reference of the first child that is a leaf; leaves follow one
    /// another. Above, how many children are nodes.
    pub first_reference: u32,
    /// A byte for each child: 0 for a node; for a leaf, where its references end, counted from the first of all leaves; the
    /// last leaf's once more for places without a child.
    pub ends: [u32; 2],
    /// The sides of the first four children and of the others: the lower ones by axis and the upper ones, a byte for each
    /// child. Where there is none, 255 and 0.
    pub sides: [[[u32; 3]; 2]; 2],
}

/// A tree as compressed nodes; see [the module](self).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CompressedNodes {
    /// The nodes; the first is the root.
    pub nodes: Vec<CompressedNode>,
    /// Triangle indices, named by leaves.
    pub references: Vec<u32>,
}

impl CompressedNodes {
    /// Most references that leaves can name.
    pub const MOST_REFERENCES: u32 = 1 << REFERENCE_BITS;

    /// Bytes of nodes and references.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.nodes[..]) + size_of_val(&self.references[..])) as u64
    }
}

#[cfg(test)]
mod tests;
