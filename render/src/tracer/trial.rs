//! Whether a GPU or the cores of this machine trace the rays of a frame faster: both are tried.

use super::{FrameRequest, Shading, Tracer, TracerError};
use crate::camera::camera_ray;
use crate::random::{key, pair};
use crate::vector::{add, dot, negated, scaled};
use crate::warp::cap;
use splitplane_core::backend::{Accelerator, Backend, LoadOptions};
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_cpu::CpuBackend;
use std::time::{Duration, Instant};

/// Most rays of the wave: as many as one of a frame that the CPU shades.
const WAVE: u32 = 1 << 16;
/// How often it is timed on each side, after a first time that does not count: pipelines are compiled and memory is taken then.
const TIMES: u32 = 2;

/// How long one wave of rays took on both sides, the faster of two times each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct RayTrial {
    /// Rays of the wave.
    pub rays: usize,
    /// Time on the GPU, with all that crosses to it and back.
    pub gpu: Duration,
    /// Time on the cores of this machine: the threads of the calling pool.
    pub cpu: Duration,
}

impl RayTrial {
    /// Whether the GPU was faster.
    pub fn is_for_gpu(&self) -> bool {
        self.gpu < self.cpu
    }
}

impl Tracer {
    /// Times a wave of a frame's rays on the GPU and on the CPU, over the same tree: rays as the surfaces that the camera sees scatter them.
    /// `None` where the CPU traces anyway, where the GPU shades too, and where the tree is on the GPU alone. Results of frames do not
    /// depend on who traces. Holds a copy of the tree and of what queries of the CPU read, without a limit.
    ///
    /// # Errors
    /// Settings out of range, a backend that fails, or a watch that cancels.
    pub fn try_rays(
        &self,
        mesh: &Mesh<'_>,
        request: &FrameRequest<'_>,
    ) -> Result<Option<RayTrial>, TracerError> {
        let is_choice = self.shading(&request.settings) == Shading::CpuWithRaysOnGpu;
        let Some(gpu) = self.accelerator().filter(|_| is_choice) else { return Ok(None) };
        let watch = request.query.watch;
        let load = LoadOptions { watch, ..LoadOptions::default() };
        let cpu = CpuBackend::new().load(mesh, gpu.tree().clone(), &load)?;
        let rays = self.scattered(gpu, request)?;
        Ok(Some(RayTrial {
            rays: rays.len(),
            gpu: time(gpu, &rays, &request.query)?,
            cpu: time(&*cpu, &rays, &request.query)?,
        }))
    }

    /// Rays from what the camera sees, in all directions; those of the camera where it sees nothing.
    fn scattered(
        &self,
        accelerator: &dyn Accelerator,
        request: &FrameRequest<'_>,
    ) -> Result<Vec<Ray>, TracerError> {
        let frame = self.plan(request)?.frame(&self.appearance, &request.camera, &request.query);
        let pixels = request.size.pixels();
        let step = pixels.div_ceil(WAVE) as usize;
        let seen: Vec<Ray> =
            (0..pixels).step_by(step).map(|pixel| camera_ray(&frame, pixel, 0)).collect();
        let mut hits = vec![Hit::MISS; seen.len()];
        accelerator.closest_hits(&seen, &mut hits, &request.query).map_err(of_query)?;
        let met = seen.iter().zip(&hits).zip(0..).filter(|((_, hit), _)| hit.is_hit());
        let scattered: Vec<Ray> = met
            .map(|((ray, hit), number)| {
                let point = add(ray.origin, scaled(ray.direction, hit.t));
                let any = cap(pair(key(number, 0, 0, 1), 0), 2.0);
                let leaves = dot(any, ray.direction) < 0.0;
                let direction = if leaves { any } else { negated(any) };
                Ray::new(point, direction).with_limits(1e-4 * hit.t, f32::INFINITY)
            })
            .collect();
        Ok(if scattered.is_empty() { seen } else { scattered })
    }
}

fn of_query(error: QueryError) -> TracerError {
    TracerError::Render(error.into())
}

fn time(
    accelerator: &dyn Accelerator,
    rays: &[Ray],
    options: &QueryOptions<'_>,
) -> Result<Duration, TracerError> {
    let mut hits = vec![Hit::MISS; rays.len()];
    let mut least = Duration::MAX;
    for turn in 0..=TIMES {
        let start = Instant::now();
        accelerator.closest_hits(rays, &mut hits, options).map_err(of_query)?;
        if turn > 0 {
            least = least.min(start.elapsed());
        }
    }
    Ok(least)
}
