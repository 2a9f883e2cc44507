//! `place_middle`: one workgroup a middle root.
//!
//! Reads: middle roots, the references and leaves in their regions. Writes: the small list and its references.

use splitplane_core::build::reference::kernels as reference;
use splitplane_core::layout::{MiddleRoot, Reference, SmallRoot};

/// Runs the kernel.
pub(crate) fn run(
    middle_roots: &[MiddleRoot],
    middle_references: &[Reference],
    middle_leaves: &[SmallRoot],
    small_roots: &mut [SmallRoot],
    small_references: &mut [Reference],
) {
    for (index, root) in middle_roots.iter().enumerate() {
        reference::place_middle(
            index,
            middle_roots,
            middle_references,
            middle_leaves,
            &mut small_roots[root.first_leaf as usize..][..root.leaves as usize],
            &mut small_references[root.first_reference as usize..][..root.references as usize],
        );
    }
}
