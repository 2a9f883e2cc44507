//! Compressed wide nodes: several levels of a finished kd-tree in one node of up to eight children, whose boxes are
//! quantised to eight bits a side (Ylitie, Karras and Laine 2017). For devices, where a ray waits for memory at every node.
//!
//! They are made from the tree and belong to no digest or file. Hits are the tree's, bit for bit: triangles are tested
//! by the same operations on the same corners, and every leaf that the tree's traversal visits for the sake of a hit is
//! within a box that this one visits. A box holds the part of its cells that the triangles' bounds reach into, widened
//! by the slack that the sizes of its triangles and of the scene need. On the device it is one quantum wider still,
//! which covers what the distance to a quantised side may err, and [`BOX_SLACK`] of the distance.

mod encode;
mod make;
mod plan;
mod walk;

use alloc::vec::Vec;

pub use encode::CompressedChild;

use bytemuck::{Pod, Zeroable};

/// Children of a node.
pub const CHILDREN: usize = 8;
/// Most references of a leaf among the children of a node; longer leaves become several.
pub const LEAF_MOST: u32 = 31;
/// What [`CompressedNode::counts`] says of a child that is a node.
pub const INNER_CHILD: u32 = 0x80;
/// Set in an entry of a stack that is a leaf; then come five bits of its length and 26 of its first reference.
pub const LEAF_ENTRY: u32 = 0x8000_0000;
/// Where the length of a leaf begins in an entry of a stack.
pub const LEAF_SHIFT: u32 = 26;
/// Entries of a stack in the memory of a workgroup. Rays that need more are traced through the tree itself.
pub const BOX_ENTRIES: u32 = 24;
/// Relative widening of the distance to a box. The distance to a side is computed in 11 roundings of 2^-24 at most where
/// a device errs as far as WGSL lets it, and `PLANE_SLACK` has 4 for the images of corners: this is twice the sum.
pub const BOX_SLACK: f32 = 1.907_348_6e-6; // 2^-19

/// A node: 80 bytes. Sides of boxes are `origin + q * 2^(exponent - 127)`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CompressedNode {
    /// Below all sides.
    pub origin: [f32; 3],
    /// The biased exponents of the quanta on x, y and z, a byte each from the lowest on.
    pub exponents: u32,
    /// The first of the children that are nodes; they follow one another.
    pub first_child: u32,
    /// The first reference of the first child that is a leaf; leaves follow one another.
    pub first_reference: u32,
    /// A byte for each child: 0 for none, [`INNER_CHILD`] for a node, else how many references a leaf has.
    pub counts: [u32; 2],
    /// The lower sides by axis, a byte for each child.
    pub lower: [[u32; 2]; 3],
    /// The upper sides.
    pub upper: [[u32; 2]; 3],
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
    pub const MOST_REFERENCES: u32 = 1 << LEAF_SHIFT;

    /// Bytes of nodes and references.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.nodes[..]) + size_of_val(&self.references[..])) as u64
    }
}

#[cfg(test)]
mod tests;
