//! The kernels, one a file, named as in [`splitplane_core::kernel::Kernel`]. Each is a function over
//! typed slices that leaves in its buffers what the device's twin leaves there.

use splitplane_core::build::reference::kernels as reference;
use splitplane_core::layout::{Chunk, LargeNode};

pub(crate) mod allocate_children;
pub(crate) mod bin_references;
pub(crate) mod build_middle;
pub(crate) mod build_small;
pub(crate) mod classify_references;
pub(crate) mod emit_middle;
pub(crate) mod emit_small;
pub(crate) mod emit_top;
pub(crate) mod gather_references;
pub(crate) mod measure_middle;
pub(crate) mod node_bounds;
pub(crate) mod place_middle;
pub(crate) mod preorder_addresses;
pub(crate) mod scan_middle;
pub(crate) mod scan_triangles;
pub(crate) mod scatter_references;
pub(crate) mod split_binned;
pub(crate) mod split_median;
pub(crate) mod subtree_sizes;
pub(crate) mod triangle_bounds;

/// The first step of `node_bounds` and `split_median`: names the chunks of all active nodes. Serial: it writes 16 bytes
/// for 256 references.
fn name_chunks(active: &[LargeNode], chunks: &mut [Chunk]) {
    for (index, node) in active.iter().enumerate() {
        reference::name_chunks(index, active, &mut chunks[reference::chunks_of(node)]);
    }
}

/// Fewest nodes or chunks worth a task of their own.
pub(crate) const GRAIN: usize = 16;
