//! One edit of a scene, and of the list of what should be there.

use super::library::Library;
use super::model::{Corners, Model};
use crate::source::Source;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Culling;
use splitplane_core::scene::shape::{Capsule, Shapes, Sphere};
use splitplane_core::scene::{
    GeometryId, IDENTITY, Instance, InstanceId, OpacityMask, Scene, SceneError, Transform,
};
use splitplane_test_support::random::Random;

/// Instances of one scene, but for those that come as a crowd.
const INSTANCES: usize = 24;

fn triangles(source: &mut Source<'_>) -> Vec<Corners> {
    let count = source.below(9);
    (0..count).map(|_| [(); 3].map(|()| [(); 3].map(|()| source.number()))).collect()
}

fn shapes(source: &mut Source<'_>) -> Shapes {
    let count = source.below(9);
    if source.once_in(2) {
        let sphere =
            |_| Sphere { centre: [(); 3].map(|()| source.number()), radius: source.number() };
        return Shapes::Spheres((0..count).map(sphere).collect());
    }
    let capsule = |_| Capsule {
        ends: [(); 2].map(|()| [(); 3].map(|()| source.number())),
        radius: source.number(),
    };
    Shapes::Capsules((0..count).map(capsule).collect())
}

pub(crate) fn transform(source: &mut Source<'_>) -> Transform {
    let mut out = IDENTITY;
    match source.below(4) {
        0 => {}
        1 => out.iter_mut().for_each(|row| row[3] = source.step()),
        2 => {
            for (axis, row) in out.iter_mut().enumerate() {
                (row[axis], row[3]) = (source.number(), source.step());
            }
        }
        _ => out.iter_mut().for_each(|row| *row = [(); 4].map(|()| source.number())),
    }
    out
}

fn instance(source: &mut Source<'_>, geometry: GeometryId) -> Instance {
    Instance {
        mask: source.pick(&[u32::MAX, 1, 2, 3, 0]),
        id: source.below(100) as u32,
        culling: source.pick(&[Culling::None, Culling::Back, Culling::Front]),
        ..Instance::new(geometry, transform(source))
    }
}

/// A mesh of a few small triangles, and instances of it about the origin until there are `count` in all. A few bytes make a tree of
/// several levels so, which edits one by one would never reach.
fn crowd(random: &mut Random, count: usize, scene: &mut Scene, model: &mut Model) {
    let mut around = |size: f64| (size * (random.unit() - 0.5)) as f32;
    let small: Vec<_> = (0..4).map(|_| [(); 3].map(|()| [(); 3].map(|()| around(1.0)))).collect();
    let name = scene.add_mesh(&Mesh::soup(&small).expect("a mesh")).expect("a name");
    model.geometries.insert(name.0, small);
    while model.instances.len() < count {
        let mut transform = IDENTITY;
        transform.iter_mut().for_each(|row| row[3] = around(6.0));
        let own = Instance::new(name, transform);
        model.instances.insert(scene.add_instance(own).expect("a name").0, own);
    }
    model.other_instances = true;
}

/// Moves one in `part` instances by up to `reach`.
fn stir(random: &mut Random, part: usize, reach: f64, scene: &mut Scene, model: &mut Model) {
    for (&name, own) in &mut model.instances {
        if random.below(part) > 0 {
            continue;
        }
        let mut to = own.transform;
        to.iter_mut().for_each(|row| row[3] += (reach * (random.unit() - 0.5)) as f32);
        match scene.move_instance(InstanceId(name), to) {
            Ok(()) => own.transform = to,
            Err(error) => refusal(name, &to, error),
        }
    }
}

/// Moves the vertices of all meshes, or of some, a little: what changes every frame, by a few bytes.
pub(super) fn deform(source: &mut Source<'_>, scene: &mut Scene, model: &mut Model) {
    let (random, part) = (&mut Random::new(source.long()), source.pick(&[1, 2]));
    for (&name, triangles) in &mut model.geometries {
        if model.shapes.contains(&name) || random.below(part) > 0 {
            continue;
        }
        for corner in triangles.iter_mut().flatten() {
            corner[random.below(3)] += (random.unit() - 0.5) as f32;
        }
        let mesh = Mesh::soup(triangles).expect("a mesh");
        scene.replace_mesh(GeometryId(name), &mesh).expect("a mesh of triangles");
    }
}

/// Whether a transform is refused, and for what.
fn refusal(name: u32, transform: &Transform, error: SceneError) {
    let finite = transform.iter().flatten().all(|x| x.is_finite());
    match error {
        SceneError::NonFiniteTransform { instance, row, column } => {
            assert!(instance == name && !transform[row][column].is_finite());
        }
        SceneError::SingularTransform { instance } => assert!(finite && instance == name),
        error => panic!("{error}"),
    }
    crate::check_message(&error.to_string(), &format!("instance {name} "));
}

