//! `classify_references`: one workgroup a chunk, one invocation a reference.
//!
//! Reads: decisions, references, corners of those that a plane cuts. Writes: the sides each reference
//! goes to, and how many of the chunk's go to each.

use rayon::prelude::*;
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::layout::{Chunk, Decision, Reference, Sides};
use splitplane_core::split::{goes_left, goes_right};
use splitplane_core::triangle::{Triangle, clip, corners_on_both_sides};

use super::GRAIN;
use crate::scatter::Scatter;

/// The reference goes left.
pub const LEFT: u8 = 1;
/// The reference goes right.
pub const RIGHT: u8 = 2;

/// Runs the kernel.
pub fn run<A: Arithmetic>(
    chunks: &[Chunk],
    decisions: &[Decision],
    references: &[Reference],
    triangles: &[Triangle],
    reference_sides: &mut [u8],
    chunk_counts: &mut [Sides],
) {
    let reference_sides = Scatter::new(reference_sides);
    chunks.par_iter().zip(chunk_counts).with_min_len(GRAIN).for_each(|(chunk, counts)| {
        let decision = &decisions[chunk.node as usize];
        let (first, count) = (chunk.first as usize, chunk.count as usize);
        // SAFETY: chunks are disjoint ranges of the references.
        let sides = unsafe { reference_sides.part(first, count) };
        if decision.axis == Decision::TRANSFER {
            sides.fill(LEFT);
            *counts = Sides { left: chunk.count, right: 0 };
            return;
        }
        let (axis, position) = (decision.axis as usize, decision.position);
        let references = &references[first..first + count];
        let mut both = 0;
        *counts = Sides::default();
        for (side, reference) in sides.iter_mut().zip(references) {
            let left = goes_left(reference.lo[axis], reference.hi[axis], position);
            let right = goes_right(reference.hi[axis], position);
            *side = u8::from(left) * LEFT + u8::from(right) * RIGHT;
            counts.left += u32::from(left);
            counts.right += u32::from(right);
            both += u32::from(left & right);
        }
        if both == 0 {
            return;
        }
        // The bounds straddle the plane, but what is left of the triangle may not.
        for (side, reference) in sides.iter_mut().zip(references) {
            if *side != LEFT | RIGHT {
                continue;
            }
            let corners = &triangles[reference.triangle as usize];
            let bounds = reference.bounds();
            if corners_on_both_sides(corners, &bounds, axis, position) {
                continue;
            }
            // Nothing on either side: the old bounds held more than the triangle, and it ends here.
            let [left, right] = clip::<A>(corners, &bounds, axis, position);
            if left.is_empty() {
                *side &= !LEFT;
                counts.left -= 1;
            }
            if right.is_empty() {
                *side &= !RIGHT;
                counts.right -= 1;
            }
        }
    });
}
