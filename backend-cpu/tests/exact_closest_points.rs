//! Closest points of accuracy `exact`: the nearest triangle of rational arithmetic, on meshes where many are as near, or almost.

use crate::common::{ask, long};
use splitplane_core::backend::scene::{
    HostScene, SceneAccelerator, SceneClosestPoint, SceneClosestPointOptions,
};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::closest_point::{
    ClosestPoint, ClosestPointOptions, closest_point, of_triangle,
};
use splitplane_core::ray::Accuracy;
use splitplane_core::scene::shape::{Shapes, Sphere};
use splitplane_core::scene::{IgnoredTriangle, Instance, InstanceId, Scene, translation};
use splitplane_core::triangle::prepare;
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::close_calls::{self, Triangle};
use splitplane_test_support::near;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes;

const EXACT: ClosestPointOptions<'static> = ClosestPointOptions {
    max_distance: f32::INFINITY,
    accuracy: Accuracy::Exact,
    ignore: None,
    watch: None,
};

fn many(count: usize) -> usize {
    if long() { 20 * count } else { count }
}

fn points(triangles: &[Triangle], size: f32, count: usize, random: &mut Random) -> Vec<[f32; 3]> {
    (0..count).map(|_| close_calls::point(triangles, size, random)).collect()
}

/// What is said of a triangle: its closest point as computed in `f64`.
fn record(mesh: &Mesh<'_>, point: [f32; 3], triangle: Option<u32>) -> ClosestPoint {
    triangle.map_or(ClosestPoint::NONE, |triangle| {
        let corners = prepare(&mesh.triangle(triangle as usize)).corners;
        let point = prepare(&[point; 3]).corners[0].map(f64::from);
        ClosestPoint { triangle, ..of_triangle(point, &corners) }
    })
}

#[test]
fn the_triangle_is_that_of_rational_arithmetic() {
    let mut random = Random::new(3);
    let (mut by_other_accuracies, mut found) = (0, 0);
    for name in close_calls::Kind::ALL {
        for size in [1.0, 1e-30, 1e30] {
            let triangles = close_calls::mesh(name, 14, size, &mut random);
            let mesh = Mesh::soup(&triangles).expect("a mesh");
            let points = points(&triangles, size, many(300), &mut random);
            let near = ClosestPointOptions { max_distance: 0.5 * size, ignore: Some(2), ..EXACT };
            for options in [EXACT, near] {
                let expected: Vec<ClosestPoint> = points
                    .iter()
                    .map(|&point| {
                        record(&mesh, point, near::nearest_triangle(&mesh, point, &options))
                    })
                    .collect();
                found += expected.iter().filter(|own| own.is_some()).count();
                for (preset, layout) in
                    [(Preset::Fast, QueryLayout::Fast), (Preset::Best, QueryLayout::Compact)]
                {
                    let build = BuildOptions { layout, ..preset.config().into() };
                    for set in InstructionSet::available() {
                        let backend = CpuBackend::with_instruction_set(set);
                        let tree = backend.build_accelerator(&mesh, &build).expect("a tree");
                        let answers = ask(&tree, &points, &options);
                        for (at, (own, expected)) in answers.iter().zip(&expected).enumerate() {
                            assert_eq!(own, expected, "{name:?} {size:e} {set:?} {:?}", points[at]);
                        }
                        let view = tree.tree().view();
                        for (&point, expected) in points.iter().zip(&expected).step_by(7) {
                            let own = closest_point(&view, &mesh, point, &options).expect("memory");
                            assert_eq!(own, *expected, "{name:?} {size:e} {point:?}");
                        }
                    }
                }
                let usual = ClosestPointOptions { accuracy: Accuracy::Fast, ..options };
                let tree =
                    CpuBackend::new().build(&mesh, &BuildOptions::default()).expect("a tree");
                let usual = ask(&*tree, &points, &usual);
                let other = usual.iter().zip(&expected);
                by_other_accuracies +=
                    other.filter(|(own, expected)| own.triangle != expected.triangle).count();
            }
        }
    }
    // So the check sees what `exact` is for.
    assert!(found > 800 && by_other_accuracies > 20, "{by_other_accuracies} of {found}");
}

