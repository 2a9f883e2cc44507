//! What is said of scenes of many objects.

use super::failure::Failure;
use super::look::{Look, of_photons};
use super::made::Written;
use super::objects::ObjectStage;
use super::options::Common;
use super::output;
use super::percentiles::Percentiles;
use super::prepared::{counted, print_json};
use super::stage::shaded;
use serde::Serialize;
use splitplane::render::FrameStats;
use splitplane_scene::from_file::quoted;

/// What `--json` says about what was built.
#[derive(Serialize)]
struct Built {
    scene: String,
    geometries: usize,
    /// Triangles of all geometries.
    triangles: usize,
    /// Spheres and capsules of all geometries.
    shapes: usize,
    instances: usize,
    /// Triangles of all instances, each counted as often as it is placed.
    instanced_triangles: u64,
    backend: String,
    adapter: Option<String>,
    preset: &'static str,
    threads: Option<usize>,
    build_ms: f64,
    bytes: u64,
    digest: String,
    lights: usize,
    /// Lights to be placed, had there been places for all.
    lights_asked: Option<usize>,
}

impl ObjectStage {
    fn built(&self) -> Built {
        let (scene, built) = (&self.scene, self.tracer.scene().scene());
        Built {
            scene: scene.name.clone(),
            geometries: built.geometries().count(),
            triangles: scene.triangles(),
            shapes: scene.solids(),
            instances: built.placements().count(),
            instanced_triangles: scene.instanced_triangles(),
            backend: self.info.name.clone(),
            adapter: self.info.adapter.clone(),
            preset: self.preset,
            threads: self.info.threads,
            build_ms: self.build_ms,
            bytes: built.bytes(),
            digest: built.digest().to_string(),
            lights: self.placed.lights.len(),
            lights_asked: self.placed.asked(),
        }
    }

    fn describe(&self) -> String {
        let built = self.built();
        let by = match (&built.adapter, built.threads) {
            (Some(adapter), _) => adapter.clone(),
            (None, Some(threads)) => counted(threads as u64, "thread"),
            (None, None) => self.info.detail.clone(),
        };
        let [x, y, z] = self.placed.camera.eye();
        let view = self.placed.view.map_or("as given", |view| view.name());
        let shining = self.tracer.appearance().needs().emitters;
        let lights = match (built.lights, shining) {
            (0, 0) => "none but the environment".to_owned(),
            (0, shining) => format!("{shining} surfaces that shine"),
            (count, 0) => format!("{count}{}", if self.placed.by_rule { ", placed" } else { "" }),
            (count, shining) => format!("{count}, and {shining} surfaces that shine"),
        };
        format!(
            "scene    {}: {} instances of {} geometries, {} triangles that are {} in the world{}\n\
             backend  {} ({by}; {})\n\
             built    in {:.1} ms by preset {}, {} bytes, digest {}\n\
             camera   at {x},{y},{z}, {view}\nlights   {lights}\n",
            quoted(&built.scene),
            built.instances,
            built.geometries,
            built.triangles,
            built.instanced_triangles,
            match built.shapes {
                0 => String::new(),
                1 => "; 1 sphere or capsule".to_owned(),
                count => format!("; {count} spheres and capsules"),
            },
            built.backend,
            self.reason,
            built.build_ms,
            built.preset,
            built.bytes,
            built.digest
        )
    }

    /// Reports on a picture.
    pub(super) fn report_picture(
        &self,
        look: &Look,
        common: &Common,
        stats: &FrameStats,
        render_ms: f64,
        written: &Written,
    ) -> Result<(), Failure> {
        let (width, height) = (look.size.width(), look.size.height());
        let trace_ms = stats.tracing.map(|time| time.as_secs_f64() * 1e3);
        if common.json {
            return print_json(&PictureReport {
                built: self.built(),
                width,
                height,
                samples: stats.plan.settings().samples,
                emitters: self.tracer.appearance().needs().emitters,
                paths: stats.paths,
                shadow_rays: stats.shadow_rays,
                photon_rays: stats.photon_rays,
                placed_by_cpu: stats.placed_by_cpu,
                shading: self.tracer.shading().to_string(),
                trace_ms,
                render_ms,
                output: written.names(),
            });
        }
        if common.quiet {
            return Ok(());
        }
        let tracing = trace_ms.map_or(String::new(), |ms| format!(", {ms:.1} ms of it tracing"));
        output::data(&format!(
            "{}{}traced   {} rays: {} camera, mirrored and refracted, {} shadow{}{}\n\
             rendered in {render_ms:.1} ms{tracing} ({:.1} million rays a second)\n{}\
             written  {} ({width}x{height})\n",
            self.describe(),
            shaded(self.tracer.shading(), &self.info),
            stats.rays(),
            stats.paths,
            stats.shadow_rays,
            of_photons(stats),
            match stats.placed_by_cpu {
                0 => String::new(),
                rays => format!("; for {rays} the CPU found the instances"),
            },
            stats.rays() as f64 / render_ms.max(1e-6) / 1e3,
            written.heat.as_deref().unwrap_or(""),
            written.names().join(", ")
        ))
    }
}

