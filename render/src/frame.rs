//! The input of a frame, and its statistics.

use crate::camera::Pinhole;
use crate::kernel::Counter;
use crate::layout::Counters;
use crate::plan::{Outputs, Plan};
use crate::scene_data::SceneData;
use crate::settings::{RenderSettings, Size};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::QueryOptions;
use std::time::Duration;

/// The input of a frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// The triangles, as the tree was built over them.
    pub mesh: Mesh<'a>,
    /// What they look like.
    pub scene: &'a SceneData,
    /// The camera.
    pub camera: Pinhole,
    /// The picture's size, for which `camera` was made.
    pub size: Size,
    /// The settings of speed and quality.
    pub settings: &'a RenderSettings,
    /// The outputs to produce.
    pub outputs: Outputs,
    /// How rays are traced. Triangles ignored here are missing from the picture.
    pub query: QueryOptions<'a>,
}

/// The statistics of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct FrameStats {
    /// The plan by which it was rendered.
    pub plan: Plan,
    /// Camera, reflected and refracted rays.
    pub paths: u64,
    /// Rays towards lights.
    pub shadow_rays: u64,
    /// Rays of photons, one for each bounce.
    pub photon_rays: u64,
    /// Rays that a device left to the CPU: those of an exact frame that it left undecided, and, where the CPU shades, those that its
    /// driver did not follow to their end. 0 on the CPU.
    pub redone: u64,
    /// Rays of a scene whose geometries are on a device, for which the CPU found the instances that they enter; those of slices that
    /// had to be repeated count again. 0 where all is on the CPU, and where the device finds the instances.
    pub placed_by_cpu: u64,
    /// Time spent in queries; `None` where it is not measured.
    pub tracing: Option<Duration>,
}

impl FrameStats {
    pub(crate) fn new(plan: Plan, counters: &Counters, tracing: Option<Duration>) -> FrameStats {
        let sum = |low, high| u64::from(counters[low]) | (u64::from(counters[high]) << 32);
        FrameStats {
            plan,
            paths: sum(Counter::TotalPathsLow, Counter::TotalPathsHigh),
            shadow_rays: sum(Counter::TotalShadowRaysLow, Counter::TotalShadowRaysHigh),
            photon_rays: 0,
            redone: 0,
            placed_by_cpu: 0,
            tracing,
        }
    }

    /// All rays.
    pub fn rays(&self) -> u64 {
        self.paths + self.shadow_rays + self.photon_rays
    }
}
