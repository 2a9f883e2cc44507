//! A scene that moves: its tree built from scratch for every frame, in the memory of the frame before.
//! Writes an animated PNG to the folder for temporary files.

use splitplane::picture::{self, Movie, MovieFormat};
use splitplane::render::{RenderSettings, Size};
use splitplane::scene::{Animation, Placement, SceneOptions};
use splitplane::tracer::{FrameRequest, Tracer};
use splitplane::{BackendKind, BuildOptions, OpenOptions};
use std::fs::File;
use std::io::BufWriter;
use std::num::NonZeroU32;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // With `Some(path)` in place of `None`: a folder of .obj files, or raw frames.
    let options = SceneOptions::default();
    let (mut scene, mut animation) = Animation::open("builtin:carousel", None, &options)?;
    let backend = BackendKind::Auto.open_engine(&OpenOptions::default())?.engine;
    let build = BuildOptions::default();
    let mut tracer = Tracer::load(backend, &scene.mesh()?, &scene.appearance(), &build)?;

    let size = Size::new(320, 180)?;
    let tree = tracer.accelerator().ok_or("the tree is on the GPU alone")?;
    let placement = Placement::of(&scene, tree, size.aspect())?;
    scene.lights = placement.lights;
    tracer.update_appearance(&scene.mesh()?, &scene.appearance())?;

    let path = std::env::temp_dir().join("animate.png");
    let frames = NonZeroU32::new(animation.frames() as u32).ok_or("no frames")?;
    let file = BufWriter::new(File::create(&path)?);
    let mut movie = Movie::new(file, MovieFormat::Apng, (320, 180), frames, 42)?;
    let settings = RenderSettings { depth: 4, ..RenderSettings::default() };
    let request =
        FrameRequest { settings, ..FrameRequest::new(placement.camera.pinhole(size), size) };
    let start = Instant::now();
    for frame in 0..animation.frames() {
        animation.set(frame, &mut scene)?;
        let mesh = scene.mesh()?;
        tracer.update_normals(&mesh, &scene.appearance());
        tracer.rebuild(&mesh, &build)?;
        let made = tracer.frame(&mesh, &request)?;
        movie.push(&picture::screen(size, &made.pixels()?)?)?;
    }
    movie.finish()?;
    println!("{} frames in {:?}: {}", frames, start.elapsed(), path.display());
    Ok(())
}
