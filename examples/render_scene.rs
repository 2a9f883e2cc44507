//! Renders a built-in scene to `render_scene.png` in the folder for temporary files.

use splitplane::render::{RenderSettings, Size};
use splitplane::scene::{Placement, Scene};
use splitplane::tracer::{FrameRequest, Tracer};
use splitplane::{BackendKind, BuildOptions, OpenOptions};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A path of an .obj file does as well, with the feature `obj`.
    let mut scene = Scene::open("builtin:spheres")?;
    let opened = BackendKind::Auto.open_engine(&OpenOptions::default())?;
    let (mesh, options) = (scene.mesh()?, BuildOptions::default());
    let mut tracer = Tracer::load(opened.engine, &mesh, &scene.appearance(), &options)?;
    println!("{}: {}", tracer.backend().name, opened.reason);

    // Scenes without a camera or lights get some that suit them.
    let size = Size::new(640, 360)?;
    let tree = tracer.accelerator().ok_or("the tree is on the GPU alone")?;
    let placement = Placement::of(&scene, tree, size.aspect())?;
    scene.lights = placement.lights;
    let mesh = scene.mesh()?;
    tracer.update_appearance(&mesh, &scene.appearance())?;

    let settings = RenderSettings { samples: 4, ..RenderSettings::default() };
    let request =
        FrameRequest { settings, ..FrameRequest::new(placement.camera.pinhole(size), size) };
    let frame = tracer.frame(&mesh, &request)?;
    let bytes: Vec<u8> = frame.pixels()?.iter().flat_map(|pixel| pixel.to_le_bytes()).collect();

    let path = std::env::temp_dir().join("render_scene.png");
    let picture = image::RgbaImage::from_raw(size.width(), size.height(), bytes);
    picture.ok_or("a picture of another size")?.save(&path)?;
    println!("{} rays: {}", frame.stats().rays(), path.display());
    Ok(())
}
