//! Removes the light of shadow rays that hit something.

use crate::cpu::by_light::ByLight;
use crate::cpu::scatter::by_chunk;
use crate::cpu::traced::Traced;
use crate::layout::{Spawned, Surface};
use splitplane_core::error::QueryError;
use splitplane_core::ray::{QueryOptions, Ray};

/// The rays of a wave, and who asked for them.
pub(crate) struct Input<'a> {
    pub(crate) surfaces: &'a [Surface],
    /// Where the rays of each chunk begin.
    pub(crate) spawned: &'a [Spawned],
    pub(crate) rays: &'a [Ray],
}

pub(crate) fn run(
    traced: Traced<'_>,
    options: &QueryOptions<'_>,
    input: &Input<'_>,
    lights: &mut [[f32; 4]],
    (by_light, occluded): (&mut ByLight, &mut Vec<bool>),
) -> Result<(), QueryError> {
    let Input { surfaces, spawned, rays } = *input;
    by_light.take(surfaces, spawned, rays);
    let (ordered, numbers) = (&by_light.rays[..rays.len()], &by_light.numbers[..rays.len()]);
    if occluded.len() < rays.len() {
        occluded.resize(rays.len(), false);
    }
    let occluded = &mut occluded[..rays.len()];
    traced.any_hits(ordered, occluded, options)?;
    let start = |chunk: usize| spawned[chunk].shadow_rays as usize;
    by_chunk(0..spawned.len(), &start, lights, occluded, &|chunk, lights, occluded| {
        let numbers = &numbers[start(chunk).min(numbers.len())..];
        for (&occluded, &number) in occluded.iter().zip(numbers) {
            if occluded {
                lights[number as usize] = [0.0; 4];
            }
        }
    });
    Ok(())
}
