//! Computes what every path's ray met, and which rays it asks for.

use super::{CHUNK, DIRECT};
use crate::cpu::columns::{Facing, HITS, Hits};
use crate::layout::{Path, Spawned, Surface};
use crate::lighting::may_be_lit;
use crate::paths;
use crate::scene_words::SceneWords;
use crate::surface::{Place, missed, shade, shade_met};
use crate::world::{Spot, World};
use rayon::prelude::*;
use splitplane_core::ray::{Hit, Ray};
use splitplane_float_state::Standard;

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
        let _state = Standard::set();
        let first = chunk * CHUNK;
        if input.scene.frame.transport == DIRECT {
            direct(input, first, surfaces);
        } else {
            for (surface, i) in surfaces.iter_mut().zip(first..) {
                let (ray, met) = ((&input.rays[i], &input.paths[i]), input.met(i));
                *surface = paths::shade(&input.scene, input.world, ray, met, input.wave);
            }
        }
        let mut sum = Spawned::default();
        for surface in surfaces {
            sum.shadow_rays += surface.shadow_rays();
            sum.next_paths += surface.next_paths();
        }
        *spawned = sum;
    });
}

impl<W> Input<'_, W> {
    /// What the ray of a path met, and of which instance.
    fn met(&self, path: usize) -> (&Hit, u32) {
        (&self.hits[path], self.instances.get(path).copied().unwrap_or(0))
    }
}

/// Direct light of the paths from `first` on, at most a chunk. Where rays met triangles of one mesh, and which lights without a size are on
/// the side of a surface, is found for many together.
fn direct<W: World>(input: &Input<'_, W>, first: usize, surfaces: &mut [Surface]) {
    let Input { scene, world, wave, .. } = input;
    let lights = scene.frame.lights;
    let (mut facing, mut hits) = (Facing::NONE, Hits::NONE);
    for (part, surfaces) in surfaces.chunks_mut(HITS).enumerate() {
        hits.clear();
        let begin = part * HITS;
        // The numbers of the surfaces whose hits are columns.
        let (mut numbers, mut count) = ([0; HITS], 0);
        for (lane, surface) in surfaces.iter_mut().enumerate() {
            let i = first + begin + lane;
            let (ray, path, (hit, instance)) = (&input.rays[i], &input.paths[i], input.met(i));
            if !hit.is_hit() {
                *surface = missed(scene, ray, path);
            } else if let Some(corners) = world.corners_alone(hit.triangle) {
                let normals = scene.has_normals().then(|| scene.corner_normals(hit.triangle));
                hits.push(&corners, normals.as_ref(), ray.direction, [hit.u, hit.v]);
                numbers[count] = lane;
                count += 1;
            } else {
                let met = (hit, instance);
                let scatters;
                (*surface, scatters) = shade(scene, *world, (ray, path), met, (*wave, lights));
                if scatters && lights > 0 {
                    facing.push(begin + lane, surface);
                }
            }
        }
        hits.meet(scene.has_normals());
        for (lane, &number) in numbers[..count].iter().enumerate() {
            let i = first + begin + number;
            let (ray, path, (hit, instance)) = (&input.rays[i], &input.paths[i], input.met(i));
            let at = Spot { triangle: hit.triangle, instance };
            let material = world.material(scene, at);
            let (mut surface, from_front) = hits.surface(lane, material, scene.has_normals());
            let weights = [(1.0 - hit.u) - hit.v, hit.u, hit.v];
            let place = Place { described: world.described(at), weights, from_front };
            if shade_met(&mut surface, scene, &place, ray.direction, path, *wave) {
                surface.lights = may_be_lit(scene, *world, &surface, path, (*wave, lights));
                if lights > 0 {
                    facing.push(begin + number, &surface);
                }
            }
            surfaces[number] = surface;
        }
    }
    facing.ask(scene, surfaces);
}
