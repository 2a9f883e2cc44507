//! Sums the light of the paths, pixel by pixel. Paths are stored in the order of their pixels, so
//! those of one pixel are neighbours.

use super::CHUNK;
use crate::cpu::by_light::{Places, lights as asked_lights, rays_of, surfaces_of};
use crate::cpu::scatter::by_chunk;
use crate::layout::{Frame, Path, Spawned, Surface};
use crate::vector::{Vector, add, scaled};

pub(crate) struct Input<'a> {
    pub(crate) frame: &'a Frame,
    pub(crate) paths: &'a [Path],
    pub(crate) surfaces: &'a [Surface],
    /// Empty when no shadow rays are cast.
    pub(crate) spawned: &'a [Spawned],
    pub(crate) lights: &'a [[f32; 4]],
}

pub(crate) fn run(input: &Input<'_>, radiance: &mut [[f32; 4]]) {
    let Input { paths, surfaces, .. } = *input;
    // The first path of a pixel sums for all of them.
    let begins = |path: usize| path == 0 || paths[path - 1].pixel != paths[path].pixel;
    // The first pixel that a chunk writes; chunks that only continue a pixel write none.
    let first = |chunk: usize| {
        let path = chunk * CHUNK;
        paths[path].pixel as usize + usize::from(!begins(path))
    };
    let chunks = paths.len().div_ceil(CHUNK);
    let base = paths[0].pixel as usize;
    by_chunk(0..chunks, &first, &mut radiance[base..], &mut [(); 0], &|chunk, radiance, _| {
        let base = first(chunk);
        let mut brought = Brought::at(input, chunk);
        let last = paths.len().min((chunk + 1) * CHUNK);
        let mut path = chunk * CHUNK;
        while path < last {
            if !begins(path) {
                brought.of(path).for_each(drop);
                path += 1;
                continue;
            }
            let pixel = paths[path].pixel;
            let mut sum: Vector = [0.0; 3];
            let mut unfinished = 0.0;
            while path < paths.len() && paths[path].pixel == pixel {
                let surface = &surfaces[path];
                sum = add(sum, surface.light);
                if surface.flags & Surface::UNFINISHED != 0 {
                    unfinished += 1.0;
                }
                for [r, g, b, w] in brought.of(path) {
                    sum = add(sum, [r, g, b]);
                    unfinished += w;
                }
                path += 1;
            }
            let [r, g, b, w] = radiance[pixel as usize - base];
            let [r, g, b] = add([r, g, b], scaled(sum, input.frame.sample_weight));
            radiance[pixel as usize - base] = [r, g, b, w + unfinished];
        }
    });
}

/// The light that shadow rays brought, path after path.
struct Brought<'a> {
    input: &'a Input<'a>,
    /// The chunk of the next path.
    chunk: usize,
    lights: &'a [[f32; 4]],
    places: Places,
}

impl<'a> Brought<'a> {
    /// From the first path of a chunk on.
    fn at(input: &'a Input<'a>, chunk: usize) -> Brought<'a> {
        let lights = match input.spawned {
            [] => &[],
            spawned => &input.lights[rays_of(spawned, chunk, input.lights.len())],
        };
        let places = Places::of(surfaces_of(input.surfaces, chunk), lights.len());
        Brought { input, chunk, lights, places }
    }

    /// Those of the next path, which must be this one, light by light.
    fn of(&mut self, path: usize) -> impl Iterator<Item = [f32; 4]> + use<'_, 'a> {
        if path / CHUNK != self.chunk {
            *self = Brought::at(self.input, path / CHUNK);
        }
        // Paths beyond the capacity, in a void frame, have none.
        asked_lights(self.input.surfaces[path].lights)
            .map(|light| self.lights.get(self.places.next(light)).copied().unwrap_or_default())
    }
}