#[test]
fn the_greatest_distance_is_compared_exactly() {
    // The distance is the root of 3/4 of a square: no float.
    let third = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let whole = [[3.0, 4.0, 0.0], [6.0, 8.0, 0.0], [3.0, 4.0, 9.0]];
    for (triangle, size) in [(third, 1.0f32), (whole, 1.0), (third, 1e-30), (whole, 1e30)] {
        let triangles = [triangle.map(|corner| corner.map(|x| x * size))];
        let mesh = Mesh::soup(&triangles).expect("a mesh");
        let tree = CpuBackend::new().build(&mesh, &BuildOptions::default()).expect("a tree");
        let distance = ask(&*tree, &[[0.0; 3]], &EXACT)[0].distance();
        for max_distance in [distance.next_down(), distance, distance.next_up()] {
            let options = ClosestPointOptions { max_distance, ..EXACT };
            let expected = near::nearest_triangle(&mesh, [0.0; 3], &options);
            assert_eq!(
                ask(&*tree, &[[0.0; 3]], &options)[0].some().map(|own| own.triangle),
                expected
            );
        }
    }
    let sphere = scenes::sphere(6, [0.0; 3], 1.0);
    let tree = CpuBackend::new().build(&sphere.mesh(), &BuildOptions::default()).expect("a tree");
    let corner = sphere.positions[0];
    for (max_distance, some) in [(0.0, true), (-0.0, true), (-1.0, false), (f32::NAN, false)] {
        let options = ClosestPointOptions { max_distance, ..EXACT };
        assert_eq!(ask(&*tree, &[corner], &options)[0].is_some(), some, "{max_distance}");
    }
}

/// All instances, in the world, with the transforms' numbers as they are.
#[test]
fn of_scenes_it_is_that_of_all_instances() {
    let backend = CpuBackend::new();
    let mut differ = 0;
    for (seed, kind) in (0..).zip(Kind::ALL) {
        let mut random = Random::new(40 + seed);
        let mut scene = Scene::new();
        let sort = close_calls::Kind::ALL[seed as usize % 4];
        let triangles = close_calls::mesh(sort, 7, 1.0, &mut random);
        let one = scene.add_mesh(&Mesh::soup(&triangles).unwrap()).unwrap();
        let other = scene.add_mesh(&scenes::one().mesh()).unwrap();
        for number in 0..10 {
            let transform = objects::transform(kind, &mut random);
            let geometry = if number % 3 == 0 { other } else { one };
            // Some are in the same place.
            for _ in 0..1 + number % 2 {
                scene.add_instance(Instance::new(geometry, transform)).unwrap();
            }
        }
        let built = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
        let mut build = |mesh: &Mesh<'_>, options: &BuildOptions<'_>| backend.build(mesh, options);
        let host = HostScene::build(&scene, &BuildOptions::default(), &mut build).unwrap();
        let baked = objects::baked(&scene);
        let points = points(&baked, 1.0, many(100), &mut random);
        let exact = SceneClosestPointOptions { accuracy: Accuracy::Exact, ..Default::default() };
        let ignore = IgnoredTriangle { instance: InstanceId(1), triangle: 0 };
        let near = SceneClosestPointOptions { max_distance: 0.5, ignore: Some(ignore), ..exact };
        for options in [exact, near] {
            let mut found = vec![SceneClosestPoint::NONE; points.len()];
            built.closest_points(&points, &mut found, &options).unwrap();
            let mut by_host = found.clone();
            host.closest_points(&points, &mut by_host, &options).unwrap();
            assert!(found == by_host);
            let usual = SceneClosestPointOptions { accuracy: Accuracy::default(), ..options };
            let mut other = found.clone();
            built.closest_points(&points, &mut other, &usual).unwrap();
            for (&point, (own, other)) in points.iter().zip(found.iter().zip(&other)) {
                let expected = near::scene_nearest_triangle(&scene, point, &options);
                let own = own.some().map(|own| (InstanceId(own.instance), own.triangle));
                assert_eq!(own, expected, "{kind:?} {point:?}");
                let other = other.some().map(|own| (InstanceId(own.instance), own.triangle));
                differ += usize::from(other != expected);
            }
        }
    }
    assert!(differ > 0);
}

/// Distances of shapes are roots that whole numbers do not have.
#[test]
fn scenes_with_shapes_are_refused() {
    let backend = CpuBackend::new();
    let mut scene = Scene::new();
    let mesh = scene.add_mesh(&scenes::one().mesh()).unwrap();
    let spheres = Shapes::Spheres(vec![Sphere { centre: [0.0; 3], radius: 1.0 }]);
    let shapes = scene.add_shapes(spheres).unwrap();
    scene.add_instance(Instance { mask: 1, ..Instance::in_place(mesh) }).unwrap();
    scene
        .add_instance(Instance { mask: 2, ..Instance::new(shapes, translation([9.0, 0.0, 0.0])) })
        .unwrap();
    let built = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
    let mut closest = [SceneClosestPoint::NONE];
    let mut ask = |accuracy, mask| {
        let options = SceneClosestPointOptions { accuracy, mask, ..Default::default() };
        built.closest_points(&[[8.0, 0.0, 0.0]], &mut closest, &options).map(|_| ())
    };
    assert_eq!(ask(Accuracy::Watertight, u32::MAX), Ok(()));
    assert_eq!(ask(Accuracy::Exact, 1), Ok(()));
    let query = "closest points of shapes by accuracy `exact`";
    assert_eq!(ask(Accuracy::Exact, u32::MAX), Err(QueryError::Unsupported { query }));
}
