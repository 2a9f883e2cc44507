//! The memory of a frame, kept between frames.

use super::by_light::by_path;
use crate::kernel::{Buffer, Counter};
use crate::layout::{Counters, FirstCost, FirstHit, Path, Spawned, Surface};
use crate::plan::Plan;
use bytemuck::Zeroable;
use splitplane_core::ray::{Hit, Ray};
use splitplane_core::scene::SceneHit;

/// The buffers that kernels exchange.
#[derive(Debug, Default)]
pub struct Buffers {
    pub(crate) rays: Vec<Ray>,
    pub(crate) paths: Vec<Path>,
    pub(crate) next_rays: Vec<Ray>,
    pub(crate) next_paths: Vec<Path>,
    pub(crate) hits: Vec<Hit>,
    pub(crate) surfaces: Vec<Surface>,
    pub(crate) spawned: Vec<Spawned>,
    /// Within a chunk light by light, where devices have them path by path; so has the light that they bring.
    pub(crate) shadow_rays: Vec<Ray>,
    pub(crate) shadow_light: Vec<[f32; 4]>,
    pub(crate) radiance: Vec<[f32; 4]>,
    pub(crate) first_hits: Vec<FirstHit>,
    pub(crate) first_costs: Vec<FirstCost>,
    pub(crate) pixels: Vec<u32>,
    pub(crate) counters: Counters,
    /// The hits of shadow rays; only this executor has them.
    pub(crate) occluded: Vec<bool>,
    /// Shadow rays that have passed clear surfaces, the number of each among those of its chunk, and what they hit; only this
    /// executor has them.
    pub(crate) through_rays: Vec<Ray>,
    pub(crate) through_numbers: Vec<u32>,
    pub(crate) through_hits: Vec<Hit>,
    /// The instances of all hits, and of those behind clear surfaces; empty where one mesh is shown.
    pub(crate) hit_instances: Vec<u32>,
    pub(crate) through_instances: Vec<u32>,
    /// What a scene of instances answers, before it is told apart.
    pub(crate) scene_hits: Vec<SceneHit>,
}

/// Makes a buffer as long as a plan asks. Its memory is kept.
fn fit<T: Clone>(buffer: &mut Vec<T>, elements: u32, fill: T) {
    if buffer.len() != elements as usize {
        buffer.resize(elements as usize, fill);
    }
}

impl Buffers {
    /// Sets every buffer to the length that the plan asks for and the contents that the schedule
    /// expects.
    pub(crate) fn prepare(&mut self, plan: &Plan) {
        let ray = Ray::zeroed();
        fit(&mut self.rays, plan.elements(Buffer::Rays), ray);
        fit(&mut self.paths, plan.elements(Buffer::Paths), Path::default());
        fit(&mut self.next_rays, plan.elements(Buffer::NextRays), ray);
        fit(&mut self.next_paths, plan.elements(Buffer::NextPaths), Path::default());
        fit(&mut self.hits, plan.elements(Buffer::Hits), Hit::MISS);
        fit(&mut self.surfaces, plan.elements(Buffer::Surfaces), Surface::default());
        fit(&mut self.spawned, plan.elements(Buffer::Spawned), Spawned::default());
        fit(&mut self.shadow_rays, plan.elements(Buffer::ShadowRays), ray);
        fit(&mut self.shadow_light, plan.elements(Buffer::ShadowLight), [0.0; 4]);
        fit(&mut self.radiance, plan.elements(Buffer::Radiance), [0.0; 4]);
        fit(&mut self.first_hits, plan.elements(Buffer::FirstHits), FirstHit::MISS);
        fit(&mut self.first_costs, plan.elements(Buffer::FirstCosts), FirstCost::default());
        fit(&mut self.pixels, plan.elements(Buffer::Pixels), 0);
        self.radiance.fill([0.0; 4]);
        self.counters = crate::kernel::first_counters(plan.pixels());
    }

    /// What belongs to the shadow rays of a wave, path by path.
    pub(crate) fn as_devices_have<T: Copy>(&self, by_light: &[T]) -> Vec<T> {
        let paths = self.counters[Counter::Paths] as usize;
        let chunks = self.counters[Counter::PathChunks] as usize;
        by_path(&self.surfaces[..paths], &self.spawned[..chunks], by_light)
    }

    /// Bytes that are held, spare capacity included.
    pub fn bytes(&self) -> u64 {
        fn held<T>(buffer: &Vec<T>) -> u64 {
            (buffer.capacity() * size_of::<T>()) as u64
        }
        held(&self.rays)
            + held(&self.paths)
            + held(&self.next_rays)
            + held(&self.next_paths)
            + held(&self.hits)
            + held(&self.surfaces)
            + held(&self.spawned)
            + held(&self.shadow_rays)
            + held(&self.shadow_light)
            + held(&self.radiance)
            + held(&self.first_hits)
            + held(&self.first_costs)
            + held(&self.pixels)
            + held(&self.occluded)
            + held(&self.through_rays)
            + held(&self.through_numbers)
            + held(&self.through_hits)
            + held(&self.hit_instances)
            + held(&self.through_instances)
            + held(&self.scene_hits)
    }
}
