//! `gather_references`: one workgroup a chunk of 256 input triangles.
//!
//! Reads: snapped corners, scanned counts. Writes: a reference for each triangle kept, in order.

use splitplane_core::aabb::Aabb;
use splitplane_core::config::CHUNK;
use splitplane_core::layout::{Reference, Sides};
use splitplane_core::triangle::{Triangle, prepare};

use super::GRAIN;
use crate::cancel::ProgressMeter;
use crate::memory::Scatter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::span;

/// Runs the kernel. `references` is as long as there are triangles kept.
pub(crate) fn run(
    meter: &ProgressMeter<'_>,
    triangles: &[Triangle],
    chunk_counts: &[Sides],
    references: &mut [Reference],
) {
    let kept = references.len();
    let references = Scatter::new(references);
    let _loop = span::pieces_of(GRAIN);
    triangles.par_chunks(CHUNK as usize).enumerate().with_min_len(GRAIN).for_each(
        |(chunk, triangles)| {
            let _piece = span::piece();
            if meter.is_cancelled() {
                return;
            }
            let first = chunk_counts[chunk].left as usize;
            let end = chunk_counts.get(chunk + 1).map_or(kept, |next| next.left as usize);
            // SAFETY: the scan gives each chunk a range of its own.
            let mut out = unsafe { references.part(first, end - first) }.iter_mut();
            for (offset, corners) in triangles.iter().enumerate() {
                if prepare(corners).kept
                    && let Some(reference) = out.next()
                {
                    let index = chunk * CHUNK as usize + offset;
                    *reference = Reference::new(&Aabb::of_points(corners), index as u32);
                }
            }
            meter.advance(triangles.len() as u64);
            meter.record_work(triangles.len() as u64);
        },
    );
}
