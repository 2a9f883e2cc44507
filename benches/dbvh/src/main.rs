//! `splitplane-dbvh [--size WxH] [--repeat N] [--threads N] [-o FILE.json] [SCENE[@LIGHTS] ...]`: times of a
//! bounding volume hierarchy that is built once and refitted for every frame, in the manner of Wald, Boulos
//! and Shirley 2007, on the very rays that `splitplane paper` traces for its Table 4. `splitplane paper
//! --others FILE.json` takes what this writes. Defaults are those of `paper`.
//!
//! The hierarchy is that of the crate `obvhs`. A frame's update copies the moved corners into the order of
//! the leaves, bounds every leaf, and refits: what a scene in motion asks for, though the scenes stand
//! still. Rays go one by one, on all threads.

mod hierarchy;
mod options;

use hierarchy::Hierarchy;
use options::Options;
use splitplane::report::asked::Asked;
use splitplane::report::others::{FORMAT, OtherScene, Others};
use splitplane::report::rays::FrameRays;
use splitplane::report::scene::{Placed, Settings};
use splitplane::report::{ReportError, median};
use splitplane::{Backend, BuildOptions, CpuBackend, Hit, OpenOptions, QueryOptions};
use std::process::ExitCode;
use std::time::Instant;

/// The crate whose hierarchy it is.
const BUILDER: &str = "BVH, refitted (Wald et al. 2007; obvhs 0.4)";

fn main() -> ExitCode {
    let options = match Options::parse(std::env::args().skip(1)) {
        Ok(options) => options,
        Err(reason) => {
            eprintln!("splitplane-dbvh: {reason}");
            return ExitCode::from(2);
        }
    };
    match run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("splitplane-dbvh: {reason}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads)
        .build()
        .map_err(|error| error.to_string())?;
    let mut scenes = Vec::new();
    for asked in &options.scenes {
        let scene = pool.install(|| measure(asked, options)).map_err(|error| error.to_string())?;
        eprintln!(
            "{}: update {:.2} ms, rays {:.2} ms",
            scene.scene, scene.update_ms, scene.rays_ms
        );
        scenes.push(scene);
    }
    let others = Others {
        format: FORMAT,
        builder: BUILDER.into(),
        threads: options.threads,
        repeat: options.repeat,
        scenes,
    };
    let text = serde_json::to_string_pretty(&others).map_err(|error| error.to_string())? + "\n";
    match &options.output {
        None => print!("{text}"),
        Some(path) => {
            std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))?;
        }
    }
    Ok(())
}

fn measure(asked: &Asked, options: &Options) -> Result<OtherScene, ReportError> {
    let settings = Settings {
        size: options.size,
        repeat: options.repeat,
        threads: options.threads,
        builders: Vec::new(),
        open: OpenOptions::default(),
        max_memory: None,
    };
    let placed = Placed::open(&asked.spec, asked.lights, &settings)?;
    let scene = &placed.scene;
    let tree = CpuBackend::new().build(&scene.mesh()?, &BuildOptions::default())?;
    let rays = FrameRays::of(scene, &placed.camera, options.size, tree.as_ref())?;
    let mut expected = vec![Hit::MISS; rays.camera.len()];
    tree.closest_hits(&rays.camera, &mut expected, &QueryOptions::default())?;

    let finite = |corners: &[[f32; 3]; 3]| corners.as_flattened().iter().all(|x| x.is_finite());
    let triangles: Vec<[[f32; 3]; 3]> = scene.triangles().filter(finite).collect();
    let (mut hierarchy, build_ms) = timed(|| Hierarchy::build(&triangles));
    let (mut update_ms, mut rays_ms) = (Vec::new(), Vec::new());
    let mut different = 0;
    // The first round warms up.
    for round in 0..=options.repeat {
        let ((), updated) = timed(|| hierarchy.refit(&triangles));
        let ((distances, _), traced) =
            timed(|| (hierarchy.closest(&rays.camera), hierarchy.occluded(&rays.shadow)));
        if round > 0 {
            update_ms.push(updated);
            rays_ms.push(traced);
        }
        let off = |(t, hit): &(&f32, &Hit)| {
            let equal_miss = t.is_infinite() && !hit.is_hit();
            !equal_miss
                && ((*t - hit.t).abs() > 1e-3 * hit.t.abs() || t.is_infinite() == hit.is_hit())
        };
        different = distances.iter().zip(&expected).filter(off).count();
    }
    Ok(OtherScene {
        scene: scene.name.clone(),
        triangles: scene.indices.len(),
        camera_rays: rays.camera.len(),
        shadow_rays: rays.shadow.len(),
        rays: rays.digest(),
        build_ms,
        update_ms: median(update_ms),
        rays_ms: median(rays_ms),
        different,
    })
}

/// What work gives, and its time in milliseconds.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let out = work();
    (out, start.elapsed().as_secs_f64() * 1e3)
}
