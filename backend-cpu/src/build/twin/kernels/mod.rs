//! The kernels, one a file, named as in [`splitplane_core::kernel::Kernel`]. Each is a function over
//! typed slices that leaves in its buffers what the device's twin leaves there.

pub mod allocate_children;
pub mod assign_chunks;
pub mod bin_references;
pub mod build_small;
pub mod chunk_nodes;
pub mod classify_references;
pub mod count_children;
pub mod emit_small;
pub mod emit_top;
pub mod gather_references;
pub mod node_bounds;
pub mod preorder_addresses;
pub mod scan_triangles;
pub mod scatter_references;
pub mod split_binned;
pub mod split_median;
pub mod subtree_sizes;
pub mod triangle_bounds;

/// Fewest nodes or chunks worth a task of their own.
pub(crate) const GRAIN: usize = 16;
