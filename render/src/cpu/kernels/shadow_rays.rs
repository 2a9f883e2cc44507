//! A ray towards every light that may light a surface, chunk by chunk, and within a chunk light by light: see [`by_light`](crate::cpu::by_light).

use super::{CHUNK, DIRECT};
use crate::cpu::by_light::{Places, lights as asked_lights, surfaces_of};
use crate::cpu::columns::Lit;
use crate::cpu::scatter::by_chunk;
use crate::layout::{Path, Spawned, Surface};
use crate::lighting::shadow_ray;
use crate::paths::connect;
use crate::scene_data::DIRECTIONAL;
use crate::scene_words::SceneWords;
use crate::vector::{mul, scaled};
use crate::world::World;
use bytemuck::Zeroable;
use splitplane_core::ray::Ray;

pub(crate) struct Input<'a, W> {
    pub(crate) scene: SceneWords<'a>,
    pub(crate) world: W,
    /// The wave that the surfaces belong to.
    pub(crate) wave: u32,
    pub(crate) paths: &'a [Path],
    pub(crate) surfaces: &'a [Surface],
    pub(crate) spawned: &'a [Spawned],
}

pub(crate) fn run<W: World>(input: &Input<'_, W>, rays: &mut [Ray], lights: &mut [[f32; 4]]) {
    let start = |chunk: usize| input.spawned[chunk].shadow_rays as usize;
    by_chunk(0..input.spawned.len(), &start, rays, lights, &|chunk, rays, lights| {
        let surfaces = surfaces_of(input.surfaces, chunk);
        let paths = &input.paths[chunk * CHUNK..][..surfaces.len()];
        let chunk = Chunk { input, surfaces, paths, places: Places::of(surfaces, rays.len()) };
        if input.scene.frame.transport == DIRECT && !chunk.places.is_by_path() {
            chunk.light_by_light(rays, lights);
        } else {
            chunk.path_by_path(rays, lights);
        }
    });
}

/// A chunk of paths whose rays are made.
struct Chunk<'a, W> {
    input: &'a Input<'a, W>,
    surfaces: &'a [Surface],
    paths: &'a [Path],
    places: Places,
}

impl<W: World> Chunk<'_, W> {
    /// Lights without a size for all surfaces together, other samples surface by surface.
    fn light_by_light(&self, rays: &mut [Ray], lights: &mut [[f32; 4]]) {
        let Input { scene, .. } = self.input;
        let mut lit = Lit::of(self.surfaces, self.paths);
        for sample in asked_lights(lit.asked()) {
            let mut place = self.places.first(sample);
            let mut put = |ray, [r, g, b]: [f32; 3]| {
                (rays[place], lights[place]) = (ray, [r, g, b, 0.0]);
                place += 1;
            };
            if sample >= scene.frame.lights as usize {
                for (surface, path) in self.surfaces.iter().zip(self.paths) {
                    if surface.lights >> sample & 1 == 1 {
                        let (ray, light) = self.ray(surface, path, sample);
                        put(ray, light);
                    }
                }
                continue;
            }
            let light = scene.light(sample as u32);
            let (place, irradiance) = (light.place, light.irradiance);
            let is_directional = light.kind == DIRECTIONAL;
            lit.each(sample, &light, |start, albedo, share| {
                let ray = match is_directional {
                    true => Ray::new(start, place),
                    false => Ray::segment(start, place),
                };
                put(ray, mul(albedo, scaled(irradiance, share)));
            });
        }
    }

    fn path_by_path(mut self, rays: &mut [Ray], lights: &mut [[f32; 4]]) {
        for (surface, path) in self.surfaces.iter().zip(self.paths) {
            for sample in asked_lights(surface.lights) {
                let place = self.places.next(sample);
                // In a void frame the last ones have no place.
                let Some(ray) = rays.get_mut(place) else { return };
                let [r, g, b];
                (*ray, [r, g, b]) = self.ray(surface, path, sample);
                lights[place] = [r, g, b, 0.0];
            }
        }
    }

    fn ray(&self, surface: &Surface, path: &Path, sample: usize) -> (Ray, [f32; 3]) {
        let Input { scene, world, wave, .. } = self.input;
        if scene.frame.transport == DIRECT {
            return shadow_ray(scene, *world, surface, path, *wave, sample as u32);
        }
        // Shade asked for those that bring light.
        let connected = connect(scene, *world, surface, path, *wave, sample as u32);
        connected.unwrap_or((Ray::zeroed(), [0.0; 3]))
    }
}
