//! Removes the light of shadow rays that hit something.

use super::CHUNK;
use crate::cpu::traced::Traced;
use rayon::prelude::*;
use splitplane_core::error::QueryError;
use splitplane_core::ray::{QueryOptions, Ray};

/// Rays that a thread takes at a time.
const TASK: usize = 16 * CHUNK;

pub(crate) fn run(
    traced: Traced<'_>,
    options: &QueryOptions<'_>,
    rays: &[Ray],
    lights: &mut [[f32; 4]],
    occluded: &mut Vec<bool>,
) -> Result<(), QueryError> {
    if occluded.len() < rays.len() {
        occluded.resize(rays.len(), false);
    }
    let occluded = &mut occluded[..rays.len()];
    traced.any_hits(rays, occluded, options)?;
    lights.par_chunks_mut(TASK).zip(occluded.par_chunks(TASK)).for_each(|(lights, occluded)| {
        for (light, occluded) in lights.iter_mut().zip(occluded) {
            if *occluded {
                *light = [0.0; 4];
            }
        }
    });
    Ok(())
}
