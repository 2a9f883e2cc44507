//! What crosses between host and GPU for each frame of a scene that moves, by counters: one frame after the other,
//! and with two frames in flight and vertices that stay on the device. Both give the same pictures.
//!
//! `cargo run --release --all-features --example frame_traffic -- SCENE [FRAMES [WIDTH HEIGHT]]`

use splitplane::gpu::{Gpu, OpenOptions, Traffic, WgpuBackend};
use splitplane::render::Size;
use splitplane::scene::{Animation, Placement, Scene, SceneOptions};
use splitplane::tracer::{FrameRequest, Moved, Tracer};
use splitplane::{BuildOptions, CpuBackend};
use std::path::PathBuf;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// A scene, its frames, and how to look at it.
struct Show {
    scene: Scene,
    animation: Animation,
    tracer: Tracer,
    request: FrameRequest<'static>,
}

fn open(gpu: &Gpu, scene: &str, frames: Option<&PathBuf>, size: Size) -> Outcome<Show> {
    let (mut scene, animation) =
        Animation::open(scene, frames.map(PathBuf::as_path), &SceneOptions::default())?;
    scene.camera = scene.camera.or(animation.camera(0));
    let options = BuildOptions::default();
    let tree = CpuBackend::new().build_accelerator(&scene.mesh()?, &options)?;
    let placement = Placement::of(&scene, &tree, size.aspect())?;
    scene.lights = placement.lights;
    let backend = WgpuBackend::new(gpu.clone())?;
    let tracer = Tracer::load(backend, &scene.mesh()?, &scene.appearance(), &options)?;
    let request = FrameRequest::new(placement.camera.pinhole(size), size);
    Ok(Show { scene, animation, tracer, request })
}

impl Show {
    fn move_to(&mut self, number: usize) -> Outcome<usize> {
        let frame = number % self.animation.frames();
        self.animation.set(frame, &mut self.scene)?;
        self.tracer.update_normals(&self.scene.mesh()?, &self.scene.appearance());
        Ok(frame)
    }

    fn submit(&mut self, number: usize) -> Outcome<()> {
        let name = Some(self.move_to(number)? as u64);
        let mesh = self.scene.mesh()?;
        Ok(self.tracer.submit_rebuild(&Moved { mesh, name }, &BuildOptions::default())?)
    }

    /// One frame after the other.
    fn in_turn(&mut self, number: usize) -> Outcome<Vec<u32>> {
        self.move_to(number)?;
        let mesh = self.scene.mesh()?;
        self.tracer.rebuild(&mesh, &BuildOptions::default())?;
        Ok(self.tracer.frame(&mesh, &self.request)?.pixels()?.into_owned())
    }

    /// The frame whose build was submitted; that of the next one is submitted while this one is traced.
    fn in_flight(&mut self, number: usize) -> Outcome<Vec<u32>> {
        self.tracer.finish_rebuild()?;
        self.tracer.submit_frame(&self.scene.mesh()?, &self.request)?;
        self.submit(number + 1)?;
        Ok(self.tracer.finish_frame()?.pixels()?.into_owned())
    }
}

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().unwrap_or_else(|| "builtin:carousel:4000".into());
    let frames = arguments.next().map(PathBuf::from);
    let width = arguments.next().map_or(Ok(64), |text| text.parse())?;
    let height = arguments.next().map_or(Ok(64), |text| text.parse())?;
    let size = Size::new(width, height)?;
    let gpu = Gpu::open(&OpenOptions::default())?;
    let mut in_turn = open(&gpu, &scene, frames.as_ref(), size)?;
    let mut in_flight = open(&gpu, &scene, frames.as_ref(), size)?;
    let count = in_turn.animation.frames().min(6);
    let (vertices, triangles) = (in_turn.scene.positions.len(), in_turn.scene.indices.len());
    println!(
        "{scene}: {vertices} vertices, {triangles} triangles, {width} x {height} pixels, {}",
        gpu.info().name
    );
    println!("frame | readbacks, bytes down, uploads, bytes up, buffers | the same in flight");
    in_flight.submit(0)?;
    // A second round, in which all has been seen.
    let all = in_turn.animation.frames();
    for number in (0..count).chain(all..all + 2) {
        if number == all {
            // Not shown: the frames between.
            for number in count..all {
                in_flight.in_flight(number)?;
            }
        }
        let start = gpu.traffic();
        let a = in_turn.in_turn(number)?;
        let middle = gpu.traffic();
        let b = in_flight.in_flight(number)?;
        let end = gpu.traffic();
        let words = |Traffic { readbacks, bytes_down, uploads, bytes_up, buffers, .. }: Traffic| {
            format!("{readbacks} {bytes_down:>9} {uploads} {bytes_up:>9} {buffers}")
        };
        println!("{number:>5} | {} | {}", words(middle - start), words(end - middle));
        if a != b {
            return Err(format!("the pictures of frame {number} differ").into());
        }
    }
    Ok(())
}
