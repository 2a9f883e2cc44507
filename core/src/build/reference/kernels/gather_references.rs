use core::ops::Range;

use super::triangles_of;
use crate::aabb::Aabb;
use crate::layout::{Reference, Sides};
use crate::triangle::{Triangle, prepare};

/// Writes a reference for each triangle of an input chunk that is kept, in their order.
///
/// `references` is the chunk's part of `References`, as [`gathered`] says.
pub fn gather_references(chunk: usize, triangles: &[Triangle], references: &mut [Reference]) {
    let chunk = triangles_of(chunk, triangles.len());
    // Snapping a second time changes nothing.
    let kept = chunk.filter(|&index| prepare(&triangles[index]).kept);
    for (index, reference) in kept.zip(references) {
        *reference = Reference::new(&Aabb::of_points(&triangles[index]), index as u32);
    }
}

/// Where the references of an input chunk are stored, when this many triangles are kept in all.
pub fn gathered(chunk: usize, chunk_counts: &[Sides], kept: usize) -> Range<usize> {
    let end = chunk_counts.get(chunk + 1).map_or(kept, |next| next.left as usize);
    chunk_counts[chunk].left as usize..end
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dropped_triangles_leave_no_gap() {
        let good = [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
        let mut references = [Reference::new(&Aabb::EMPTY, 9); 2];
        gather_references(0, &[good, [[1.0; 3]; 3], good], &mut references);
        let bounds = Aabb { lo: [0.0, 0.0, 1.0], hi: [2.0, 1.0, 1.0] };
        assert_eq!(references, [0, 2].map(|triangle| Reference::new(&bounds, triangle)));
    }

    #[test]
    fn each_chunk_has_a_range_of_its_own() {
        let counts = [0, 200, 200].map(|left| Sides { left, right: 0 });
        let ranges = [0, 1, 2].map(|chunk| gathered(chunk, &counts, 217));
        assert_eq!(ranges, [0..200, 200..200, 200..217]);
    }
}
