//! `measure_middle`: one workgroup a middle root.
//!
//! Reads: middle roots, the sizes of their leaves. Writes: nodes and references of each root's subtree.

use splitplane_core::build::reference::kernels as reference;
use splitplane_core::layout::{Extent, MiddleRoot};

/// Runs the kernel.
pub(crate) fn run(middle_roots: &[MiddleRoot], small_sizes: &[Extent], sizes: &mut [Extent]) {
    for (index, size) in sizes.iter_mut().enumerate() {
        *size = reference::measure_middle(index, middle_roots, small_sizes);
    }
}
