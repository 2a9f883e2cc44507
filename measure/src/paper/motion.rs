//! Scenes that move (the survey's Table 4): a tree for every frame, beside a hierarchy that is built once and refitted.
//!
//! In every frame all structures get the same rays: those of its camera, and one from every surface seen to every light on
//! its side. A refitted hierarchy keeps the shape of the first frame, so its rays slow down as the triangles move on; one that is
//! built anew for the frame says by how much.

mod mover;

use super::ReportError;
use super::rays::FrameRays;
use super::scene::{Placed, Settings, trace};
use super::timing::{median, pool, timed};
use crate::hierarchy::{self, Corners, Hierarchy};
use mover::Mover;
use serde::Serialize;
use splitplane::backend::{BackendKind, OpenOptions};
use splitplane::scene::Scene;
use splitplane::tracer::{FrameRequest, Tracer, TracerError};
use splitplane_core::backend::BuildOptions;
use splitplane_core::config::Preset;
use splitplane_core::error::BuildError;
use splitplane_core::ray::{Hit, QueryOptions};
use splitplane_render::Outputs;
use std::ffi::OsStr;
use std::path::Path;

pub use mover::twist;

/// What a structure takes in a frame, in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Took {
    /// Before rays can be traced.
    pub update_ms: f64,
    /// The frame's rays.
    pub rays_ms: f64,
    /// A frame of the same rays, shaded, until its pixels are in host memory; none for other structures than ours.
    pub trace_ms: Option<f64>,
}

/// What becomes of a structure in each frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Update {
    /// It is built from scratch.
    Built,
    /// It is fitted to where the triangles now are.
    Refitted,
}

/// A structure through all frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Course {
    /// The structure.
    pub structure: String,
    /// The preset that builds it; none for another structure.
    pub preset: Option<&'static str>,
    /// What each frame does to it.
    pub update: Update,
    /// `cpu` or `wgpu`.
    pub backend: String,
    /// Threads, on the CPU.
    pub threads: Option<usize>,
    /// The frames.
    pub frames: Vec<Took>,
}

impl Course {
    /// The median of a figure over the frames.
    pub fn median(&self, of: impl Fn(&Took) -> f64) -> f64 {
        median(self.frames.iter().map(of).collect())
    }
}

/// A scene in motion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Motion {
    /// Its letter in Figure 11.
    pub letter: char,
    /// The scene.
    pub scene: String,
    /// Its triangles.
    pub triangles: usize,
    /// How it moves, in words.
    pub moves: String,
    /// Rays of each frame.
    pub rays: Vec<usize>,
    /// The structures.
    pub courses: Vec<Course>,
    /// Camera rays of all frames for which the refitted hierarchy finds another distance than the tree, by more than a part in
    /// a thousand: its triangle test may leak at edges.
    pub different: usize,
}

impl Motion {
    /// How much longer the refitted hierarchy takes for a frame's rays than one built for the frame: in the first frame, and in
    /// the worst. None where there is no such course.
    pub fn decay(&self) -> Option<[f64; 2]> {
        let of = |update: Update| {
            self.courses.iter().find(|course| course.preset.is_none() && course.update == update)
        };
        let (refitted, built) = (of(Update::Refitted)?, of(Update::Built)?);
        let pairs = refitted.frames.iter().zip(&built.frames);
        let ratios: Vec<f64> = pairs.map(|(a, b)| a.rays_ms / b.rays_ms).collect();
        Some([*ratios.first()?, ratios.iter().copied().fold(0.0, f64::max)])
    }
}

/// A kd-tree that is built for every frame.
struct Ours {
    tracer: Tracer,
    options: BuildOptions<'static>,
    course: Course,
}

/// How often [`measure`] calls `step`.
pub fn steps(settings: &Settings) -> u64 {
    settings.frames as u64
}

