//! The order in which shadow rays stand: within a chunk of paths light by light, and towards one light in the order of paths. In the
//! order of paths, in which devices have them, neighbours go to different lights, so no packets are found among them. No answer depends on
//! the order.

use crate::layout::{Spawned, Surface};

/// Paths of a chunk.
const CHUNK: usize = crate::kernel::CHUNK as usize;

/// The most lights that a surface names.
const LIGHTS: usize = u32::BITS as usize;

/// Where the rays of a chunk of paths stand among those of the chunk.
#[derive(Clone, Copy)]
pub(crate) struct Places {
    /// Where the next ray towards each light stands.
    next: [usize; LIGHTS],
    /// Whether they stand in the order of paths.
    by_path: bool,
}

impl Places {
    /// Those of the chunk of these surfaces, which has so many rays. A void frame, which is made again, has fewer than
    /// surfaces ask for: there they stand in the order of paths, so that it is the last ones that are not there.
    pub(crate) fn of(surfaces: &[Surface], rays: usize) -> Places {
        let mut masks = [0; CHUNK];
        let mut asked = 0;
        for (mask, surface) in masks.iter_mut().zip(surfaces) {
            *mask = surface.lights;
            asked |= surface.lights;
        }
        let mut next = [0; LIGHTS];
        for light in lights(asked) {
            next[light] = masks.iter().map(|mask| mask >> light & 1).sum::<u32>() as usize;
        }
        let mut before = 0;
        for place in &mut next {
            before += core::mem::replace(place, before);
        }
        Places { next, by_path: before != rays }
    }

    /// Whether they stand in the order of paths.
    pub(crate) fn is_by_path(&self) -> bool {
        self.by_path
    }

    /// Where the next ray towards a light stands. Paths ask one after the other, each for its lights in their order.
    pub(crate) fn next(&mut self, light: usize) -> usize {
        // In the order of paths all are counted together; those of light 0 begin at 0.
        let place = &mut self.next[if self.by_path { 0 } else { light }];
        *place += 1;
        *place - 1
    }

    /// Where the rays towards a light begin, before any was asked for.
    pub(crate) fn first(&self, light: usize) -> usize {
        self.next[light]
    }
}

/// The lights of a mask, in their order.
pub(crate) fn lights(mask: u32) -> impl Iterator<Item = usize> {
    let mut left = mask;
    core::iter::from_fn(move || {
        let light = left.trailing_zeros() as usize;
        let there = left != 0;
        left &= left.wrapping_sub(1);
        there.then_some(light)
    })
}

/// The surfaces of a chunk.
pub(crate) fn surfaces_of(surfaces: &[Surface], chunk: usize) -> &[Surface] {
    let first = surfaces.len().min(chunk * CHUNK);
    &surfaces[first..surfaces.len().min(first + CHUNK)]
}

/// Where the rays of a chunk stand among `rays`.
pub(crate) fn rays_of(spawned: &[Spawned], chunk: usize, rays: usize) -> core::ops::Range<usize> {
    let start = |chunk: usize| spawned.get(chunk).map_or(rays, |s| s.shadow_rays as usize);
    start(chunk).min(rays)..start(chunk + 1).min(rays)
}

/// What belongs to shadow rays, in the order of paths and lights, as devices have it.
pub(crate) fn by_path<T: Copy>(
    surfaces: &[Surface],
    spawned: &[Spawned],
    by_light: &[T],
) -> Vec<T> {
    let mut all = Vec::with_capacity(by_light.len());
    for chunk in 0..spawned.len() {
        let own = &by_light[rays_of(spawned, chunk, by_light.len())];
        let surfaces = surfaces_of(surfaces, chunk);
        let mut places = Places::of(surfaces, own.len());
        for surface in surfaces {
            let asked = lights(surface.lights).map(|light| places.next(light));
            all.extend(asked.filter_map(|place| own.get(place)));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Surfaces that ask for these lights, where those of chunks begin, and (path, light) of each ray in the order of paths.
    fn asked(masks: &[u32]) -> (Vec<Surface>, Vec<Spawned>, Vec<(usize, usize)>) {
        let surfaces: Vec<Surface> =
            masks.iter().map(|&lights| Surface { lights, ..Surface::default() }).collect();
        let (mut rays, mut spawned) = (Vec::new(), Vec::new());
        for (path, &mask) in masks.iter().enumerate() {
            if path % CHUNK == 0 {
                spawned.push(Spawned { shadow_rays: rays.len() as u32, next_paths: 0 });
            }
            rays.extend((0..32).filter(|light| mask >> light & 1 == 1).map(|light| (path, light)));
        }
        (surfaces, spawned, rays)
    }

    fn masks() -> Vec<u32> {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            state
        };
        (0..3 * CHUNK + 7).map(|i| if i % 3 == 0 { 0 } else { random() & random() }).collect()
    }

    #[test]
    fn a_chunk_has_its_rays_light_by_light() {
        let (surfaces, spawned, stored) = asked(&masks());
        let mut ordered = vec![None; stored.len()];
        for chunk in 0..spawned.len() {
            let own = rays_of(&spawned, chunk, stored.len());
            let mut places = Places::of(surfaces_of(&surfaces, chunk), own.len());
            assert!(!places.is_by_path());
            let firsts = [0, 1, 31].map(|light| places.first(light));
            for &(path, light) in &stored[own.clone()] {
                let place = own.start + places.next(light);
                assert!(ordered[place].replace((light, path)).is_none());
            }
            let part: Vec<_> = ordered[own].iter().map(|ray| ray.expect("all are there")).collect();
            assert!(part.is_sorted(), "chunk {chunk}");
            for (light, first) in [0, 1, 31].into_iter().zip(firsts) {
                assert_eq!(first, part.iter().filter(|ray| ray.0 < light).count());
            }
        }
        let ordered: Vec<_> =
            ordered.into_iter().flatten().map(|(light, path)| (path, light)).collect();
        assert_ne!(ordered, stored);
        assert_eq!(by_path(&surfaces, &spawned, &ordered), stored);
    }

    #[test]
    fn a_void_frame_keeps_the_first_rays() {
        let (surfaces, spawned, stored) = asked(&[7; CHUNK + 1]);
        for count in [0, 5, 3 * CHUNK - 1, 3 * CHUNK, 3 * CHUNK + 2] {
            let mut ordered = vec![None; count];
            for chunk in 0..spawned.len() {
                let own = rays_of(&spawned, chunk, count);
                let mut places = Places::of(surfaces_of(&surfaces, chunk), own.len());
                for path in chunk * CHUNK..surfaces.len().min((chunk + 1) * CHUNK) {
                    for light in 0..3 {
                        if let Some(ray) = ordered[own.clone()].get_mut(places.next(light)) {
                            *ray = Some((path, light));
                        }
                    }
                }
            }
            let ordered: Vec<_> = ordered.into_iter().map(|ray| ray.expect("no gaps")).collect();
            assert_eq!(by_path(&surfaces, &spawned, &ordered), stored[..count]);
        }
    }
}
