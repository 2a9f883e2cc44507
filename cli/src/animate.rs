//! `splitplane animate`: a scene that moves, its tree rebuilt from scratch for every frame.

use super::failure::Failure;
use super::files::{self, ends_in};
use super::look::Look;
use super::objects::ObjectStage;
use super::objects_report::{AnimatedObjects, ObjectTimes};
use super::options::Common;
use super::percentiles::Percentiles;
use super::prepared::{BuildReport, counted, in_pool, milliseconds, print_json};
use super::stage::{Stage, open_backend, shaded};
use super::{output, progress};
use clap::Args;
use serde::Serialize;
use splitplane::picture::{self, Movie, MovieFormat};
use splitplane::render::{Outputs, Part};
use splitplane::scene::{Animation, Camera, Change, InstancedScene};
use splitplane::tracer::{FrameRequest, Moved, Tracer};
use std::ffi::OsString;
use std::fs;
use std::io::BufWriter;
use std::num::NonZeroU32;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Moves by itself.
const DEFAULT_SCENE: &str = "builtin:carousel";
/// Camera rays a pixel: what keeps a frame short.
const SAMPLES: u32 = 1;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj, .ply, .stl, .gltf or .glb file, a .json scene file, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE", default_value = DEFAULT_SCENE)]
    scene: OsString,
    /// How the scene moves: a folder of .obj files in the order of their names, NAME.frames.bin with
    /// NAME.frames.json beside it, or NAME.npy of shape (frames, vertices, 3); a built-in scene moves by itself
    #[arg(long, value_name = "FILE|DIR")]
    frames: Option<PathBuf>,
    /// Folder for the pictures, frame-0000.png and so on; made when it is not there
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// All frames in one file: an animated .png, which loses nothing, or .gif
    #[arg(long, value_name = "FILE.png|.gif")]
    movie: Option<PathBuf>,
    /// Frames a second of the movie
    #[arg(long, value_name = "N", default_value_t = 24.0, value_parser = fps)]
    fps: f64,
    /// How many frames to make, from the first on and over again; all of them once when left out
    #[arg(long, value_name = "N", value_parser = frame_count)]
    count: Option<NonZeroU32>,
    /// Render only part I of N of the frames, those that follow one another; pictures have the names that they have
    /// without
    #[arg(long, value_name = "I/N", requires = "out", conflicts_with = "movie")]
    part: Option<Part>,
    #[command(flatten)]
    look: Look,
    #[command(flatten)]
    pub(super) common: Common,
}

/// Most frames of a run: what is noted of each stays in memory for the report.
const MOST_FRAMES: u32 = 1_000_000;

fn frame_count(text: &str) -> Result<NonZeroU32, String> {
    let number: Option<NonZeroU32> =
        text.parse().ok().filter(|n: &NonZeroU32| n.get() <= MOST_FRAMES);
    number.ok_or_else(|| format!("give a number of frames from 1 to {MOST_FRAMES}"))
}

fn fps(text: &str) -> Result<f64, String> {
    let number: Option<f64> = text.parse().ok().filter(|fps| (0.1..=100.0).contains(fps));
    number.ok_or_else(|| "give a number of frames a second from 0.1 to 100".to_owned())
}

/// A movie under another name until it is whole.
struct Film {
    movie: Movie<BufWriter<fs::File>>,
    part: files::Part,
}

/// What a frame took, in milliseconds.
#[derive(Clone, Copy, Debug, Serialize)]
struct FrameTimes {
    frame: usize,
    /// The animation's own time in seconds, where it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    time_s: Option<f64>,
    triangles: u32,
    rays: u64,
    /// Reading the frame and taking over what has moved.
    update_ms: f64,
    /// Building the tree.
    build_ms: f64,
    /// Tracing and shading, until the picture is in host memory.
    trace_ms: f64,
    /// All three. On a GPU the next tree is built while a frame is traced: these are the times that the host works
    /// or waits.
    total_ms: f64,
    /// What crossed between host and GPU since the picture before.
    #[serde(skip_serializing_if = "Option::is_none")]
    device: Option<Crossed>,
}

/// What crossed between host and GPU, and how many buffers were made there.
#[derive(Clone, Copy, Debug, Serialize)]
struct Crossed {
    readbacks: u64,
    bytes_down: u64,
    uploads: u64,
    bytes_up: u64,
    buffers: u64,
}

impl Crossed {
    /// What has crossed so far; `None` on the CPU.
    #[cfg(feature = "wgpu")]
    fn so_far(tracer: &Tracer) -> Option<Crossed> {
        let traffic = tracer.traffic()?;
        Some(Crossed {
            readbacks: traffic.readbacks,
            bytes_down: traffic.bytes_down,
            uploads: traffic.uploads,
            bytes_up: traffic.bytes_up,
            buffers: traffic.buffers,
        })
    }