/// Measures a scene through its frames: those of a file or folder, its own, or a twist. `step` is called after each.
///
/// # Errors
/// A tree, hierarchy or frame that cannot be made.
pub fn measure(
    letter: char,
    placed: &Placed,
    (spec, frames): (&OsStr, Option<&Path>),
    settings: &Settings,
    step: &mut dyn FnMut(&str),
) -> Result<Motion, ReportError> {
    let tracing = pool(settings.threads)?;
    let mut placed = placed.clone();
    let mut mover = Mover::of(spec, frames, &placed.scene)?;
    let moves = mover.words();
    mover.set(0, settings.frames, &mut placed)?;
    let mut ours = ours(&placed.scene, settings)?;
    let kept: Vec<u32> = {
        let finite = |i: &u32| {
            let corners = placed.scene.corners(*i);
            corners.is_some_and(|corners| corners.as_flattened().iter().all(|x| x.is_finite()))
        };
        (0..placed.scene.indices.len() as u32).filter(finite).collect()
    };
    let corners = |scene: &Scene| -> Vec<Corners> {
        kept.iter().filter_map(|&triangle| scene.corners(triangle)).collect()
    };
    let mut refitted = tracing.install(|| Hierarchy::build(&corners(&placed.scene)));
    let mut other = [Update::Refitted, Update::Built].map(|update| Course {
        structure: hierarchy::NAME.into(),
        preset: None,
        update,
        backend: "cpu".into(),
        threads: Some(settings.threads),
        frames: Vec::new(),
    });
    let (mut counts, mut different) = (Vec::new(), 0);
    for frame in 0..settings.frames {
        mover.set(frame, settings.frames, &mut placed)?;
        let mut rays: Option<(FrameRays, Vec<Hit>)> = None;
        for own in &mut ours {
            let (took, traced) = own.frame(&placed, settings, &tracing, rays.take())?;
            own.course.frames.push(took);
            rays = Some(traced);
        }
        let Some((rays, hits)) = rays else { break };
        counts.push(rays.len());
        let triangles = corners(&placed.scene);
        let repeat = settings.repeat;
        tracing.install(|| {
            for (course, update) in other.iter_mut().zip([Update::Refitted, Update::Built]) {
                let mut times = [Vec::new(), Vec::new()];
                let mut distances = Vec::new();
                // The first round warms up.
                for round in 0..=repeat {
                    let update_ms = match update {
                        Update::Refitted => timed(|| refitted.refit(&triangles)).1,
                        Update::Built => timed(|| Hierarchy::build(&triangles)).1,
                    };
                    if round > 0 {
                        times[0].push(update_ms);
                    }
                }
                let fresh = (update == Update::Built).then(|| Hierarchy::build(&triangles));
                let own = fresh.as_ref().unwrap_or(&refitted);
                for round in 0..=repeat {
                    let ((found, _), ms) =
                        timed(|| (own.closest(&rays.camera), own.occluded(&rays.shadow)));
                    distances = found;
                    if round > 0 {
                        times[1].push(ms);
                    }
                }
                if update == Update::Refitted {
                    different +=
                        distances.iter().zip(&hits).filter(|(t, hit)| is_off(**t, hit)).count();
                }
                let [update_ms, rays_ms] = times.map(median);
                course.frames.push(Took { update_ms, rays_ms, trace_ms: None });
            }
        });
        step(&format!("{}: frame {} of {}", placed.scene.name, frame + 1, settings.frames));
    }
    let mut courses: Vec<Course> = ours.into_iter().map(|own| own.course).collect();
    courses.extend(other);
    Ok(Motion {
        letter,
        scene: placed.scene.name.clone(),
        triangles: placed.scene.indices.len(),
        moves,
        rays: counts,
        courses,
        different,
    })
}

/// Whether a distance is another one than that of a hit, by more than a part in a thousand.
fn is_off(t: f32, hit: &Hit) -> bool {
    match (t.is_finite(), hit.is_hit()) {
        (true, true) => (t - hit.t).abs() > 1e-3 * hit.t.abs(),
        (found, expected) => found != expected,
    }
}

