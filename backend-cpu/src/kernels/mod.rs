//! The kernels, one a file, named as in [`splitplane_core::kernel::Kernel`]. Each is a function over
//! typed slices that leaves in its buffers what the device's twin leaves there.

pub mod allocate_children;
pub mod assign_chunks;
pub mod bin_references;
pub mod build_cached;
pub mod build_small;
pub mod chunk_nodes;
pub mod classify_references;
pub(crate) mod columns;
pub(crate) mod count_bins;
pub mod count_children;
pub(crate) mod cut;
pub mod emit_small;
pub mod emit_top;
pub mod gather_references;
pub(crate) mod lanes;
pub mod node_bounds;
pub mod preorder_addresses;
pub mod scan_triangles;
pub mod scatter_references;
pub(crate) mod small_root;
pub mod split_binned;
pub mod split_large;
pub mod subtree_sizes;
pub mod triangle_bounds;

/// Fewest nodes or chunks worth a task of their own.
pub(crate) const GRAIN: usize = 16;
