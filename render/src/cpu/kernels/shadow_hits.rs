//! Removes the light of shadow rays that hit something.

use crate::cpu::traced::Traced;
use rayon::prelude::*;
use splitplane_core::error::QueryError;
use splitplane_core::ray::{QueryOptions, Ray};

pub(crate) fn run(
    traced: Traced<'_>,
    options: &QueryOptions<'_>,
    rays: &[Ray],
    lights: &mut [[f32; 4]],
    occluded: &mut Vec<bool>,
) -> Result<(), QueryError> {
    occluded.clear();
    occluded.resize(rays.len(), false);
    traced.any_hits(rays, occluded, options)?;
    let pairs = lights.par_iter_mut().zip(&*occluded).with_min_len(4096);
    pairs.filter(|(_, occluded)| **occluded).for_each(|(light, _)| *light = [0.0; 4]);
    Ok(())
}
