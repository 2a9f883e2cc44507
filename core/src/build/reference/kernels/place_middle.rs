use super::range;
use crate::build::middle::Region;
use crate::layout::{MiddleRoot, Reference, SmallRoot};

/// Moves the leaves of a middle root and their references from its region to their places.
///
/// `middle_references` and `middle_leaves` are those of all regions; `small_roots` and `small_references` are the root's
/// own parts of the output.
pub fn place_middle(
    root: usize,
    middle_roots: &[MiddleRoot],
    middle_references: &[Reference],
    middle_leaves: &[SmallRoot],
    small_roots: &mut [SmallRoot],
    small_references: &mut [Reference],
) {
    let index = root as u32;
    let root = &middle_roots[root];
    let region = Region::start(root.first, index);
    small_references.copy_from_slice(&middle_references[range(region.references, root.references)]);
    let leaves = &middle_leaves[range(region.leaves, root.leaves)];
    for (out, leaf) in small_roots.iter_mut().zip(leaves) {
        *out = SmallRoot { first: root.first_reference + leaf.first, ..*leaf };
    }
}
