//! Shadow rays in another order for the queries: within a chunk of paths light by light. Where they are stored, the rays of one path
//! stand side by side, each towards another light, so no packets are found among them. No answer depends on the order.

use crate::cpu::scatter::by_chunk;
use crate::layout::{Spawned, Surface};
use bytemuck::Zeroable;
use splitplane_core::ray::Ray;

/// Paths of a chunk.
const CHUNK: usize = crate::kernel::CHUNK as usize;

/// The most lights that a surface names.
const LIGHTS: usize = u32::BITS as usize;

/// The rays of a wave in that order; the memory is kept between waves.
#[derive(Debug, Default)]
pub(crate) struct ByLight {
    pub(crate) rays: Vec<Ray>,
    /// The number that each has among those of its chunk where they are stored.
    pub(crate) numbers: Vec<u32>,
}

impl ByLight {
    /// Takes the rays that surfaces asked for; `spawned` says where those of each chunk begin.
    pub(crate) fn take(&mut self, surfaces: &[Surface], spawned: &[Spawned], stored: &[Ray]) {
        if self.rays.len() < stored.len() {
            self.rays.resize(stored.len(), Ray::zeroed());
            self.numbers.resize(stored.len(), 0);
        }
        let start = |chunk: usize| spawned[chunk].shadow_rays as usize;
        let (rays, numbers) = (&mut self.rays[..stored.len()], &mut self.numbers[..stored.len()]);
        by_chunk(0..spawned.len(), &start, rays, numbers, &|chunk, rays, numbers| {
            let stored = &stored[start(chunk).min(stored.len())..][..rays.len()];
            let first = chunk * CHUNK;
            let surfaces = &surfaces[first..surfaces.len().min(first + CHUNK)];
            sort(surfaces, stored, rays, numbers);
        });
    }
}

/// Sorts the rays of a chunk by their lights; those of one light stay in the order of their paths.
fn sort(surfaces: &[Surface], stored: &[Ray], rays: &mut [Ray], numbers: &mut [u32]) {
    let mut places = [0; LIGHTS];
    for surface in surfaces {
        for light in lights(surface) {
            places[light] += 1;
        }
    }
    let mut before = 0;
    for place in &mut places {
        before += core::mem::replace(place, before);
    }
    if before != stored.len() {
        // A void frame, which is made again, has fewer rays than surfaces ask for.
        rays.copy_from_slice(stored);
        numbers.iter_mut().zip(0..).for_each(|(number, place)| *number = place);
        return;
    }
    let mut number = 0;
    for surface in surfaces {
        for light in lights(surface) {
            let place = places[light];
            places[light] += 1;
            (rays[place], numbers[place]) = (stored[number], number as u32);
            number += 1;
        }
    }
}

/// The lights of a surface, in the order in which it asks for rays.
fn lights(surface: &Surface) -> impl Iterator<Item = usize> {
    let mut left = surface.lights;
    core::iter::from_fn(move || {
        let light = left.trailing_zeros() as usize;
        let there = left != 0;
        left &= left.wrapping_sub(1);
        there.then_some(light)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What surfaces ask for: rays that name their path and light, and where those of chunks begin.
    fn asked(masks: &[u32]) -> (Vec<Surface>, Vec<Spawned>, Vec<Ray>) {
        let surfaces: Vec<Surface> =
            masks.iter().map(|&lights| Surface { lights, ..Surface::default() }).collect();
        let (mut rays, mut spawned) = (Vec::new(), Vec::new());
        for (path, &mask) in masks.iter().enumerate() {
            if path % CHUNK == 0 {
                spawned.push(Spawned { shadow_rays: rays.len() as u32, next_paths: 0 });
            }
            for light in (0..32).filter(|light| mask >> light & 1 == 1) {
                rays.push(Ray::new([path as f32, light as f32, 0.0], [1.0, 0.0, 0.0]));
            }
        }
        (surfaces, spawned, rays)
    }

    #[test]
    fn a_chunk_has_the_same_rays_light_by_light() {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            state
        };
        let masks: Vec<u32> =
            (0..3 * CHUNK + 7).map(|i| if i % 3 == 0 { 0 } else { random() & random() }).collect();
        let (surfaces, spawned, stored) = asked(&masks);
        let mut by_light = ByLight::default();
        by_light.take(&surfaces, &spawned, &stored);
        let mut ends: Vec<usize> = spawned[1..].iter().map(|s| s.shadow_rays as usize).collect();
        ends.push(stored.len());
        for (chunk, end) in ends.into_iter().enumerate() {
            let begin = spawned[chunk].shadow_rays as usize;
            let (rays, numbers) = (&by_light.rays[begin..end], &by_light.numbers[begin..end]);
            let mut seen = vec![false; end - begin];
            for (ray, &number) in rays.iter().zip(numbers) {
                assert_eq!(*ray, stored[begin + number as usize]);
                assert!(!std::mem::replace(&mut seen[number as usize], true));
            }
            let keys = rays.iter().map(|ray| (ray.origin[1], ray.origin[0]));
            assert!(keys.is_sorted(), "chunk {chunk}");
        }
    }

    #[test]
    fn a_void_frame_keeps_the_rays_that_it_has() {
        let (surfaces, spawned, stored) = asked(&[7; CHUNK + 1]);
        for count in [0, 5, 3 * CHUNK - 1, 3 * CHUNK, 3 * CHUNK + 2] {
            let mut by_light = ByLight::default();
            by_light.take(&surfaces, &spawned, &stored[..count]);
            assert_eq!(by_light.rays.len(), count);
        }
    }
}
