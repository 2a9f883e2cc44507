use super::range;
use crate::arithmetic::Arithmetic;
use crate::build::split::{goes_left, goes_right};
use crate::config::BuildConfig;
use crate::layout::{Chunk, ChunkSides, Decision, Reference, Sides};
use crate::triangle::{Triangle, clip};

/// Finds the sides of its node's split to which each reference of a chunk goes, and counts them. Where
/// the node is transferred, all go left.
///
/// A reference goes where its bounds say, see [`goes_left`] and [`goes_right`]. Where these say both
/// sides and references are clipped, it does not go to a side on which nothing is left of it: bounds
/// that were clipped before may hold more than the triangle, and it may end in that part.
pub fn classify_references<A: Arithmetic>(
    config: &BuildConfig,
    chunk: usize,
    chunks: &[Chunk],
    decisions: &[Decision],
    references: &[Reference],
    triangles: &[Triangle],
) -> (ChunkSides, Sides) {
    let chunk = &chunks[chunk];
    let decision = &decisions[chunk.node as usize];
    if decision.axis == Decision::TRANSFER {
        let sides = ChunkSides::all_left(chunk.count);
        return (sides, sides.counts());
    }
    let mut sides = ChunkSides::default();
    for (index, reference) in references[range(chunk.first, chunk.count)].iter().enumerate() {
        let [left, right] = goes::<A>(config, reference, triangles, decision);
        sides.left[index / 32] |= u32::from(left) << (index % 32);
        sides.right[index / 32] |= u32::from(right) << (index % 32);
    }
    (sides, sides.counts())
}

/// Whether a reference goes to the left child of its node, and whether to the right one.
pub(super) fn goes<A: Arithmetic>(
    config: &BuildConfig,
    reference: &Reference,
    triangles: &[Triangle],
    decision: &Decision,
) -> [bool; 2] {
    let (axis, position) = (decision.axis as usize, decision.position);
    let left = goes_left(reference.lo[axis], reference.hi[axis], position);
    let right = goes_right(reference.hi[axis], position);
    if left && right && config.clip {
        let corners = &triangles[reference.triangle as usize];
        let parts = clip::<A>(corners, &reference.bounds(), axis, position);
        return parts.map(|part| !part.is_empty());
    }
    [left, right]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aabb::Aabb;
    use crate::arithmetic::Strict;
    use bytemuck::Zeroable;

    /// Left of the plane, right of it, on both sides, in the plane; and bounds on both sides of a
    /// triangle that ends before the plane within them.
    #[test]
    fn sides_by_bounds_and_by_what_is_left() {
        let planar = |x: f32| [[x, 0.0, 0.0], [x, 1.0, 0.0], [x, 0.0, 1.0]];
        let across = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        let triangles = [planar(1.0), planar(3.0), across, planar(2.0), across];
        let mut references: [Reference; 5] =
            core::array::from_fn(|i| Reference::new(&Aabb::of_points(&triangles[i]), i as u32));
        references[4].lo[1] = 3.0;
        let chunks = [Chunk { node: 0, first: 0, count: 5, span_sides: 0 }];
        let decision = Decision { axis: 0, position: 2.0, ..Decision::zeroed() };
        let sides = |config: BuildConfig, decision| {
            let decisions = [decision];
            let (sides, counts) = classify_references::<Strict>(
                &config,
                0,
                &chunks,
                &decisions,
                &references,
                &triangles,
            );
            assert_eq!(counts, sides.counts());
            (sides.left[0], sides.right[0])
        };
        let config = BuildConfig::default();
        assert_eq!(sides(config, decision), (0b11101, 0b00110));
        let whole = BuildConfig { clip: false, ..config };
        assert_eq!(sides(whole, decision), (0b11101, 0b10110), "by bounds alone");
        let transfer = Decision { axis: Decision::TRANSFER, ..decision };
        assert_eq!(sides(config, transfer), (0b11111, 0));
    }
}
