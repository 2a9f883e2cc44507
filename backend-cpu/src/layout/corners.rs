//! Whether the blocks of a layout have their corners written out or share them ([`super::packed_block`]).
//!
//! Shared corners take half the bytes in a mesh, where six triangles meet in a corner. Where triangles share none, as in a soup of
//! triangles apart, a block of eight lanes has room for sixteen corners and so for five triangles: leaves of six to eight become two
//! blocks, whose corners are looked up for nothing. Written out they are one block of fewer bytes, whose rows are read as they are.
//!
//! It is decided once for all blocks of a layout. So who asks many rays of it asks once how its blocks are stored and has code of
//! its own for either, and what the test of shared corners keeps in registers does not depend on the other. (Asked block by block
//! it took back half and more of what writing out had gained.) A mesh of which a part shares corners and a part does not is stored with shared
//! corners, unless that part is small or no run meets it.
//!
//! The decision is a function of the tree and its triangles: a few runs of the tree's references are looked at, which are places in space. In
//! the mesh's own list neighbours may be anywhere. Nothing depends on threads, on time or on what memory held before. Hits do not
//! depend on it.

use splitplane_core::triangle::Triangle;

use crate::simd::InstructionSet;

/// References that follow each other and are looked at: those of some leaves.
const RUN: usize = 16;
/// Such runs, spread over all references.
const RUNS: usize = 8;
/// Corners are shared from one in so many on. A sixth triangle goes into a block only if two of fifteen corners are known, which is
/// one in seven; here it is less, since a block of shared corners that are few is no worse than it was before there were others.
const SHARED: usize = 12;

/// Whether blocks for a set have their corners written out, given a tree's references and the mesh's triangles. Never where
/// there are fewer than 128 references: too few to tell, and little to gain.
pub(crate) fn are_written_out(
    set: InstructionSet,
    references: &[u32],
    triangles: &[Triangle],
) -> bool {
    if !set.writes_out() || references.len() < RUN * RUNS {
        return false;
    }
    let (mut all, mut shared) = (0, 0);
    for run in references.chunks(references.len() / RUNS).take(RUNS) {
        let mut own = [0; RUN];
        own.copy_from_slice(&run[..RUN]);
        // A triangle of several leaves counts once: with itself it shares everything.
        own.sort_unstable();
        let mut corners = [[0; 3]; 3 * RUN];
        let mut count = 0;
        for (place, &triangle) in own.iter().enumerate() {
            if place == 0 || own[place - 1] != triangle {
                for corner in &triangles[triangle as usize] {
                    corners[count] = corner.map(f32::to_bits);
                    count += 1;
                }
            }
        }
        let corners = &mut corners[..count];
        corners.sort_unstable();
        all += count;
        shared += corners.windows(2).filter(|pair| pair[0] == pair[1]).count();
        // Most meshes share so many that one run says it.
        if shared * SHARED >= 3 * RUN * RUNS {
            return false;
        }
    }
    shared * SHARED < all
}

#[cfg(test)]
mod tests {
    use splitplane_test_support::random::Random;

    use super::*;

    /// Triangles apart from one another.
    fn apart(count: usize) -> Vec<Triangle> {
        let mut random = Random::new(3);
        let mut coordinate = || random.between(-1.0, 1.0) as f32;
        (0..count).map(|_| [(); 3].map(|()| [(); 3].map(|()| coordinate()))).collect()
    }

    /// Each with another one across its first edge: four corners of six.
    fn pairs(triangles: &[Triangle]) -> Vec<Triangle> {
        let pair = |t: &Triangle| [*t, [t[1], t[0], [t[2][0], t[2][1], 2.0 - t[2][2]]]];
        triangles.iter().flat_map(pair).collect()
    }

    fn in_order(triangles: &[Triangle]) -> bool {
        let references: Vec<u32> = (0..triangles.len() as u32).collect();
        are_written_out(InstructionSet::Avx2, &references, triangles)
    }

    #[test]
    fn only_meshes_of_triangles_apart_have_their_corners_written_out() {
        let soup = apart(1_000);
        assert!(in_order(&soup));
        assert!(!in_order(&pairs(&soup[..500])));
        // One run of eight has pairs, which share 16 of 384 corners; then four have.
        let some =
            |count: usize| [pairs(&soup[..count]), soup[count..1_000 - count].to_vec()].concat();
        assert!(in_order(&some(60)));
        assert!(!in_order(&some(200)));
    }

    #[test]
    fn so_few_references_say_nothing_and_wider_vectors_look_corners_up() {
        let soup = apart(200);
        let references: Vec<u32> = (0..200).collect();
        for count in [0, 1, 7, 8, 9, 127, 128, 129, 200] {
            let written = are_written_out(InstructionSet::Avx2, &references[..count], &soup);
            assert_eq!(written, count >= 128, "{count}");
            assert!(
                !are_written_out(InstructionSet::Avx512, &references[..count], &soup),
                "{count}"
            );
        }
    }

    #[test]
    fn a_triangle_in_several_leaves_is_one() {
        let soup = apart(100);
        let references: Vec<u32> = (0..400).map(|place| place / 4).collect();
        assert!(are_written_out(InstructionSet::Avx2, &references, &soup));
    }

    /// What counts is what lies side by side in the tree, not in the list.
    #[test]
    fn the_order_of_the_list_does_not_count() {
        let pairs = pairs(&apart(500));
        let (mut list, mut references) = (pairs.clone(), vec![0; pairs.len()]);
        // Every pair is parted in the list and together in the tree.
        for (place, triangle) in pairs.iter().enumerate() {
            let to = place / 2 + place % 2 * 500;
            list[to] = *triangle;
            references[place] = to as u32;
        }
        assert!(!are_written_out(InstructionSet::Avx2, &references, &list));
    }
}
