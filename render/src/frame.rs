//! What goes into a frame, and what it took.

use crate::camera::Pinhole;
use crate::kernel::Counter;
use crate::layout::Counters;
use crate::plan::{Outputs, Plan};
use crate::scene_data::SceneData;
use crate::settings::{RenderSettings, Size};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::QueryOptions;
use std::time::Duration;

/// What a frame is made from.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// The triangles, as the tree was built over them.
    pub mesh: Mesh<'a>,
    /// What they look like.
    pub scene: &'a SceneData,
    /// From where they are seen.
    pub camera: Pinhole,
    /// The picture's size, which `camera` is for.
    pub size: Size,
    /// The knobs.
    pub settings: &'a RenderSettings,
    /// What is wanted.
    pub outputs: Outputs,
    /// How rays are traced. Triangles ignored here are missing from the picture.
    pub query: QueryOptions<'a>,
}

/// What a frame took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameStats {
    /// The plan it was made by.
    pub plan: Plan,
    /// Camera, reflected and refracted rays.
    pub paths: u64,
    /// Rays towards lights.
    pub shadow_rays: u64,
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
            tracing,
        }
    }

    /// All rays.
    pub fn rays(&self) -> u64 {
        self.paths + self.shadow_rays
    }
}
