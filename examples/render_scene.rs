//! Renders a built-in scene to `render_scene.png` in the folder for temporary files.

use splitplane::render::{RenderSettings, Size};
use splitplane::scene::{Placement, Scene};
use splitplane::tracer::{FrameRequest, Tracer};
use splitplane::{BackendKind, BuildOptions, OpenOptions};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A path of an .obj file does as well, with the feature `obj`.
    let mut scene = Scene::open("builtin:spheres")?;
    let (mut tracer, why) = Tracer::open(BackendKind::Auto, &OpenOptions::default())?;
    println!("{}: {why}", tracer.backend().name);
    tracer.build(&scene, &BuildOptions::default())?;

    // Scenes without a camera or lights get some that suit them.
    let size = Size::new(640, 360)?;
    let placement = Placement::of(&scene, tracer.accelerator()?, size.aspect())?;
    scene.lights = placement.lights;
    tracer.describe_looks(&scene)?;

    let settings = RenderSettings { samples: 4, ..RenderSettings::default() };
    let request = FrameRequest { settings, ..FrameRequest::new(&placement.camera, size) };
    let stats = tracer.frame(&scene, &request)?;
    let bytes: Vec<u8> = tracer.pixels()?.iter().flat_map(|pixel| pixel.to_le_bytes()).collect();

    let path = std::env::temp_dir().join("render_scene.png");
    let picture = image::RgbaImage::from_raw(size.width(), size.height(), bytes);
    picture.ok_or("a picture of another size")?.save(&path)?;
    println!("{} rays: {}", stats.rays(), path.display());
    Ok(())
}
