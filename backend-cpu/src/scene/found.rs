//! How the leaves of a layout are found, known when a walk is compiled.

use crate::layout::tree_layout::TreeLayout;
use crate::trace::leaves::{IndexedLeaves, Leaves, PackedLeaves};

/// Layouts whose leaves are found in one way.
pub(super) trait Found<'a>: Leaves {
    /// The leaves of a layout of this kind.
    fn of(layout: &'a TreeLayout) -> Option<Self>;
}

impl<'a> Found<'a> for PackedLeaves<'a> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn of(layout: &'a TreeLayout) -> Option<PackedLeaves<'a>> {
        Some(PackedLeaves::new(layout))
    }
}

impl<'a> Found<'a> for IndexedLeaves<'a> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn of(layout: &'a TreeLayout) -> Option<IndexedLeaves<'a>> {
        IndexedLeaves::of(layout)
    }
}
