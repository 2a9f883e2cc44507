//! `triangle_bounds`: one workgroup a chunk of 256 input triangles.
//!
//! Reads: the mesh. Writes: snapped corners of every triangle; for each chunk the number of
//! triangles kept (left) and snapped (right), and the bounds of those kept (left).

use splitplane_core::aabb::Aabb;
use splitplane_core::config::CHUNK;
use splitplane_core::layout::{ChunkBounds, Sides};
use splitplane_core::mesh::Mesh;
use splitplane_core::triangle::{Triangle, prepare};

use super::GRAIN;
use crate::cancel::ProgressMeter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::span;

/// Runs the kernel.
pub(crate) fn run(
    meter: &ProgressMeter<'_>,
    mesh: &Mesh<'_>,
    triangles: &mut [Triangle],
    chunk_counts: &mut [Sides],
    chunk_bounds: &mut [ChunkBounds],
) {
    let _loop = span::pieces_of(GRAIN);
    triangles
        .par_chunks_mut(CHUNK as usize)
        .zip(chunk_counts)
        .zip(chunk_bounds)
        .enumerate()
        .with_min_len(GRAIN)
        .for_each(|(chunk, ((triangles, counts), bounds))| {
            let _piece = span::piece();
            if meter.is_cancelled() {
                return;
            }
            let mut kept = Aabb::EMPTY;
            *counts = Sides::default();
            for (offset, triangle) in triangles.iter_mut().enumerate() {
                let prepared = prepare(&mesh.triangle(chunk * CHUNK as usize + offset));
                *triangle = prepared.corners;
                counts.right += u32::from(prepared.snapped);
                if prepared.kept {
                    counts.left += 1;
                    kept = kept.union(&Aabb::of_points(&prepared.corners));
                }
            }
            *bounds = ChunkBounds { sides: [kept, Aabb::EMPTY] };
            meter.advance(triangles.len() as u64);
            meter.record_work(triangles.len() as u64);
        });
}
