//! The error of pictures by paths and by photons against a long reference by paths, by CPU time. On Linux, whose clock of a process ticks
//! 100 times a second; take times of a second and more seriously, and run it with `RAYON_NUM_THREADS=1`.
//!
//! `cargo run --release --features render --example light_error -- [SCENE [REFERENCE_PASSES [WIDTH HEIGHT]]]`

use splitplane::render::{Gather, LightTransport, Outputs, RenderSettings, Size};
use splitplane::scene::{Placement, Scene};
use splitplane::tracer::{FrameRequest, Tracer};
use splitplane::{BuildOptions, CpuBackend};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Pictures of the table are made with this many samples a pass; those of the reference with the most there may be.
const SAMPLES: u32 = 4;
const REFERENCE: u32 = 64;
/// Passes of the pictures of the table.
const PASSES: [u32; 4] = [1, 4, 16, 64];

/// A scene that is ready to be rendered.
struct Show {
    scene: Scene,
    tracer: Tracer,
    request: FrameRequest<'static>,
}

impl Show {
    fn open(name: &str, size: Size) -> Outcome<Show> {
        let mut scene = Scene::open(name)?;
        let options = BuildOptions::default();
        let mut tracer =
            Tracer::load(CpuBackend::new(), &scene.mesh()?, &scene.appearance(), &options)?;
        let tree = tracer.accelerator().ok_or("the tree is on a device")?;
        let placement = Placement::of(&scene, tree, size.aspect())?;
        scene.lights = placement.lights;
        tracer.update_appearance(&scene.mesh()?, &scene.appearance())?;
        let new = FrameRequest::new(placement.camera.pinhole(size), size);
        let outputs = Outputs { pixels: false, radiance: true, ..Outputs::PIXELS };
        Ok(Show { scene, tracer, request: FrameRequest { outputs, ..new } })
    }

    /// The radiance, and the CPU time that it took, in seconds.
    fn picture(&mut self, settings: RenderSettings) -> Outcome<(Vec<[f32; 4]>, f64)> {
        let request = FrameRequest { settings, ..self.request };
        let start = cpu_time()?;
        let frame = self.tracer.frame(&self.scene.mesh()?, &request)?;
        let radiance = frame.radiance()?.into_owned();
        Ok((radiance, cpu_time()? - start))
    }
}

/// CPU time of this process so far, in seconds: user and system, all threads.
fn cpu_time() -> Outcome<f64> {
    let text = std::fs::read_to_string("/proc/self/stat")?;
    let after_name = text.rsplit(')').next().unwrap_or_default();
    let ticks: Option<Vec<f64>> =
        after_name.split_whitespace().skip(11).take(2).map(|word| word.parse().ok()).collect();
    Ok(ticks.ok_or("/proc/self/stat has no times")?.iter().sum::<f64>() / 100.0)
}

/// The root of the mean square of the error, each pixel's as a part of the reference, of which a hundredth of the mean is added so that
/// dark pixels do not decide; and the difference of the means, as a part.
fn error(picture: &[[f32; 4]], reference: &[[f32; 4]]) -> (f64, f64) {
    let channels = |all: &[[f32; 4]]| -> Vec<f64> {
        all.iter().flat_map(|pixel| pixel[..3].iter().map(|part| f64::from(*part))).collect()
    };
    let (picture, reference) = (channels(picture), channels(reference));
    let count = reference.len() as f64;
    let mean = |all: &[f64]| all.iter().sum::<f64>() / count;
    let floor = 0.01 * mean(&reference);
    let squares = picture.iter().zip(&reference).map(|(a, b)| ((a - b) / (b + floor)).powi(2));
    let squares: Vec<f64> = squares.collect();
    (mean(&squares).sqrt(), mean(&picture) / mean(&reference) - 1.0)
}

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let given = |place: usize, usual: u32| -> Outcome<u32> {
        Ok(arguments.get(place).map(|text| text.parse()).transpose()?.unwrap_or(usual))
    };
    let scene = arguments.first().map_or("builtin:cornell", String::as_str);
    let (passes, size) = (given(1, 64)?, Size::new(given(2, 64)?, given(3, 48)?)?);
    let mut show = Show::open(scene, size)?;
    let paths = RenderSettings {
        light: LightTransport::Paths,
        samples: SAMPLES,
        depth: 32,
        seed: 1,
        ..RenderSettings::default()
    };
    let long = RenderSettings { samples: REFERENCE, passes, seed: 999, ..paths };
    let (reference, took) = show.picture(long)?;
    println!(
        "{scene}, {}x{}; reference: paths, {} samples a pixel, {took:.1} s of CPU time",
        size.width(),
        size.height(),
        REFERENCE * passes
    );
    let photons = RenderSettings { light: LightTransport::Photons, photons: 100_000, ..paths };
    let gathered = RenderSettings { gather: Gather::Final, ..photons };
    println!("| | passes | CPU time (s) | error | mean |\n|---|---|---|---|---|");
    for (name, settings) in
        [("paths", paths), ("photons", photons), ("photons, gathered", gathered)]
    {
        for passes in PASSES {
            let (picture, took) = show.picture(RenderSettings { passes, ..settings })?;
            let (error, mean) = error(&picture, &reference);
            println!(
                "| {name} | {passes} | {took:.2} | {:.1} % | {:+.2} % |",
                100.0 * error,
                100.0 * mean
            );
        }
    }
    Ok(())
}
