//! A thousand objects, of which one moves: the trees of the geometries stay, and so does nearly all of the tree over the objects.
//!
//! ```sh
//! cargo run --release --example scene
//! ```

use splitplane::objects::{Instance, Scene, SceneHit, SceneOptions, translation};
use splitplane::{Backend, BuildOptions, CpuBackend, Mesh, Ray};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let positions = [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]];
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let mut scene = Scene::new();
    let tetrahedron = scene.add_mesh(&Mesh::indexed(&positions, &faces)?)?;
    let mut objects = Vec::new();
    for i in 0..1000u16 {
        let place = [i % 10, i / 10 % 10, i / 100].map(f32::from);
        objects.push(scene.add_instance(Instance::new(tetrahedron, translation(place)))?);
    }

    let (backend, options) = (CpuBackend::new(), BuildOptions::default());
    let mut built = backend.build_scene(&scene, &options)?;
    println!("{} objects, digest {}", scene.len(), built.scene().digest());

    // One goes aside.
    scene.move_instance(objects[555], translation([0.25, 0.25, 12.0]))?;
    let report = backend.update_scene(&mut built, &scene, &options)?;
    println!(
        "moved {}: {} geometries built, {} nodes of the tree over the objects changed",
        report.instances_changed, report.geometries_built, report.top_nodes_changed
    );

    // Down along z, one ray for each column of objects.
    let at = |i: u16| f32::from(i) + 0.375;
    let rays: Vec<Ray> =
        (0..100).map(|i| Ray::new([at(i % 10), at(i / 10), 20.0], [0.0, 0.0, -1.0])).collect();
    let mut hits = vec![SceneHit::MISS; rays.len()];
    let report = built.closest_hits(&rays, &mut hits, &SceneOptions::default())?;
    let nearest = hits[0].some().ok_or("the moved object is on top")?;
    assert_eq!(nearest.instance, objects[555].0);
    println!(
        "{} rays entered {} objects; the first hits object {} at t = {}",
        rays.len(),
        report.entered,
        nearest.instance,
        nearest.t
    );
    Ok(())
}