    #[cfg(not(feature = "wgpu"))]
    fn so_far(_tracer: &Tracer) -> Option<Crossed> {
        None
    }

    fn since(self, before: Crossed) -> Crossed {
        Crossed {
            readbacks: self.readbacks - before.readbacks,
            bytes_down: self.bytes_down - before.bytes_down,
            uploads: self.uploads - before.uploads,
            bytes_up: self.bytes_up - before.bytes_up,
            buffers: self.buffers - before.buffers,
        }
    }
}

/// What `--json` says about an animation.
#[derive(Serialize)]
struct AnimateReport {
    #[serde(flatten)]
    build: BuildReport,
    width: u32,
    height: u32,
    samples: u32,
    lights: usize,
    /// Lights to be placed, had there been places for all.
    lights_asked: Option<usize>,
    update_ms: Percentiles,
    build_frame_ms: Percentiles,
    trace_ms: Percentiles,
    total_ms: Percentiles,
    /// 1000 over the percentiles of the total.
    frames_per_s: Percentiles,
    frames: Vec<FrameTimes>,
    output: Vec<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let format = arguments.movie.as_deref().map(format_of).transpose()?;
    in_pool(&arguments.common, || arguments.animate(format))
}

fn format_of(path: &Path) -> Result<MovieFormat, Failure> {
    if ends_in(path, "png") {
        Ok(MovieFormat::Apng)
    } else if ends_in(path, "gif") {
        Ok(MovieFormat::Gif)
    } else {
        let shown = path.display();
        Err(Failure::usage(format!("`{shown}` does not end in .png or .gif; these are the movies")))
    }
}

impl Arguments {
    fn animate(&self, format: Option<MovieFormat>) -> Result<(), Failure> {
        let Arguments { look, common, .. } = self;
        look.check_transport()?;
        if InstancedScene::is_named_by(&self.scene) {
            return self.animate_objects(format);
        }
        let opened = open_backend(common)?;
        let spinner = progress::spinner(common.quiet, "reading the scene");
        let options = look.scene_options(common);
        let (mut scene, mut animation) =
            Animation::open(&self.scene, self.frames.as_deref(), &options)?;
        look.surround(&mut scene, common)?;
        // Lights are placed for what is seen.
        scene.camera = scene.camera.or(animation.camera(0));
        spinner.finish_and_clear();
        if let Some(folder) = &self.out {
            fs::create_dir_all(folder).map_err(|error| {
                Failure::file(format!("cannot make the folder `{}`: {error}", folder.display()))
            })?;
        }
        let rays = look.announced_rays(&scene, SAMPLES);
        let mut stage = Stage::set(scene, opened, look, rays, common)?;
        let first = self.request(stage.placed.camera, &stage)?;
        stage.choose(&first, common)?;
        let first_build = stage.built()?.report();
        let described = stage.built()?.describe()
            + &stage.describe_placed()
            + &shaded(stage.tracer.shading(&first.settings), &stage.info);
        let all = u32::try_from(animation.frames()).unwrap_or(u32::MAX);
        let count = self.count.or(NonZeroU32::new(all)).unwrap_or(NonZeroU32::MIN);
        let mut movie = self.open_movie(format, count)?;
        let numbers = self.numbers(count)?;
        let (start, count) = (numbers.start as usize, numbers.end as usize);
        let bar = progress::bar(common.quiet, "rendering", numbers.len() as u64);
        let (mut times, mut pixels) = (Vec::new(), Vec::new());
        let mut before = Crossed::so_far(&stage.tracer);
        let frame = start % animation.frames();
        let first = self.build(&mut stage, &mut animation, frame)?;
        let mut traced = Some(self.trace(&mut stage, &animation, first)?);
        for number in start..count {
            let Some(took) = traced.take() else { break };
            // While this frame is traced, the tree of the next one is built. What goes wrong with the next one ends
            // the run after this one.
            let frame = (number + 1) % animation.frames();
            let next = (number + 1 < count).then(|| self.build(&mut stage, &mut animation, frame));
            let mut took = self.finish(&mut stage, took, &mut pixels)?;
            let now = Crossed::so_far(&stage.tracer);
            took.device = now.zip(before).map(|(now, before)| now.since(before));
            before = now;
            let next = next.map(|next| self.trace(&mut stage, &animation, next?)).transpose();
            times.push(took);
            self.write(&pixels, number, movie.as_mut())?;
            bar.inc(1);
            traced = next?;
        }
        bar.finish_and_clear();
        let mut written: Vec<String> =
            self.out.iter().map(|folder| folder.display().to_string()).collect();
        if let (Some(movie), Some(path)) = (movie, &self.movie) {
            movie.movie.finish()?;
            movie.part.keep()?;
            written.push(path.display().to_string());
        }
        self.report(&stage, first_build, &described, times, written)
    }

