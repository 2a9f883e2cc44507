//! `classify_references`: one workgroup a chunk, one invocation a reference.
//!
//! Reads: decisions, references, corners of those that a plane cuts. Writes: the sides each reference
//! goes to, and how many of the chunk's, of its span's and of its node's go to each.

use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::build::reference::kernels::count_children;
use splitplane_core::build::split::{goes_left, goes_right};
use splitplane_core::layout::{Chunk, ChunkSides, Decision, Reference, Sides};
use splitplane_core::triangle::{Triangle, clip, corners_on_both_sides};

use super::GRAIN;
use crate::cancel::ProgressMeter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::span;

/// Runs the kernel.
#[allow(clippy::too_many_arguments, reason = "the buffers it reads and writes")]
pub(crate) fn run<A: Arithmetic>(
    meter: &ProgressMeter<'_>,
    clipped: bool,
    chunks: &mut [Chunk],
    decisions: &mut [Decision],
    references: &[Reference],
    triangles: &[Triangle],
    reference_sides: &mut [ChunkSides],
    chunk_counts: &mut [Sides],
) {
    let (named, decided) = (&*chunks, &*decisions);
    let classifying = span::pieces_of(GRAIN);
    named.par_iter().zip(reference_sides).zip(&mut *chunk_counts).with_min_len(GRAIN).for_each(
        |((chunk, sides), counts)| {
            let _piece = span::piece();
            if meter.record_work(u64::from(chunk.count)) {
                return;
            }
            let decision = &decided[chunk.node as usize];
            let (first, count) = (chunk.first as usize, chunk.count as usize);
            if decision.axis == Decision::TRANSFER {
                *sides = ChunkSides::all_left(chunk.count);
            } else {
                let references = &references[first..first + count];
                *sides = classify::<A>(decision, references, clipped.then_some(triangles));
            }
            *counts = sides.counts();
        },
    );
    drop(classifying);
    // Serial: it adds a few numbers for 256 references.
    for (chunk, counts) in chunk_counts.iter().enumerate() {
        count_children(chunk, *counts, chunks, decisions);
    }
}

/// The sides of the references of one chunk of a node that is split; by their bounds alone where
/// there are no corners to clip.
#[inline]
fn classify<A: Arithmetic>(
    decision: &Decision,
    references: &[Reference],
    triangles: Option<&[Triangle]>,
) -> ChunkSides {
    let (axis, position) = (decision.axis as usize, decision.position);
    let mut sides = ChunkSides::default();
    for (word, references) in references.chunks(32).enumerate() {
        let (mut left, mut right) = (0, 0);
        for (bit, reference) in references.iter().enumerate() {
            left |= u32::from(goes_left(reference.lo[axis], reference.hi[axis], position)) << bit;
            right |= u32::from(goes_right(reference.hi[axis], position)) << bit;
        }
        // The bounds of these straddle the plane, but what is left of the triangle may not.
        let mut both = if triangles.is_some() { left & right } else { 0 };
        while both != 0 {
            let bit = both.trailing_zeros();
            both &= both - 1;
            let reference = &references[bit as usize];
            let Some(corners) = triangles.map(|all| &all[reference.triangle as usize]) else {
                break;
            };
            let bounds = reference.bounds();
            if corners_on_both_sides(corners, &bounds, axis, position) {
                continue;
            }
            // Nothing on either side: the old bounds held more than the triangle, and it ends here.
            let parts = clip::<A>(corners, &bounds, axis, position);
            left &= !(u32::from(parts[0].is_empty()) << bit);
            right &= !(u32::from(parts[1].is_empty()) << bit);
        }
        (sides.left[word], sides.right[word]) = (left, right);
    }
    sides
}
