//! Removes the light of shadow rays that hit something opaque; clear surfaces only tint it. Light
//! goes straight through them: no lens gathers it.

use crate::cpu::by_light::rays_of;
use crate::cpu::traced::Traced;
use crate::layout::Spawned;
use crate::scene_data::DIELECTRIC;
use crate::scene_words::SceneWords;
use crate::surface::{MOST_CLEAR_LAYERS, after};
use crate::vector::{greatest, mul};
use crate::world::{Spot, World};
use bytemuck::Zeroable;
use rayon::prelude::*;
use splitplane_core::error::QueryError;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::scene::SceneHit;
use splitplane_float_state::Standard;

/// Chunks that a thread takes at a time.
const CHUNKS: usize = 8;

/// Rays that have passed clear surfaces, and what rays met; kept between waves.
pub(crate) struct Met<'a> {
    pub(crate) rays: &'a mut Vec<Ray>,
    /// The number of each among those of its chunk.
    pub(crate) numbers: &'a mut Vec<u32>,
    pub(crate) hits: &'a mut Vec<Hit>,
    pub(crate) scene_hits: &'a mut Vec<SceneHit>,
    pub(crate) instances: &'a mut Vec<u32>,
}

/// The rays of a chunk of paths that are still under way, and the light of all its rays.
struct Part<'a> {
    /// All of the chunk, before the first of them has passed anything; later none.
    all: &'a [Ray],
    rays: &'a mut [Ray],
    numbers: &'a mut [u32],
    hits: &'a [Hit],
    /// Empty in one mesh.
    instances: &'a [u32],
    lights: &'a mut [[f32; 4]],
    /// How many go on.
    kept: usize,
}

pub(crate) fn run(
    traced: Traced<'_>,
    options: &QueryOptions<'_>,
    scene: &SceneWords<'_>,
    world: impl World,
    (stored, spawned): (&[Ray], &[Spawned]),
    lights: &mut [[f32; 4]],
    met: Met<'_>,
) -> Result<(), QueryError> {
    let Met { rays, numbers, hits, scene_hits, instances } = met;
    if rays.len() < stored.len() {
        rays.resize(stored.len(), Ray::zeroed());
        numbers.resize(stored.len(), 0);
    }
    if hits.len() < stored.len() {
        hits.resize(stored.len(), Hit::MISS);
    }
    let stored_counts: Vec<usize> =
        (0..spawned.len()).map(|chunk| rays_of(spawned, chunk, stored.len()).len()).collect();
    let mut counts = stored_counts.clone();
    let mut count = stored.len();
    for layer in 0..=MOST_CLEAR_LAYERS {
        let hits = &mut hits[..count];
        // The rays as they are stored stay what they are: those that go on are copied.
        let mut all = if layer == 0 { stored } else { &[] };
        let under_way = if layer == 0 { stored } else { &rays[..count] };
        traced.closest_hits(under_way, hits, (&mut *scene_hits, &mut *instances), options)?;
        let mut parts = Vec::with_capacity(counts.len());
        let mut rest = (&mut rays[..], &mut numbers[..], &*hits, &instances[..], &mut *lights);
        for (&stored, &count) in stored_counts.iter().zip(&counts) {
            let (rays, rays_left) = rest.0.split_at_mut(count);
            let (numbers, numbers_left) = rest.1.split_at_mut(count);
            let (hits, hits_left) = rest.2.split_at(count);
            let (instances, instances_left) = rest.3.split_at(count.min(rest.3.len()));
            let (lights, lights_left) = rest.4.split_at_mut(stored);
            let (own, all_left) = all.split_at(count.min(all.len()));
            all = all_left;
            parts.push(Part { all: own, rays, numbers, hits, instances, lights, kept: 0 });
            rest = (rays_left, numbers_left, hits_left, instances_left, lights_left);
        }
        let last = layer == MOST_CLEAR_LAYERS;
        parts.par_iter_mut().with_min_len(CHUNKS).for_each(|part| {
            let _state = Standard::set();
            part.pass(scene, world, last);
        });
        let kept: Vec<usize> = parts.into_iter().map(|part| part.kept).collect();
        let (mut from, mut to) = (0, 0);
        for (count, kept) in counts.iter_mut().zip(kept) {
            rays.copy_within(from..from + kept, to);
            numbers.copy_within(from..from + kept, to);
            (from, to) = (from + *count, to + kept);
            *count = kept;
        }
        count = to;
        if count == 0 {
            break;
        }
    }
    Ok(())
}

impl Part<'_> {
    /// Tints or removes the light of rays that hit something, and moves those that go on to the front. `last` says that no more
    /// clear surfaces are passed.
    fn pass(&mut self, scene: &SceneWords<'_>, world: impl World, last: bool) {
        for (i, &hit) in self.hits.iter().enumerate() {
            if !hit.is_hit() {
                continue;
            }
            let (ray, number) = match self.all.get(i) {
                Some(ray) => (*ray, i as u32),
                None => (self.rays[i], self.numbers[i]),
            };
            let light = &mut self.lights[number as usize];
            let instance = self.instances.get(i).copied().unwrap_or(0);
            let material = world.material(scene, Spot { triangle: hit.triangle, instance });
            if last || scene.material_kind(material) != DIELECTRIC {
                *light = [0.0; 4];
                continue;
            }
            let tint = scene.second_colour(material);
            let [r, g, b] = mul([light[0], light[1], light[2]], tint);
            *light = [r, g, b, 0.0];
            if greatest([r, g, b]) > 0.0 {
                self.rays[self.kept] = ray.with_limits(after(hit.t), ray.t_max);
                self.numbers[self.kept] = number;
                self.kept += 1;
            }
        }
    }
}