    /// Renders the frames of a scene of many objects: what moved is brought up to date, nothing else is built.
    fn animate_objects(&self, format: Option<MovieFormat>) -> Result<(), Failure> {
        let Arguments { look, common, .. } = self;
        if self.frames.is_some() {
            return Err(Failure::usage(
                "--frames is for one mesh; the objects of a scene file move by its keys",
            ));
        }
        let mut stage = ObjectStage::set(&self.scene, look, common)?;
        if let Some(folder) = &self.out {
            fs::create_dir_all(folder).map_err(|error| {
                Failure::file(format!("cannot make the folder `{}`: {error}", folder.display()))
            })?;
        }
        let frames = stage.scene.frames;
        let count = self.count.or(NonZeroU32::new(frames)).unwrap_or(NonZeroU32::MIN);
        let mut movie = self.open_movie(format, count)?;
        let numbers = self.numbers(count)?;
        let bar = progress::bar(common.quiet, "rendering", numbers.len() as u64);
        let request = FrameRequest {
            settings: look.settings(SAMPLES, &stage.placed)?,
            query: common.query_options(),
            ..FrameRequest::new(stage.placed.camera.pinhole(look.size), look.size)
        };
        let mut times = Vec::new();
        for number in numbers {
            let frame = number % frames;
            let update = stage.update(frame)?;
            let start = Instant::now();
            let stats = stage.tracer.frame(&stage.scene.parts.mesh()?, &request)?;
            let trace_ms = milliseconds(start);
            let total_ms = update.ms + trace_ms;
            self.write(stage.tracer.pixels(), number as usize, movie.as_mut())?;
            times.push(ObjectTimes {
                frame,
                rays: stats.rays(),
                moved: update.moved,
                update_ms: update.ms,
                trace_ms,
                total_ms,
            });
            bar.inc(1);
        }
        bar.finish_and_clear();
        let mut output: Vec<String> =
            self.out.iter().map(|folder| folder.display().to_string()).collect();
        if let (Some(movie), Some(path)) = (movie, &self.movie) {
            movie.movie.finish()?;
            movie.part.keep()?;
            output.push(path.display().to_string());
        }
        AnimatedObjects::new(&stage, look, times, output).print(&stage, common)
    }

    /// The frames of this run, by number, of so many.
    fn numbers(&self, count: NonZeroU32) -> Result<Range<u32>, Failure> {
        let part = self.part.unwrap_or_default();
        let numbers = part.share(count.get());
        if numbers.is_empty() {
            return Err(Failure::usage(format!(
                "--part {part}: the animation has {}, so this part has none; take at most {}",
                counted(count.get().into(), "frame"),
                counted(count.get().into(), "part"),
            )));
        }
        Ok(numbers)
    }

    fn open_movie(
        &self,
        format: Option<MovieFormat>,
        frames: NonZeroU32,
    ) -> Result<Option<Film>, Failure> {
        let (Some(format), Some(path)) = (format, &self.movie) else { return Ok(None) };
        let delay = (1000.0 / self.fps).round() as u16;
        if delay < format.least_delay() {
            let most = 1000 / u32::from(format.least_delay());
            return Err(Failure::usage(format!(
                "--fps {}: a movie in `{}` can have at most {most} frames a second",
                self.fps,
                path.display()
            )));
        }
        let (part, file) = files::Part::create(path)?;
        let dimensions = (self.look.size.width(), self.look.size.height());
        let movie = Movie::new(BufWriter::new(file), format, dimensions, frames, delay)?;
        Ok(Some(Film { movie, part }))
    }

    /// Moves the scene to a frame and submits the build of its tree.
    fn build(
        &self,
        stage: &mut Stage,
        animation: &mut Animation,
        frame: usize,
    ) -> Result<FrameTimes, Failure> {
        let start = Instant::now();
        let Stage { scene, tracer, placed, options, .. } = stage;
        let change = animation.set(frame, scene)?;
        if change == Change::Everything {
            scene.lights.clone_from(&placed.lights);
        }
        let mesh = scene.mesh()?;
        match change {
            Change::Nothing => {}
            Change::Positions => tracer.update_normals(&mesh, &scene.appearance()),
            Change::Everything => tracer.update_appearance(&mesh, &scene.appearance())?,
        }
        let update_ms = milliseconds(start);
        let start = Instant::now();
        tracer.submit_rebuild(&Moved { mesh, name: Some(frame as u64) }, options)?;
        Ok(FrameTimes {
            frame,
            time_s: animation.time(frame),
            triangles: scene.indices.len() as u32,
            rays: 0,
            update_ms,
            build_ms: milliseconds(start),
            trace_ms: 0.0,
            total_ms: 0.0,
            device: None,
        })
    }

