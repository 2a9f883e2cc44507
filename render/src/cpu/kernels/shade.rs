//! Computes what every path's ray met, and which rays it asks for.

use super::{CHUNK, DIRECT};
use crate::layout::{Path, Spawned, Surface};
use crate::paths;
use crate::scene_words::SceneWords;
use crate::surface;
use crate::world::World;
use rayon::prelude::*;
use splitplane_core::ray::{Hit, Ray};

pub(crate) struct Input<'a, W> {
    pub(crate) scene: SceneWords<'a>,
    pub(crate) world: W,
    pub(crate) wave: u32,
    pub(crate) rays: &'a [Ray],
    pub(crate) paths: &'a [Path],
    pub(crate) hits: &'a [Hit],
    /// The instances that were hit; empty in one mesh.
    pub(crate) instances: &'a [u32],
}

pub(crate) fn run<W: World>(
    input: &Input<'_, W>,
    surfaces: &mut [Surface],
    spawned: &mut [Spawned],
) {
    let chunks = surfaces.par_chunks_mut(CHUNK).zip(spawned).enumerate();
    chunks.for_each(|(chunk, (surfaces, spawned))| {
        let mut sum = Spawned::default();
        for (lane, surface) in surfaces.iter_mut().enumerate() {
            let i = chunk * CHUNK + lane;
            let (ray, path, hit) = (&input.rays[i], &input.paths[i], &input.hits[i]);
            let instance = input.instances.get(i).copied().unwrap_or(0);
            let (met, wave) = ((hit, instance), input.wave);
            *surface = if input.scene.frame.transport == DIRECT {
                surface::shade(&input.scene, input.world, (ray, path), met, wave)
            } else {
                paths::shade(&input.scene, input.world, (ray, path), met, wave)
            };
            sum.shadow_rays += surface.shadow_rays();
            sum.next_paths += surface.next_paths();
        }
        *spawned = sum;
    });
}
