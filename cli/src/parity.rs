//! `splitplane parity`.

use super::failure::Failure;
use super::options::Common;
use clap::Args;
use std::ffi::OsString;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj, .ply, .stl, .gltf or .glb file, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE")]
    #[cfg_attr(not(feature = "wgpu"), allow(dead_code, reason = "there is no GPU to compare"))]
    scene: OsString,
    /// Rays of each kind: random, aimed at edges, aimed at vertices
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u64).range(0..=100_000_000))]
    #[cfg_attr(not(feature = "wgpu"), allow(dead_code, reason = "there is no GPU to compare"))]
    rays: u64,
    #[command(flatten)]
    pub(super) common: Common,
}

#[cfg(not(feature = "wgpu"))]
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let _ = &arguments.common;
    Err(splitplane::OpenError::NoGpuBackend.into())
}

#[cfg(feature = "wgpu")]
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    compare::run(arguments)
}

#[cfg(feature = "wgpu")]
mod compare {
    use super::super::failure::Failure;
    use super::super::prepared::{counted, in_pool, print_json};
    use super::super::{output, progress};
    use super::Arguments;
    use serde::Serialize;
    use splitplane::backend::open_gpu;
    use splitplane::gpu::WgpuBackend;
    use splitplane::parity::{self, Comparison};
    use splitplane::scene::Scene;
    use splitplane::{Backend, BackendKind, BuildError, verify};

    #[derive(Serialize)]
    struct Report {
        scene: String,
        preset: &'static str,
        triangles: usize,
        adapter: String,
        detail: String,
        dispatches: u32,
        kernel: Option<String>,
        buffer: Option<String>,
        index: Option<usize>,
        word: Option<usize>,
        cpu: Option<u32>,
        gpu: Option<u32>,
        digest_cpu: String,
        digest_gpu: String,
        submissions: u32,
        readbacks: u32,
        build_dispatches: u32,
        rays: u64,
        unequal_hits: u64,
        unfinished: u64,
        equal: bool,
    }

    pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
        let common = &arguments.common;
        if common.backend == BackendKind::Cpu {
            let message = "parity compares a GPU with the CPU; leave --backend cpu out";
            return Err(Failure::usage(message));
        }
        if common.accuracy_name() != "watertight" {
            let message = "parity compares answers of accuracy `watertight`";
            return Err(Failure::usage(message));
        }
        let options = common.build_options()?;
        let preset = options.config.preset();
        if preset.planes().is_none() {
            return Err(BuildError::PresetNotOnDevice { preset }.into());
        }
        in_pool(common, || {
            let gpu = open_gpu(&common.open_options())?;
            let spinner = progress::spinner(common.quiet, "reading the scene");
            let scene = Scene::open_with(&arguments.scene, &common.bare_scene())?;
            spinner.finish_and_clear();
            let mesh = scene.mesh()?;
            // Its own tests would refuse a device that is to be looked into.
            let backend = WgpuBackend::without_selftest(gpu);
            let info = backend.describe();
            let adapter = info.adapter.unwrap_or_default();
            let rays = verify::rays(&mesh, arguments.rays);
            let bar = progress::bar(common.quiet, "comparing", rays.len() as u64);
            let query = common.query_options();
            let found =
                parity::compare(&backend, &mesh, &options, &rays, &query, &|rays| bar.inc(rays))?;
            bar.finish_and_clear();
            let case = Case { scene: &scene.name, preset: preset.name(), triangles: mesh.len() };
            if common.json {
                print_json(&report(&case, &adapter, &info.detail, &found))?;
            } else if !common.quiet {
                output::data(&describe(&case, &adapter, &found))?;
            }
            if found.is_bitwise() {
                return Ok(());
            }
            let first = match (&found.difference, &found.first_unequal) {
                (Some(difference), _) => difference.to_string(),
                (None, Some(ray)) => ray.clone(),
                (None, None) => "the digests".into(),
            };
            Err(Failure::failed_check(format!("CPU and `{adapter}` differ; first in {first}")))
        })
    }

    /// What was compared.
    struct Case<'a> {
        scene: &'a str,
        preset: &'static str,
        triangles: usize,
    }

    fn report(case: &Case<'_>, adapter: &str, detail: &str, found: &Comparison) -> Report {
        let difference = found.difference.as_ref();
        Report {
            scene: case.scene.to_owned(),
            preset: case.preset,
            triangles: case.triangles,
            adapter: adapter.to_owned(),
            detail: detail.to_owned(),
            dispatches: found.dispatches,
            kernel: difference.map(|d| d.kernel.clone()),
            buffer: difference.map(|d| d.buffer.clone()),
            index: difference.map(|d| d.index),
            word: difference.map(|d| d.word),
            cpu: difference.and_then(|d| d.first),
            gpu: difference.and_then(|d| d.second),
            digest_cpu: found.digests[0].to_string(),
            digest_gpu: found.digests[1].to_string(),
            submissions: found.effort.submissions,
            readbacks: found.effort.readbacks,
            build_dispatches: found.effort.dispatches,
            rays: found.rays,
            unequal_hits: found.unequal,
            unfinished: found.unfinished,
            equal: found.is_bitwise(),
        }
    }

    fn describe(case: &Case<'_>, adapter: &str, found: &Comparison) -> String {
        let steps = match &found.difference {
            None => format!("all {} dispatches equal", found.dispatches),
            Some(difference) => format!("equal up to {difference}"),
        };
        let [cpu, gpu] = found.digests;
        let effort = found.effort;
        let Case { scene, preset, triangles } = case;
        format!(
            "scene    {scene}: {triangles} triangles\n\
             preset   {preset}\n\
             gpu      {adapter}\n\
             steps    {steps}\n\
             tree     CPU {cpu}, GPU {gpu}\n\
             build    {}, {}, {}\n\
             rays     {} traced, {} answers differ; {} left unfinished by the driver, not compared\n",
            counted(effort.submissions.into(), "submission"),
            counted(effort.readbacks.into(), "readback"),
            counted(effort.dispatches.into(), "dispatch").replace("dispatchs", "dispatches"),
            found.rays,
            found.unequal,
            counted(found.unfinished, "ray"),
        )
    }
}
