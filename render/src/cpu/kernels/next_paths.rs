//! The reflected and refracted rays of the next wave, in the order of the paths that they continue.

use super::{CHUNK, DIRECT};
use crate::cpu::scatter::by_chunk;
use crate::layout::{Path, Spawned, Surface};
use crate::paths::scatter;
use crate::scene_words::SceneWords;
use crate::surface::{reflect, refract};
use splitplane_core::ray::Ray;

pub(crate) struct Input<'a> {
    pub(crate) scene: SceneWords<'a>,
    /// The wave that the surfaces belong to.
    pub(crate) wave: u32,
    pub(crate) rays: &'a [Ray],
    pub(crate) paths: &'a [Path],
    pub(crate) surfaces: &'a [Surface],
    pub(crate) spawned: &'a [Spawned],
}

pub(crate) fn run(input: &Input<'_>, next_rays: &mut [Ray], next_paths: &mut [Path]) {
    let start = |chunk: usize| input.spawned[chunk].next_paths as usize;
    by_chunk(0..input.spawned.len(), &start, next_rays, next_paths, &|chunk, rays, paths| {
        let mut out = rays.iter_mut().zip(paths);
        let mut put = |next: (Ray, Path)| {
            if let Some((ray, path)) = out.next() {
                (*ray, *path) = next;
            }
        };
        let first = chunk * CHUNK;
        let last = input.surfaces.len().min(first + CHUNK);
        for i in first..last {
            let (ray, path, surface) = (&input.rays[i], &input.paths[i], &input.surfaces[i]);
            if input.scene.frame.transport != DIRECT {
                if surface.flags & Surface::REFLECTS != 0
                    && let Some(next) = scatter(&input.scene, ray, path, surface, input.wave)
                {
                    put(next);
                }
                continue;
            }
            if surface.flags & Surface::REFLECTS != 0 {
                put(reflect(&input.scene, ray, path, surface));
            }
            if surface.flags & Surface::REFRACTS != 0 {
                put(refract(&input.scene, ray, path, surface));
            }
        }
    });
}
