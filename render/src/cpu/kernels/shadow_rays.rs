//! A ray towards every light that may light a surface, in the order of paths and lights.

use super::{CHUNK, DIRECT};
use crate::cpu::scatter::by_chunk;
use crate::layout::{Path, Spawned, Surface};
use crate::lighting::shadow_ray;
use crate::paths::connect;
use crate::scene_words::SceneWords;
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
        let mut out = rays.iter_mut().zip(lights);
        let first = chunk * CHUNK;
        let last = input.surfaces.len().min(first + CHUNK);
        for (surface, path) in input.surfaces[first..last].iter().zip(&input.paths[first..last]) {
            let mut left = surface.lights;
            while left != 0 {
                let sample = left.trailing_zeros();
                left &= left - 1;
                let Some((ray, light)) = out.next() else { return };
                let (scene, world, wave) = (&input.scene, input.world, input.wave);
                let (cast, [r, g, b]) = if scene.frame.transport == DIRECT {
                    shadow_ray(scene, world, surface, path, wave, sample)
                } else {
                    // Shade asked for those that bring light.
                    connect(scene, world, surface, path, wave, sample)
                        .unwrap_or((Ray::zeroed(), [0.0; 3]))
                };
                (*ray, *light) = (cast, [r, g, b, 0.0]);
            }
        }
    });
}
