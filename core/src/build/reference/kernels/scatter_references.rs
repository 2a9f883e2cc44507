use super::super::Parts;
use super::range;
use crate::aabb::Aabb;
use crate::arithmetic::Arithmetic;
use crate::config::BuildConfig;
use crate::layout::{Chunk, ChunkBounds, ChunkSides, Decision, Reference, Sides};
use crate::triangle::{Triangle, clip};

/// Moves the references of a chunk to the children of its node, in their order, cut at the plane.
/// Writes the chunk's `ChunkBounds`: the bounds of the references that went left and of those that
/// went right.
///
/// `children` are the chunk's places in `NextReferences` and `SmallReferences`: see [`destinations`].
/// References of a node that is transferred stay as they are; their bounds are not needed, and are empty.
#[allow(clippy::too_many_arguments, reason = "the buffers it reads and writes")]
pub fn scatter_references<A: Arithmetic>(
    config: &BuildConfig,
    chunk: usize,
    chunks: &[Chunk],
    decisions: &[Decision],
    references: &[Reference],
    triangles: &[Triangle],
    reference_sides: &[ChunkSides],
    children: [&mut [Reference]; 2],
) -> ChunkBounds {
    let mut bounds = [Aabb::EMPTY; 2];
    let (sides, chunk) = (&reference_sides[chunk], &chunks[chunk]);
    let decision = &decisions[chunk.node as usize];
    let references = &references[range(chunk.first, chunk.count)];
    let [left, right] = children;
    if decision.axis == Decision::TRANSFER {
        left.copy_from_slice(references);
        return ChunkBounds { sides: bounds };
    }
    let mut children = [left.iter_mut(), right.iter_mut()];
    for (index, reference) in references.iter().enumerate() {
        let parts = cut::<A>(config, reference, triangles, decision);
        for (side, words) in [&sides.left, &sides.right].into_iter().enumerate() {
            if words[index / 32] >> (index % 32) & 1 == 0 {
                continue;
            }
            if let Some(place) = children[side].next() {
                *place = parts[side];
                bounds[side] = bounds[side].union(&parts[side].bounds());
            }
        }
    }
    ChunkBounds { sides: bounds }
}

/// The parts of a reference on both sides of its node's plane: clipped, or without clipping its bounds
/// cut at the plane. Bounds that the plane does not cross stay as they are.
///
/// A reference goes to one side only, even though the plane crosses its bounds, where nothing of it is
/// left on the other side.
pub(super) fn cut<A: Arithmetic>(
    config: &BuildConfig,
    reference: &Reference,
    triangles: &[Triangle],
    decision: &Decision,
) -> [Reference; 2] {
    let (axis, position) = (decision.axis as usize, decision.position);
    let bounds = reference.bounds();
    if position <= bounds.lo[axis] || bounds.hi[axis] <= position {
        return [*reference; 2];
    }
    let parts = if config.clip {
        clip::<A>(&triangles[reference.triangle as usize], &bounds, axis, position)
    } else {
        let mut parts = [bounds; 2];
        parts[0].hi[axis] = position;
        parts[1].lo[axis] = position;
        parts
    };
    parts.map(|part| Reference::new(&part, reference.triangle))
}

/// Where the references of every chunk go, chunk by chunk: its places on the left and on the right.
///
/// The references of a child are stored together, in `NextReferences` where the child has more than
/// T and its node is split, else in `SmallReferences`; `allocate_children` says where they begin.
/// Within them each chunk has as many places as references that go to the child, in the order of
/// the chunks.
pub fn destinations<'a>(
    config: &'a BuildConfig,
    chunks: &'a [Chunk],
    decisions: &'a [Decision],
    reference_sides: &'a [ChunkSides],
    next_references: &'a mut [Reference],
    small_references: &'a mut [Reference],
) -> impl Iterator<Item = [&'a mut [Reference]; 2]> {
    let (mut next, mut small) = (Parts::new(next_references), Parts::new(small_references));
    // The places of the two children of the current node that no chunk has yet.
    let mut node = None;
    let mut left = Parts::new(&mut []);
    let mut right = Parts::new(&mut []);
    let mut taken = Sides::default();
    chunks.iter().zip(reference_sides).map(move |(chunk, sides)| {
        let decision = &decisions[chunk.node as usize];
        if node != Some(chunk.node) {
            let mut child = |first: u32, count: u32| {
                let is_small =
                    count <= config.small_node_limit() || decision.axis == Decision::TRANSFER;
                let list = if is_small { &mut small } else { &mut next };
                Parts::new(list.take(range(first, count)))
            };
            left = child(decision.first.left, decision.counts.left);
            right = child(decision.first.right, decision.counts.right);
            (node, taken) = (Some(chunk.node), Sides::default());
        }
        let counts = match decision.axis {
            // Whatever their sides were: a cap may have refused the split.
            Decision::TRANSFER => Sides { left: chunk.count, right: 0 },
            _ => sides.counts(),
        };
        let places = [
            left.take(range(taken.left, counts.left)),
            right.take(range(taken.right, counts.right)),
        ];
        taken.left += counts.left;
        taken.right += counts.right;
        places
    })
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    /// Two nodes of two chunks each, the first one split, the second one transferred by a cap.
    #[test]
    fn chunks_stand_side_by_side_in_each_child() {
        let config = BuildConfig::default().with_stages(|stages| stages.small_node_limit = 4);
        let chunk = |node| Chunk { node, first: 0, count: 5, span_sides: 0 };
        let chunks = [chunk(0), chunk(0), chunk(1), chunk(1)];
        let sides = |left: u32, right: u32| {
            let mut sides = ChunkSides::default();
            (sides.left[0], sides.right[0]) = (left, right);
            sides
        };
        let sides = [sides(0b11011, 0b100), sides(0b11, 0b11100), sides(1, 30), sides(1, 30)];
        let decisions = [
            Decision {
                counts: Sides { left: 6, right: 4 },
                first: Sides { left: 0, right: 2 },
                ..Decision::zeroed()
            },
            Decision {
                axis: Decision::TRANSFER,
                counts: Sides { left: 10, right: 0 },
                first: Sides { left: 6, right: 0 },
                ..Decision::zeroed()
            },
        ];
        let numbered = |i: usize| Reference::new(&Aabb::EMPTY, i as u32);
        let mut next: [Reference; 6] = core::array::from_fn(numbered);
        let mut small: [Reference; 16] = core::array::from_fn(|i| numbered(100 + i));
        let mut found = destinations(&config, &chunks, &decisions, &sides, &mut next, &mut small)
            .map(|places| {
                places.map(|part| (part.first().map(|place| place.triangle), part.len()))
            });
        assert_eq!(found.next(), Some([(Some(0), 4), (Some(102), 1)]));
        assert_eq!(found.next(), Some([(Some(4), 2), (Some(103), 3)]));
        assert_eq!(found.next(), Some([(Some(106), 5), (None, 0)]));
        assert_eq!(found.next(), Some([(Some(111), 5), (None, 0)]));
        assert_eq!(found.next(), None);
    }
}
