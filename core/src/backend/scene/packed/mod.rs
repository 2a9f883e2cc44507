//! A scene as a device holds it: the tree over instances, the instances, and the trees of all geometries in shared arrays.
//!
//! Devices bind few buffers, so what each instance needs of its geometry stands in its own record, and the geometries'
//! nodes, references and corners lie one behind the other: a node names its child, a leaf its references and a reference
//! its triangle by places in these arrays, so that a ray in an instance needs no other number than the place of a root.
//! A geometry that changes goes to a range of each array that is free ([`PackedPlaces`], [`PackedPiece`]), and the others stay where they are.
//! [`PackedScene::trace`] is the serial reference of the kernels that go through it.

mod free;
mod pack;
mod piece;
mod places;
mod sizes;
mod steps;
mod trace;

use alloc::vec::Vec;

use bytemuck::{Pod, Zeroable};

use crate::scene::{TOP_WIDTH, Transform};
use crate::tree::node::KdNode;
use crate::triangle::Triangle;

pub use piece::PackedPiece;
pub use places::PackedPlaces;
pub use sizes::{GeometryChange, PackedSizes, Unpackable};

/// A child of a packed node that every ray enters; the other bits are as in
/// [`TopNode::children`](crate::scene::TopNode::children).
pub const ALWAYS: u32 = 1 << 30;
/// Nodes of a packed tree over instances are fewer: a stack's entry is a node, and eight bits of its children.
pub const MOST_TOP_NODES: usize = 1 << 24;
/// Boxes with coordinates beyond this are entered by every ray, and rays from farther away enter every box: so no operation of
/// the test of a box overflows.
pub const BOX_COORDINATE_MOST: f32 = 1.099_511_6e12; // 2^40

/// A node of the tree over instances as a device has it: a [`TopNode`](crate::scene::TopNode) whose coordinates are all
/// within [`BOX_COORDINATE_MOST`]. 256 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct PackedTopNode {
    /// Lower ends of the children's boxes, by axis.
    pub lo: [[f32; TOP_WIDTH]; 3],
    /// Upper ends.
    pub hi: [[f32; TOP_WIDTH]; 3],
    /// What boxes are widened by, per unit of a ray's origin.
    pub reach: [f32; TOP_WIDTH],
    /// A node, or an instance (the top bit is set; the others are its name), or `u32::MAX` for none; with [`ALWAYS`]
    /// where the box does not count.
    pub children: [u32; TOP_WIDTH],
}

/// An instance as a device has it, with what its geometry's own queries know of the geometry. 128 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct PackedInstance {
    /// From the world to the object.
    pub inverse: Transform,
    /// Rays enter when a bit of theirs is in this mask. 0 for a name that no instance has.
    pub mask: u32,
    /// The geometry's name times 8; bit 2 for a reflection; in the last bits the side to ignore, as in
    /// [`SceneBatch::culling`](crate::layout::SceneBatch::culling).
    pub sides: u32,
    /// The geometry's root among all nodes.
    pub root: u32,
    /// The geometry's first triangle among all triangles; of a set of shapes, the block in which they begin.
    pub first_triangle: u32,
    /// Lower corner of the tree's bounds.
    pub lo: [f32; 3],
    /// As [`SceneUniform::slack`](crate::layout::SceneUniform::slack), as the others.
    pub slack: f32,
    /// Upper corner of the tree's bounds.
    pub hi: [f32; 3],
    /// 1 when exponents leave the range of the plain triangle test.
    pub wide: u32,
    /// Lower corner of the box in which an origin is not far.
    pub near_lo: [f32; 3],
    /// Where among all references the geometry's opacity mask begins; 0 for none. See [`PackedScene::references`]. Of a
    /// set of shapes, [`SHAPES`] and the block of its tree's root.
    pub opacity: u32,
    /// Upper corner of the box in which an origin is not far.
    pub near_hi: [f32; 3],
    /// The value for which origin coordinates next to 0 are taken.
    pub origin_least: f32,
}

/// The bit of [`PackedInstance::opacity`] for a set of shapes.
pub const SHAPES: u32 = 1 << 31;

/// The bit of [`PackedInstance::sides`] for a reflection.
pub const MIRRORED: u32 = 4;

/// A node of a tree over shapes, or eight shapes.
pub type ShapeBlock = [u32; 64];

/// A scene as a device holds it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PackedScene {
    /// The tree over instances, the root first.
    pub box_nodes: Vec<PackedTopNode>,
    /// By the names of instances.
    pub instances: Vec<PackedInstance>,
    /// The nodes of all geometries.
    pub nodes: Vec<KdNode>,
    /// The references of all geometries, each geometry's opacity mask right behind its own: the level, the geometry's first
    /// triangle among all triangles, and the words of the cells. A mask lies here since devices bind few buffers.
    pub references: Vec<u32>,
    /// The snapped corners of all geometries.
    pub triangles: Vec<Triangle>,
    /// Sets of shapes, in blocks of 256 bytes: of each set first its tree, a [`PackedTopNode`] a block, which names its children by their
    /// places among all blocks and shapes by their numbers; then the shapes, eight a block, as capsules: the first end, the
    /// radius, the second end, 0. A sphere is a capsule whose ends are one point, and that has the same hits by the same operations.
    pub shapes: Vec<ShapeBlock>,
}