    /// Submits the frame whose tree was submitted.
    fn trace(
        &self,
        stage: &mut Stage,
        animation: &Animation,
        mut took: FrameTimes,
    ) -> Result<FrameTimes, Failure> {
        let start = Instant::now();
        stage.tracer.finish_rebuild()?;
        took.build_ms += milliseconds(start);
        let start = Instant::now();
        let camera: Camera = match animation.camera(took.frame) {
            Some(camera) => self.look.camera(camera)?,
            None => stage.placed.camera,
        };
        let request = self.request(camera, stage)?;
        stage.tracer.submit_frame(&stage.scene.mesh()?, &request)?;
        took.trace_ms = milliseconds(start);
        Ok(took)
    }

    /// What is asked of the tracer for a frame.
    fn request(&self, camera: Camera, stage: &Stage) -> Result<FrameRequest<'static>, Failure> {
        Ok(FrameRequest {
            camera: camera.pinhole(self.look.size),
            size: self.look.size,
            settings: self.look.settings(SAMPLES, &stage.placed)?,
            outputs: Outputs::PIXELS,
            query: self.common.query_options(),
        })
    }

    /// Waits for the frame that was submitted, takes its picture, and gives its times.
    fn finish(
        &self,
        stage: &mut Stage,
        took: FrameTimes,
        pixels: &mut Vec<u32>,
    ) -> Result<FrameTimes, Failure> {
        let start = Instant::now();
        let made = stage.tracer.finish_frame()?;
        pixels.clear();
        pixels.extend_from_slice(&made.pixels()?);
        let rays = made.stats().rays();
        let trace_ms = took.trace_ms + milliseconds(start);
        let total_ms = took.update_ms + took.build_ms + trace_ms;
        Ok(FrameTimes { rays, trace_ms, total_ms, ..took })
    }

    fn write(
        &self,
        pixels: &[u32],
        number: usize,
        movie: Option<&mut Film>,
    ) -> Result<(), Failure> {
        if self.out.is_none() && movie.is_none() {
            return Ok(());
        }
        let screen = picture::screen(self.look.size, pixels)?;
        if let Some(folder) = &self.out {
            let path = folder.join(format!("frame-{number:04}.png"));
            files::write(&path, &picture::encode_png(&screen)?)?;
        }
        if let Some(film) = movie {
            film.movie.push(&screen)?;
        }
        Ok(())
    }

    fn report(
        &self,
        stage: &Stage,
        build: BuildReport,
        described: &str,
        frames: Vec<FrameTimes>,
        output: Vec<String>,
    ) -> Result<(), Failure> {
        let of = |time: fn(&FrameTimes) -> f64| Percentiles::of(frames.iter().map(time).collect());
        let total = of(|times| times.total_ms);
        let report = AnimateReport {
            build,
            width: self.look.size.width(),
            height: self.look.size.height(),
            samples: self.look.settings(SAMPLES, &stage.placed)?.samples,
            lights: stage.placed.lights.len(),
            lights_asked: stage.placed.asked(),
            update_ms: of(|times| times.update_ms),
            build_frame_ms: of(|times| times.build_ms),
            trace_ms: of(|times| times.trace_ms),
            total_ms: total,
            frames_per_s: total.per_second(),
            frames,
            output,
        };
        if self.common.json {
            return print_json(&report);
        }
        if self.common.quiet {
            return Ok(());
        }
        let row = |name: &str, p: &Percentiles| {
            format!("{name:<9}{:>9.2} {:>9.2} {:>9.2}\n", p.p50, p.p95, p.p99)
        };
        let rays: u64 = report.frames.iter().map(|times| times.rays).sum();
        let mut text = format!(
            "{described}frames   {} of {}x{}, {} rays in all\n\
             ms             p50       p95       p99\n",
            report.frames.len(),
            report.width,
            report.height,
            rays
        );
        text += &row("update", &report.update_ms);
        text += &row("build", &report.build_frame_ms);
        text += &row("trace", &report.trace_ms);
        text += &row("total", &report.total_ms);
        text += &row("frames/s", &report.frames_per_s);
        text += &match report.output.is_empty() {
            true => "written  nothing; --out DIR and --movie FILE keep the frames\n".to_owned(),
            false => format!("written  {}\n", report.output.join(", ")),
        };
        output::data(&text)
    }
}
