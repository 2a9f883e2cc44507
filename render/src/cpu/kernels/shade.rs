//! Computes what every path's ray met, and which rays it asks for.

use super::CHUNK;
use crate::layout::{Path, Spawned, Surface};
use crate::scene_words::SceneWords;
use crate::surface;
use rayon::prelude::*;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::traverse::Triangles;
use splitplane_core::ray::{Hit, Ray};

pub(crate) struct Input<'a> {
    pub(crate) scene: SceneWords<'a>,
    pub(crate) mesh: Mesh<'a>,
    pub(crate) wave: u32,
    pub(crate) rays: &'a [Ray],
    pub(crate) paths: &'a [Path],
    pub(crate) hits: &'a [Hit],
}

pub(crate) fn run(input: &Input<'_>, surfaces: &mut [Surface], spawned: &mut [Spawned]) {
    let corners = |triangle| input.mesh.corners(triangle);
    let chunks = surfaces.par_chunks_mut(CHUNK).zip(spawned).enumerate();
    chunks.for_each(|(chunk, (surfaces, spawned))| {
        let mut sum = Spawned::default();
        for (lane, surface) in surfaces.iter_mut().enumerate() {
            let i = chunk * CHUNK + lane;
            let (ray, path, hit) = (&input.rays[i], &input.paths[i], &input.hits[i]);
            *surface = surface::shade(&input.scene, corners, ray, path, hit, input.wave);
            sum.shadow_rays += surface.shadow_rays();
            sum.next_paths += surface.next_paths();
        }
        *spawned = sum;
    });
}
