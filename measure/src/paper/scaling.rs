//! Build time against the number of processors (the survey's Figure 12): threads of the CPU, workgroups
//! of the GPU.

use super::ReportError;
use super::scene::Settings;
use super::timing::{median, pool, timed};
use serde::Serialize;
use splitplane::scene::Scene;
use splitplane_core::config::Preset;
use splitplane_cpu::CpuBackend;

/// Build times of a scene by preset `fast`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scaling {
    /// The scene.
    pub scene: String,
    /// Its triangles.
    pub triangles: usize,
    /// `cpu`, where processors are threads, or `wgpu`, where they are workgroups of a dispatch.
    pub backend: &'static str,
    /// Whether the device is software, whose workgroups are threads of the CPU: its curve then says nothing.
    pub software: bool,
    /// The greatest speed-up printed in the survey for its scene of this rank; from how many processors
    /// to how many is not known.
    pub survey_speedup: f64,
    /// By number of processors, from 1 on.
    pub points: Vec<Point>,
    /// Numbers of processors that gave another tree, which a driver that ends long loops may do.
    pub failed: Vec<usize>,
}

/// A build time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Threads or workgroups.
    pub processors: usize,
    /// Median time in milliseconds.
    pub tree_ms: f64,
    /// How many times faster than with the fewest.
    pub speedup: f64,
}

/// The numbers of threads that are measured: all up to eight, powers of two beyond, and the greatest.
pub fn thread_counts(most: usize) -> Vec<usize> {
    let mut counts: Vec<usize> = (1..=most.min(8)).collect();
    counts.extend((4..usize::BITS).map(|bit| 1 << bit).take_while(|count| *count < most));
    if most > 8 {
        counts.push(most);
    }
    counts
}

/// Builds on more and more threads, in turns.
///
/// # Errors
/// A tree that cannot be built, or threads that cannot be started.
pub fn on_cpu(
    scene: &Scene,
    survey_speedup: f64,
    settings: &Settings,
) -> Result<Scaling, ReportError> {
    let (backend, mesh) = (CpuBackend::new(), scene.mesh()?);
    let options = settings.build(Preset::Fast);
    let counts = thread_counts(settings.threads);
    let pools: Result<Vec<_>, _> = counts.iter().map(|&threads| pool(threads)).collect();
    let pools = pools?;
    let mut accelerator =
        pool(settings.threads)?.install(|| backend.build_accelerator(&mesh, &options))?;
    let mut times = vec![Vec::new(); counts.len()];
    for round in 0..=settings.repeat {
        for (pool, times) in pools.iter().zip(&mut times) {
            let (built, ms) =
                pool.install(|| timed(|| backend.rebuild(&mut accelerator, &mesh, &options)));
            built?;
            if round > 0 {
                times.push(ms);
            }
        }
    }
    let points = with_speedups(counts.into_iter().zip(times));
    Ok(Scaling {
        scene: scene.name.clone(),
        triangles: scene.indices.len(),
        backend: "cpu",
        software: false,
        survey_speedup,
        points,
        failed: Vec::new(),
    })
}

/// Medians, and how many times faster than the first.
fn with_speedups(times: impl IntoIterator<Item = (usize, Vec<f64>)>) -> Vec<Point> {
    let medians: Vec<(usize, f64)> =
        times.into_iter().map(|(processors, times)| (processors, median(times))).collect();
    let first = medians.first().map_or(0.0, |(_, ms)| *ms);
    let point = |(processors, tree_ms)| Point {
        processors,
        tree_ms,
        speedup: if tree_ms > 0.0 { first / tree_ms } else { 1.0 },
    };
    medians.into_iter().map(point).collect()
}

#[cfg(feature = "wgpu")]
pub use device::on_gpu;

#[cfg(feature = "wgpu")]
mod device {
    use super::*;
    use splitplane::backend::{BackendKind, Engine};
    use splitplane_wgpu::{GpuError, WgpuBackend};
    use std::num::NonZeroU32;

    /// Most workgroups of a dispatch that are tried: as many as builds use on hardware.
    const MOST: u32 = 2048;

    /// Builds with more and more workgroups a dispatch, doubled up to all that builds use.
    ///
    /// # Errors
    /// There is no GPU, or a tree that cannot be built.
    pub fn on_gpu(
        scene: &Scene,
        survey_speedup: f64,
        settings: &Settings,
    ) -> Result<Scaling, ReportError> {
        let opened = BackendKind::Wgpu.open_engine(&settings.open)?;
        let Engine::Wgpu(backend) = opened.engine else {
            return Err(splitplane::backend::OpenError::NoGpuBackend.into());
        };
        let whole = build(&backend, scene, settings)?.1;
        let counts: Vec<u32> = (0..=MOST.ilog2()).map(|bit| 1 << bit).collect();
        let mut times = vec![Vec::new(); counts.len()];
        let mut failed = Vec::new();
        for round in 0..=settings.repeat {
            for (&count, times) in counts.iter().zip(&mut times) {
                if failed.contains(&(count as usize)) {
                    continue;
                }
                backend.limit_workgroups(NonZeroU32::new(count));
                let (ms, digest) = build(&backend, scene, settings)?;
                if digest != whole {
                    failed.push(count as usize);
                } else if round > 0 {
                    times.push(ms);
                }
            }
        }
        let times = counts.into_iter().zip(times).map(|(count, times)| (count as usize, times));
        let points = with_speedups(times.filter(|(count, _)| !failed.contains(count)));
        Ok(Scaling {
            scene: scene.name.clone(),
            triangles: scene.indices.len(),
            backend: "wgpu",
            software: backend.gpu().is_software(),
            survey_speedup,
            points,
            failed,
        })
    }

    /// The time of a build, and the tree's name.
    fn build(
        backend: &WgpuBackend,
        scene: &Scene,
        settings: &Settings,
    ) -> Result<(f64, String), ReportError> {
        let (mesh, options) = (scene.mesh()?, settings.build(Preset::Fast));
        let (built, ms) = timed(|| backend.build_on_device(&mesh, &options));
        let tree = built?.tree;
        let lost = |error: GpuError| {
            ReportError::Tracer(splitplane_render::RenderError::from(error).into())
        };
        let digest = tree.read(backend.gpu()).map_err(lost)?.digest().to_string();
        backend.recycle(tree);
        Ok((ms, digest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_up_to_eight_then_doubled() {
        assert_eq!(thread_counts(1), [1]);
        assert_eq!(thread_counts(3), [1, 2, 3]);
        assert_eq!(thread_counts(8), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(thread_counts(16), [1, 2, 3, 4, 5, 6, 7, 8, 16]);
        assert_eq!(thread_counts(48), [1, 2, 3, 4, 5, 6, 7, 8, 16, 32, 48]);
    }

    #[test]
    fn speedups_are_against_the_first() {
        let points = with_speedups([(1, vec![8.0, 9.0, 7.0]), (2, vec![4.0])]);
        assert_eq!(points[0], Point { processors: 1, tree_ms: 8.0, speedup: 1.0 });
        assert_eq!(points[1].speedup, 2.0);
    }
}
