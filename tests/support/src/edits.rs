//! Random edits of scenes: geometries that come, change, grow, shrink and go, their opacity masks, and instances.

use splitplane_core::mesh::Mesh;
use splitplane_core::scene::shape::{Shapes, Sphere};
use splitplane_core::scene::{GeometryId, Instance, InstanceId, OpacityMask, Scene};

use crate::objects::{self, Kind};
use crate::random::Random;
use crate::scenes;

/// A mesh of another size than most.
fn mesh(random: &mut Random) -> scenes::Scene {
    let seed = u64::from(random.bits());
    match random.below(8) {
        0 => scenes::none(),
        1 => scenes::one(),
        2 => scenes::grid_boxes(1 + random.below(3)),
        3 | 4 => scenes::sphere(4 + random.below(8), random.point(0.5).map(f64::from), 0.75),
        _ => scenes::soup(1 + random.below(300), 0.4, seed),
    }
}

fn shapes(random: &mut Random) -> Shapes {
    let count = random.below(40);
    let one = |random: &mut Random| Sphere { centre: random.point(1.5), radius: 0.3 };
    Shapes::Spheres((0..count).map(|_| one(random)).collect())
}

/// A mesh with the same number of triangles, whose vertices moved.
fn moved(scene: &Scene, geometry: GeometryId, random: &mut Random) -> Vec<[[f32; 3]; 3]> {
    let own = scene.geometry(geometry).expect("a geometry");
    let mesh = own.mesh();
    let by = random.point(0.2);
    let corners = |i| mesh.triangle(i).map(|p| [0, 1, 2].map(|k| p[k] + by[k] * p[(k + 1) % 3]));
    (0..mesh.len()).map(corners).collect()
}

fn change_geometry(scene: &mut Scene, geometry: GeometryId, random: &mut Random) {
    let own = scene.geometry(geometry).expect("a geometry");
    if own.shapes().is_some() {
        scene.replace_shapes(geometry, shapes(random)).expect("an edit");
        return;
    }
    let triangles = own.mesh().len();
    match random.below(5) {
        0 => {
            let level = random.below(4) as u32;
            let mask = OpacityMask::new(triangles, level, |_, _| random.below(2) == 0);
            scene.set_opacity(geometry, Some(mask.expect("a mask"))).expect("an edit");
        }
        1 => scene.set_opacity(geometry, None).expect("an edit"),
        2 | 3 => {
            let triangles = moved(scene, geometry, random);
            scene
                .replace_mesh(geometry, &Mesh::soup(&triangles).expect("a mesh"))
                .expect("an edit");
        }
        _ => scene.replace_mesh(geometry, &mesh(random).mesh()).expect("an edit"),
    }
}

fn add_instance(scene: &mut Scene, geometry: GeometryId, random: &mut Random) {
    let instance = Instance::new(geometry, objects::transform(Kind::Ordinary, random));
    let name = scene.add_instance(instance).expect("an instance");
    if random.below(6) == 0 {
        scene.set_mask(name, random.bits()).expect("an edit");
    }
}

/// Edits a scene of objects in one random way; there are always some instances.
pub fn edit(scene: &mut Scene, random: &mut Random) {
    let geometries: Vec<GeometryId> = scene.geometries().map(|(name, _)| name).collect();
    let instances: Vec<InstanceId> = scene.instances().map(|(name, _)| name).collect();
    match random.below(10) {
        0..4 => change_geometry(scene, random.pick(&geometries), random),
        4 => {
            let name = if random.below(3) == 0 {
                scene.add_shapes(shapes(random)).expect("a geometry")
            } else {
                scene.add_mesh(&mesh(random).mesh()).expect("a geometry")
            };
            add_instance(scene, name, random);
        }
        5 if geometries.len() > 3 => {
            let gone = random.pick(&geometries);
            for (name, mut own) in
                scene.instances().map(|(name, own)| (name, *own)).collect::<Vec<_>>()
            {
                if own.geometry == gone {
                    own.geometry = random.pick(&geometries);
                    if own.geometry == gone {
                        scene.remove_instance(name).expect("an edit");
                    } else {
                        scene.set_instance(name, own).expect("an edit");
                    }
                }
            }
            scene.remove_geometry(gone).expect("an edit");
        }
        6 if instances.len() > 6 => {
            scene.remove_instance(random.pick(&instances)).expect("an edit");
        }
        7 if !instances.is_empty() => {
            let becomes = objects::transform(Kind::Ordinary, random);
            scene.move_instance(random.pick(&instances), becomes).expect("an edit");
        }
        _ => add_instance(scene, random.pick(&geometries), random),
    }
}
