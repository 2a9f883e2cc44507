//! Layouts for queries, made from a finished tree.
//!
//! [`tree_layout::TreeLayout`] is the whole: wide nodes ([`wide`]) and packed blocks of triangles
//! ([`packed_block`]), and, for the few rays that the vector code does not handle, the tree's own
//! nodes ([`walk_node`]). In the compact layout the tree and a copy of the mesh ([`indexed`]) take
//! the place of blocks.
//!
//! *Codecs.* Each format is encoded and decoded in one file: wide nodes in `wide_node.rs`, blocks in `packed_block.rs`,
//! the tree's own nodes by [`splitplane_core::tree::node::KdNode`]. A test reads the sources and fails where another file shifts
//! or masks their words.
//!
//! *Making one.* `plan.rs` decides which levels of the tree become one wide node, `corners.rs` in which of two ways blocks are stored,
//! `pack.rs` puts triangles together to blocks, and `scratch.rs` does both by many tasks, so that the size is known before any memory is asked for.

pub(crate) mod cells;
pub(crate) mod corners;
pub(crate) mod gathered_block;
pub(crate) mod indexed;
pub(crate) mod large;
pub(crate) mod leaf_groups;
pub(crate) mod limits;
pub(crate) mod order;
pub(crate) mod pack;
pub(crate) mod packed_block;
pub(crate) mod plan;
pub(crate) mod scratch;
pub(crate) mod tree_layout;
pub(crate) mod walk_node;
pub(crate) mod wide;
pub(crate) mod wide_node;