/// One edit, of both. True where a geometry got the arrays of another one.
pub(super) fn edit(
    source: &mut Source<'_>,
    library: &dyn Library,
    scene: &mut Scene,
    model: &mut Model,
) -> bool {
    // Names that are there, and some that are not.
    let name = |source: &mut Source<'_>, most: usize| source.below(most + 1) as u32;
    let geometry = GeometryId(name(source, scene.geometry_names()));
    let one = InstanceId(name(source, scene.instance_names()));
    let is_there = model.instances.get(&one.0).copied();
    match source.below(17) {
        0 => {
            let triangles = triangles(source);
            let added = scene.add_mesh(&Mesh::soup(&triangles).expect("a mesh"));
            assert!(model.geometries.insert(added.expect("a name").0, triangles).is_none());
        }
        1 => {
            let triangles = triangles(source);
            let replaced = scene.replace_mesh(geometry, &Mesh::soup(&triangles).expect("a mesh"));
            assert_eq!(replaced.is_ok(), model.is_mesh(geometry.0));
            if replaced.is_ok() {
                let count = triangles.len();
                let was = model.geometries.insert(geometry.0, triangles).expect("a mesh");
                if was.len() != count {
                    model.masked.remove(&geometry.0);
                }
            }
        }
        2 => {
            let used = model.instances.values().filter(|own| own.geometry == geometry).count();
            match scene.remove_geometry(geometry) {
                Ok(()) => {
                    assert!(used == 0 && model.geometries.remove(&geometry.0).is_some());
                    model.shapes.remove(&geometry.0);
                    model.masked.remove(&geometry.0);
                }
                Err(SceneError::GeometryInUse { instances, instance, .. }) => {
                    assert_eq!(instances as usize, used);
                    assert_eq!(model.instances[&instance].geometry, geometry);
                }
                Err(error) => {
                    assert_eq!(error, SceneError::UnknownGeometry { geometry: geometry.0 });
                    assert!(!model.geometries.contains_key(&geometry.0));
                }
            }
        }
        3 => match scene.remove_instance(one) {
            Ok(()) => {
                model.other_instances = true;
                assert!(model.instances.remove(&one.0).is_some());
            }
            Err(error) => {
                assert_eq!(error, SceneError::UnknownInstance { instance: one.0 });
                assert!(is_there.is_none());
            }
        },
        4 => {
            let to = transform(source);
            match (scene.move_instance(one, to), is_there) {
                (Ok(()), Some(was)) => {
                    model.instances.insert(one.0, Instance { transform: to, ..was });
                }
                (Err(error), Some(_)) => refusal(one.0, &to, error),
                (moved, None) => {
                    assert_eq!(moved, Err(SceneError::UnknownInstance { instance: one.0 }));
                }
            }
        }
        5 => {
            let mask = source.bits();
            let masked = scene.set_mask(one, mask);
            assert_eq!(masked.is_ok(), is_there.is_some());
            model.instances.entry(one.0).and_modify(|own| own.mask = mask);
        }
        6 => {
            let set = shapes(source);
            if source.once_in(2) {
                let added = scene.add_shapes(set).expect("a name").0;
                assert!(model.geometries.insert(added, Vec::new()).is_none());
                assert!(model.shapes.insert(added));
            } else {
                let replaced = scene.replace_shapes(geometry, set);
                assert_eq!(replaced.is_ok(), model.shapes.contains(&geometry.0));
            }
        }
        7 => {
            let triangles = model.geometries.get(&geometry.0).map_or(0, Vec::len);
            let (bits, level) = (source.bits(), source.below(3) as u32);
            let is_opaque =
                |triangle, [u, _]: [f32; 2]| bits >> (triangle % 32) & 1 != 0 || u > 0.5;
            let mask = OpacityMask::new(triangles, level, is_opaque).expect("memory");
            let set = scene.set_opacity(geometry, Some(mask));
            assert_eq!(set.is_ok(), model.is_mesh(geometry.0));
            if set.is_ok() {
                model.masked.insert(geometry.0);
            }
        }
        8 => {
            let (seed, count) = (source.long(), source.pick(&[10, 24, 70, 200]));
            crowd(&mut Random::new(seed), count, scene, model);
        }
        9 => {
            let (seed, part) = (source.long(), source.pick(&[1, 2, 16]));
            let reach = source.pick(&[0.25, 2.0, 64.0]);
            stir(&mut Random::new(seed), part, reach, scene, model);
        }
        10 => {
            let from = GeometryId(name(source, scene.geometry_names()));
            let shared = library.share(scene, geometry, from);
            let known = [geometry, from].map(|own| model.geometries.contains_key(&own.0));
            assert_eq!(shared.is_ok(), known == [true; 2], "{shared:?}");
            if shared.is_err() {
                return false;
            }
            let triangles = model.geometries[&from.0].clone();
            model.geometries.insert(geometry.0, triangles);
            for set in [&mut model.shapes, &mut model.masked] {
                match set.contains(&from.0) {
                    true => set.insert(geometry.0),
                    false => set.remove(&geometry.0),
                };
            }
            return geometry != from;
        }
        11 | 12 => deform(source, scene, model),
        _ if model.instances.len() < INSTANCES => {
            let own = instance(source, geometry);
            let next = scene.instance_names() as u32;
            match scene.add_instance(own) {
                Ok(name) => {
                    model.other_instances = true;
                    assert!(model.instances.insert(name.0, own).is_none());
                }
                Err(SceneError::UnknownGeometry { .. }) => {
                    assert!(!model.geometries.contains_key(&geometry.0));
                }
                Err(
                    error @ (SceneError::NonFiniteTransform { instance, .. }
                    | SceneError::SingularTransform { instance }),
                ) => {
                    assert!(instance <= next && !model.instances.contains_key(&instance));
                    refusal(instance, &own.transform, error);
                }
                Err(error) => panic!("{error}"),
            }
        }
        _ => {}
    }
    false
}