/// What `--json` says about a picture.
#[derive(Serialize)]
struct PictureReport {
    #[serde(flatten)]
    built: Built,
    width: u32,
    height: u32,
    samples: u32,
    emitters: u32,
    paths: u64,
    shadow_rays: u64,
    /// Rays of photons, one for each bounce.
    photon_rays: u64,
    /// Rays whose instances the CPU found for a device.
    placed_by_cpu: u64,
    /// `cpu`, or `cpu, rays on gpu`.
    shading: String,
    /// Time in queries; null where it is not measured.
    trace_ms: Option<f64>,
    render_ms: f64,
    output: Vec<String>,
}

/// What a frame took, in milliseconds.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct ObjectTimes {
    pub(super) frame: u32,
    pub(super) rays: u64,
    /// Instances that were made anew.
    pub(super) moved: u64,
    /// Moving them, and bringing up to date what answers rays.
    pub(super) update_ms: f64,
    /// Tracing and shading.
    pub(super) trace_ms: f64,
    /// Both.
    pub(super) total_ms: f64,
}

/// What is said of an animation.
#[derive(Serialize)]
pub(super) struct AnimatedObjects {
    #[serde(flatten)]
    built: Built,
    width: u32,
    height: u32,
    update_ms: Percentiles,
    trace_ms: Percentiles,
    total_ms: Percentiles,
    /// 1000 over the percentiles of the total.
    frames_per_s: Percentiles,
    frames: Vec<ObjectTimes>,
    output: Vec<String>,
}

impl AnimatedObjects {
    pub(super) fn new(
        stage: &ObjectStage,
        look: &Look,
        frames: Vec<ObjectTimes>,
        output: Vec<String>,
    ) -> AnimatedObjects {
        let of = |time: fn(&ObjectTimes) -> f64| Percentiles::of(frames.iter().map(time).collect());
        let total_ms = of(|times| times.total_ms);
        AnimatedObjects {
            built: stage.built(),
            width: look.size.width(),
            height: look.size.height(),
            update_ms: of(|times| times.update_ms),
            trace_ms: of(|times| times.trace_ms),
            total_ms,
            frames_per_s: total_ms.per_second(),
            frames,
            output,
        }
    }

    pub(super) fn print(&self, stage: &ObjectStage, common: &Common) -> Result<(), Failure> {
        if common.json {
            return print_json(self);
        }
        if common.quiet {
            return Ok(());
        }
        let row = |name: &str, p: &Percentiles| {
            format!("{name:<9}{:>9.2} {:>9.2} {:>9.2}\n", p.p50, p.p95, p.p99)
        };
        let rays: u64 = self.frames.iter().map(|times| times.rays).sum();
        let moved = self.frames.iter().map(|times| times.moved).max().unwrap_or(0);
        let mut text = stage.describe();
        text += &format!(
            "frames   {} of {}x{}, {rays} rays in all, at most {moved} instances moved at a time\n\
             ms             p50       p95       p99\n",
            self.frames.len(),
            self.width,
            self.height,
        );
        text += &row("update", &self.update_ms);
        text += &row("trace", &self.trace_ms);
        text += &row("total", &self.total_ms);
        text += &row("frames/s", &self.frames_per_s);
        text += &match self.output.is_empty() {
            true => "written  nothing; --out DIR and --movie FILE keep the frames\n".to_owned(),
            false => format!("written  {}\n", self.output.join(", ")),
        };
        output::data(&text)
    }
}
