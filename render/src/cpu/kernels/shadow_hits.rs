//! Puts out the light of shadow rays that hit something.
//!
//! The queue goes from path to path, and each path's rays go to different lights. Rays of neighbours to
//! the same light have much of their way in common, so this executor traces each chunk's rays light by
//! light.

use super::CHUNK;
use crate::cpu::scatter::by_chunk;
use crate::layout::{Spawned, Surface};
use crate::settings::MAX_SHADOW_RAYS;
use bytemuck::Zeroable;
use splitplane_core::backend::{Accelerator, QueryError};
use splitplane_core::ray::{QueryOptions, Ray};

pub(crate) struct Input<'a> {
    pub(crate) accelerator: &'a dyn Accelerator,
    pub(crate) options: QueryOptions,
    pub(crate) surfaces: &'a [Surface],
    pub(crate) spawned: &'a [Spawned],
    pub(crate) rays: &'a [Ray],
}

/// `sorted` and `occluded` are the executor's own.
pub(crate) fn run(
    input: &Input<'_>,
    lights: &mut [[f32; 4]],
    sorted: &mut Vec<Ray>,
    occluded: &mut Vec<bool>,
) -> Result<(), QueryError> {
    let count = input.rays.len();
    if sorted.len() < count {
        sorted.resize(count, Ray::zeroed());
        occluded.resize(count, false);
    }
    let (sorted, occluded) = (&mut sorted[..count], &mut occluded[..count]);
    let start = |chunk: usize| input.spawned[chunk].shadow_rays as usize;
    let chunks = input.spawned.len();
    by_chunk(0..chunks, &start, sorted, &mut [(); 0], &|chunk, sorted, _| {
        let rays = &input.rays[start(chunk)..];
        light_by_light(input, chunk, |ray, place| {
            // Beyond the room of a frame that is void there is none.
            if let (Some(to), Some(from)) = (sorted.get_mut(place), rays.get(ray)) {
                *to = *from;
            }
        });
    });
    input.accelerator.any_hits(sorted, occluded, &input.options)?;
    by_chunk(0..chunks, &start, lights, &mut [(); 0], &|chunk, lights, _| {
        let occluded = &occluded[start(chunk)..];
        light_by_light(input, chunk, |ray, place| {
            if let (Some(light), Some(true)) = (lights.get_mut(ray), occluded.get(place)) {
                *light = [0.0; 4];
            }
        });
    });
    Ok(())
}

/// Calls `visit` with the place of every ray of a chunk in the queue, and its place light by light.
fn light_by_light(input: &Input<'_>, chunk: usize, mut visit: impl FnMut(usize, usize)) {
    let first = chunk * CHUNK;
    let surfaces = &input.surfaces[first..input.surfaces.len().min(first + CHUNK)];
    let mut places = [0usize; MAX_SHADOW_RAYS as usize];
    for surface in surfaces {
        for light in lights_of(surface) {
            places[light] += 1;
        }
    }
    let mut sum = 0;
    for place in &mut places {
        sum += core::mem::replace(place, sum);
    }
    for (ray, light) in surfaces.iter().flat_map(lights_of).enumerate() {
        visit(ray, places[light]);
        places[light] += 1;
    }
}

/// The light samples that a surface asks, in order.
fn lights_of(surface: &Surface) -> impl Iterator<Item = usize> + use<> {
    let mut left = surface.lights;
    core::iter::from_fn(move || {
        let light = left.trailing_zeros();
        left &= left.wrapping_sub(1);
        (light < 32).then_some(light as usize)
    })
}
