//! `scatter_references`: one workgroup a chunk, one invocation a reference.
//!
//! Reads: decisions, sides, scanned counts, references, corners of those that a plane cuts. Writes:
//! the references of the children, clipped to their side, in order; bounds by chunk and child.

use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Strict;
use splitplane_core::layout::{Chunk, ChunkBounds, Decision, Reference, Sides};
use splitplane_core::triangle::{Side, Triangle, clip};

use super::GRAIN;
use super::classify_references::{LEFT, RIGHT};
use crate::scatter::Scatter;

/// What the kernel reads.
#[derive(Debug)]
pub struct Inputs<'a> {
    /// T: a child of at most this many references is small.
    pub small_node_limit: u32,
    /// The chunks.
    pub chunks: &'a [Chunk],
    /// Decisions of the active nodes.
    pub decisions: &'a [Decision],
    /// References of the active nodes.
    pub references: &'a [Reference],
    /// Sides of the references.
    pub reference_sides: &'a [u8],
    /// Offsets of each chunk within its node's children.
    pub chunk_counts: &'a [Sides],
    /// Corners by triangle index.
    pub triangles: &'a [Triangle],
}

/// Runs the kernel.
pub fn run(
    inputs: &Inputs<'_>,
    next_references: &mut [Reference],
    small_references: &mut [Reference],
    chunk_bounds: &mut [ChunkBounds],
) {
    let next = Scatter::new(next_references);
    let small = Scatter::new(small_references);
    inputs
        .chunks
        .par_iter()
        .zip(inputs.chunk_counts)
        .zip(chunk_bounds)
        .with_min_len(GRAIN)
        .for_each(|((chunk, offsets), bounds)| {
            let decision = &inputs.decisions[chunk.node as usize];
            let (first, count) = (chunk.first as usize, chunk.count as usize);
            let references = &inputs.references[first..first + count];
            if decision.axis == Decision::TRANSFER {
                let offset = chunk.first - decision.source_first;
                let to = (decision.first.left + offset) as usize;
                // SAFETY: a transferred node has a range of its own, its chunks parts of it.
                unsafe { small.part(to, count) }.copy_from_slice(references);
                *bounds = ChunkBounds { sides: [Aabb::EMPTY; 2] };
                return;
            }
            let sides = &inputs.reference_sides[first..first + count];
            let (axis, position) = (decision.axis as usize, decision.position);
            let going = |side: u8| sides.iter().filter(|&&s| s & side != 0).count();
            let place = |total: u32, first: u32, offset: u32, count: usize| {
                let destination = if total > inputs.small_node_limit { &next } else { &small };
                // SAFETY: `allocate_children` gives each child a range of its own in the buffer of
                // its class, and the scan in `count_children` each chunk a part of that range.
                unsafe { destination.part((first + offset) as usize, count) }
            };
            let (Sides { left, right }, to) = (decision.counts, decision.first);
            let mut lefts = place(left, to.left, offsets.left, going(LEFT)).iter_mut();
            let mut rights = place(right, to.right, offsets.right, going(RIGHT)).iter_mut();
            let mut found = [Aabb::EMPTY; 2];
            for (reference, &side) in references.iter().zip(sides) {
                let whole = reference.bounds();
                if side == LEFT | RIGHT {
                    let corners = &inputs.triangles[reference.triangle as usize];
                    let part = |side| clip::<Strict>(corners, &whole, axis, position, side);
                    let (a, b) = (part(Side::Left), part(Side::Right));
                    found[0] = found[0].union(&a);
                    found[1] = found[1].union(&b);
                    if let (Some(l), Some(r)) = (lefts.next(), rights.next()) {
                        *l = Reference::new(&a, reference.triangle);
                        *r = Reference::new(&b, reference.triangle);
                    }
                    continue;
                }
                if side == 0 {
                    continue;
                }
                // A reference whose part on the other side came out empty still has bounds that
                // reach there.
                let (out, index, side) = if side == LEFT {
                    (&mut lefts, 0, Side::Left)
                } else {
                    (&mut rights, 1, Side::Right)
                };
                let crosses = reference.lo[axis] < position && position < reference.hi[axis];
                let bounds = if crosses {
                    let corners = &inputs.triangles[reference.triangle as usize];
                    clip::<Strict>(corners, &whole, axis, position, side)
                } else {
                    whole
                };
                found[index] = found[index].union(&bounds);
                if let Some(reference_out) = out.next() {
                    *reference_out = Reference::new(&bounds, reference.triangle);
                }
            }
            *bounds = ChunkBounds { sides: found };
        });
}