/// A tree of each preset that builds in parallel, as it is tuned; what a device lacks is left out, as in Table 3.
fn ours(scene: &Scene, settings: &Settings) -> Result<Vec<Ours>, ReportError> {
    let mut out = Vec::new();
    for builder in settings.builders.iter().filter(|builder| !builder.equal && !builder.offline) {
        let kind = if builder.gpu { BackendKind::Wgpu } else { BackendKind::Cpu };
        let open = if builder.gpu { settings.open.clone() } else { OpenOptions::default() };
        let engine = kind.open_engine(&open)?.engine;
        let options = settings.build_with(builder.config());
        let (mesh, appearance) = (scene.mesh()?, scene.appearance());
        let loaded =
            pool(settings.threads)?.install(|| Tracer::load(engine, &mesh, &appearance, &options));
        let tracer = match loaded {
            Err(TracerError::Build(BuildError::PresetNotOnDevice { .. })) if builder.gpu => {
                continue;
            }
            other => other?,
        };
        let source = match builder.preset {
            Preset::Fast | Preset::Narrow => "Zhou et al. 2008",
            Preset::Balanced => "Shevtsov et al. 2007",
            Preset::Best => "Wald and Havran 2006",
            _ => "",
        };
        let course = Course {
            structure: format!("kd-tree, {} ({source})", builder.preset.name()),
            preset: Some(builder.preset.name()),
            update: Update::Built,
            backend: tracer.backend().name,
            threads: (!builder.gpu).then_some(settings.threads),
            frames: Vec::new(),
        };
        out.push(Ours { tracer, options, course });
    }
    Ok(out)
}

impl Ours {
    /// Builds the tree of a frame, traces its rays and draws it. The rays are those given, or made from this tree's hits.
    fn frame(
        &mut self,
        placed: &Placed,
        settings: &Settings,
        tracing: &rayon::ThreadPool,
        rays: Option<(FrameRays, Vec<Hit>)>,
    ) -> Result<(Took, (FrameRays, Vec<Hit>)), ReportError> {
        let Ours { tracer, options, .. } = self;
        let scene = &placed.scene;
        let mesh = scene.mesh()?;
        let request = FrameRequest {
            camera: placed.camera.pinhole(settings.size),
            size: settings.size,
            // Neither reflections nor refractions: the rays that the survey counts.
            settings: placed.settings(1, 0),
            outputs: Outputs::PIXELS,
            query: QueryOptions::default(),
        };
        tracing.install(|| {
            tracer.update_normals(&mesh, &scene.appearance());
            let (mut update, mut draw) = (Vec::new(), Vec::new());
            for round in 0..=settings.repeat {
                let (built, ms) = timed(|| tracer.rebuild(&mesh, options));
                built?;
                let (drawn, draw_ms) =
                    timed(|| tracer.frame(&mesh, &request)?.pixels().map(|_| ()));
                drawn?;
                if round > 0 {
                    update.push(ms);
                    draw.push(draw_ms);
                }
            }
            if tracer.accelerator().is_none() {
                tracer.rebuild_for_queries(&mesh, options)?;
            }
            let accelerator = tracer.accelerator().expect("a tree for queries was built");
            let rays = match rays {
                Some(rays) => rays,
                None => {
                    let rays = FrameRays::of(scene, &placed.camera, settings.size, accelerator)?;
                    let mut hits = vec![Hit::MISS; rays.camera.len()];
                    accelerator.closest_hits(&rays.camera, &mut hits, &QueryOptions::default())?;
                    (rays, hits)
                }
            };
            let rays_ms = trace(accelerator, &rays.0, settings.repeat)?;
            let took = Took { update_ms: median(update), rays_ms, trace_ms: Some(median(draw)) };
            Ok((took, rays))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_that_differ_are_counted() {
        let hit = Hit { t: 2.0, triangle: 1, u: 0.0, v: 0.0 };
        assert!(!is_off(2.001, &hit) && is_off(2.01, &hit));
        assert!(is_off(f32::INFINITY, &hit) && is_off(2.0, &Hit::MISS));
        assert!(!is_off(f32::INFINITY, &Hit::MISS));
    }
}
