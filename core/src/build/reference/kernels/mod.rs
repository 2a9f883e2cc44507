//! The kernels, one per file, named as in [`kernel::Kernel`](crate::kernel::Kernel): what one item of each grid
//! does.
//!
//! | kernel | an item of its grid |
//! |---|---|
//! | [`triangle_bounds`], [`gather_references`] | 256 consecutive triangles of the mesh |
//! | [`name_chunks`], [`node_bounds`], [`split_median`], [`split_binned`] | an active node |
//! | [`bin_references`], [`classify_references`], [`count_children`], [`scatter_references`] | a chunk: up to 256 consecutive references of an active node |
//! | [`build_middle`] | a node that the levels hand over |
//! | [`place_middle`], [`measure_middle`], [`emit_middle`] | a middle root |
//! | [`build_small`], [`emit_small`] | a small root |
//! | [`emit_top`] | a node of the top tree |
//! | [`scan_triangles`], [`allocate_children`], [`scan_middle`], [`subtree_sizes`], [`preorder_addresses`] | all there is |
//!
//! Parameters come in this order: the configuration where it matters, the index of the item, the
//! buffers read, what is written in place. The slices of a buffer hold its live range, all of it
//! unless the text says otherwise. Items of one grid write to different places and read nothing that
//! another one of them writes, so they may run in any order and at the same time.
//!
//! [`name_chunks`] is the first step of both `node_bounds` and `split_median`. [`count_children`] is the second one of
//! `classify_references`, and the one function whose items write to the same places: they add whole numbers, in any order.
//!
//! All kernels trust what earlier kernels wrote. On other contents they may panic.

use core::ops::Range;

use crate::config::CHUNK;
use crate::kernel::Kernel;
use crate::layout::LargeNode;

mod allocate_children;
mod bin_references;
mod build_middle;
mod build_small;
mod classify_references;
mod count_children;
mod emit_middle;
mod emit_small;
mod emit_top;
mod gather_references;
mod measure_middle;
mod name_chunks;
mod node_bounds;
mod place_middle;
mod preorder_addresses;
mod scan_middle;
mod scan_triangles;
mod scatter_references;
mod small_subtree;
mod split_binned;
mod split_median;
mod subtree_sizes;
mod triangle_bounds;

pub use allocate_children::{Lists, Most, allocate_children, allocate_children_most};
pub use bin_references::bin_references;
pub use build_middle::{MiddleRegion, build_middle};
pub use build_small::build_small;
pub use classify_references::classify_references;
pub use count_children::count_children;
pub use emit_middle::emit_middle;
pub use emit_small::emit_small;
pub use emit_top::{emit_top, small_address};
pub use gather_references::{gather_references, gathered};
pub use measure_middle::measure_middle;
pub use name_chunks::name_chunks;
pub use node_bounds::node_bounds;
pub use place_middle::place_middle;
pub use preorder_addresses::preorder_addresses;
pub use scan_middle::scan_middle;
pub use scan_triangles::scan_triangles;
pub use scatter_references::{destinations, scatter_references};
pub use small_subtree::{SmallNode, SmallSubtree};
pub use split_binned::split_binned;
pub use split_median::{split_median, split_median_while};
pub use subtree_sizes::subtree_sizes;
pub use triangle_bounds::triangle_bounds;

/// Whether a kernel belongs to the middle stage: an executor that hands nothing over leaves it out.
pub const fn is_of_middle_stage(kernel: Kernel) -> bool {
    matches!(
        kernel,
        Kernel::BuildMiddle
            | Kernel::ScanMiddle
            | Kernel::PlaceMiddle
            | Kernel::MeasureMiddle
            | Kernel::EmitMiddle
    )
}

/// The triangles of an input chunk, of this many in all.
pub fn triangles_of(chunk: usize, triangles: usize) -> Range<usize> {
    let first = chunk * CHUNK as usize;
    first..triangles.min(first + CHUNK as usize)
}

/// The chunks of an active node.
pub fn chunks_of(node: &LargeNode) -> Range<usize> {
    let first = node.first_chunk as usize;
    first..first + node.count.div_ceil(CHUNK) as usize
}

/// The references of a range that a record names by its first and their number.
fn range(first: u32, count: u32) -> Range<usize> {
    first as usize..first as usize + count as usize
}
