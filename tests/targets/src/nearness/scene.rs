//! The same of scenes: a mesh placed by any transforms.

use super::{Own, is_plain};
use crate::scene_operations::transform;
use crate::source::Source;
use splitplane_core::backend::scene::{
    SceneAccelerator, SceneClosestPoint, SceneClosestPointOptions, SceneOverlapOptions,
    SceneTriangle,
};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::overlap::Volume;
use splitplane_core::scene::{Instance, InstanceId, Scene, Transform};
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::{near, overlap};

/// Closest points and overlaps of a scene, against all triangles of all instances.
pub(super) fn check(
    own: &Own,
    mesh: &Mesh<'_>,
    backend: &CpuBackend,
    fault: impl Fn(Box<dyn SceneAccelerator>) -> Box<dyn SceneAccelerator>,
    source: &mut Source<'_>,
) {
    let mut scene = Scene::new();
    let geometry = scene.add_mesh(mesh).expect("a few triangles");
    let mut instances: Vec<(InstanceId, Instance)> = Vec::new();
    for _ in 0..1 + source.below(3) {
        let mask = source.pick(&[u32::MAX, 1, 2]);
        let instance = Instance { mask, ..Instance::new(geometry, transform(source)) };
        // What is refused is the business of `scene_operations`.
        instances.extend(scene.add_instance(instance).ok().map(|name| (name, instance)));
    }
    let built = fault(backend.build_scene(&scene, &BuildOptions::default()).expect("memory"));
    let mask = source.pick(&[u32::MAX, 1, 2]);
    instances.retain(|(_, instance)| instance.mask & mask != 0);
    closest_points(own, &scene, built.as_ref(), mask, source);
    overlaps(own, built.as_ref(), &instances, mask, source);
}

fn closest_points(
    own: &Own,
    scene: &Scene,
    built: &dyn SceneAccelerator,
    mask: u32,
    source: &mut Source<'_>,
) {
    let points: Vec<[f32; 3]> = (0..1 + source.below(4)).map(|_| own.point(source)).collect();
    let max_distance = if source.once_in(3) { source.number() } else { f32::INFINITY };
    let options = SceneClosestPointOptions { max_distance, mask, ..Default::default() };
    let mut found = vec![SceneClosestPoint::NONE; points.len()];
    built.closest_points(&points, &mut found, &options).expect("equal lengths");
    for (point, found) in points.iter().zip(&found) {
        let expected = near::scene_closest_point(scene, *point, &options);
        assert_eq!(*found, expected, "{point:?} {options:?}");
    }
}

/// Corners in the world: sums in `f64`, rounded. `None` where one is beyond the greatest float.
fn in_world(transform: &Transform, corners: &Triangle) -> Option<Triangle> {
    let corners = corners.map(|corner| {
        let [x, y, z] = corner.map(f64::from);
        transform.map(|row| {
            let [a, b, c, d] = row.map(f64::from);
            (((a * x + b * y) + c * z) + d) as f32
        })
    });
    corners.as_flattened().iter().all(|x| x.is_finite()).then_some(corners)
}

fn overlaps(
    own: &Own,
    built: &dyn SceneAccelerator,
    instances: &[(InstanceId, Instance)],
    mask: u32,
    source: &mut Source<'_>,
) {
    let volumes: Vec<Volume<'_>> = (0..1 + source.below(3)).map(|_| own.volume(source)).collect();
    let options = SceneOverlapOptions { mask, ..Default::default() };
    let found = built.overlaps(&volumes, &options).expect("memory");
    let mut any = vec![false; volumes.len()];
    built.overlaps_any(&volumes, &mut any, &options).expect("equal lengths");
    for (number, volume) in volumes.iter().enumerate().filter(|(_, volume)| is_plain(volume)) {
        let mut expected = Vec::new();
        for &(instance, Instance { transform, .. }) in instances {
            for &(triangle, corners) in &own.triangles {
                let world = in_world(&transform, &corners).map(|world| prepare(&world).corners);
                if world.is_some_and(|world| overlap::meets(volume, &world)) {
                    expected.push(SceneTriangle { instance: instance.0, triangle });
                }
            }
        }
        assert_eq!(found.of(number), expected, "{volume:?} {instances:?}");
        assert_eq!(any[number], !expected.is_empty(), "{volume:?} {instances:?}");
    }
}
