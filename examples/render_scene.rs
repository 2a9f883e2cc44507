//! Renders a built-in scene to `render_scene.png` in the folder for temporary files.

use splitplane::render::{Size, render};
use splitplane::scene::{Placement, Scene};
use splitplane::{Backend, BuildOptions, CpuBackend, QueryOptions};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A path of an .obj file does as well, with the feature `obj`.
    let scene = Scene::open("builtin:stadium")?;
    let accelerator = CpuBackend::new().build(&scene.mesh()?, &BuildOptions::default())?;

    // Scenes without a camera get one that suits them.
    let size = Size::new(640, 360)?;
    let placement = Placement::of(&scene, accelerator.as_ref(), size.aspect())?;
    let options = QueryOptions::default();
    let rendered = render(accelerator.as_ref(), &scene, &placement, size, &options, &|_| ())?;

    let path = std::env::temp_dir().join("render_scene.png");
    rendered.image.save(&path)?;
    println!(
        "{} rays, {:?} for the first wave: {}",
        rendered.rays,
        rendered.primary,
        path.display()
    );
    Ok(())
}
