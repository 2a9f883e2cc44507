//! Inside or outside, against whole numbers and closed forms: points on vertices, edges and faces, beside
//! them by one float, far away, tiny and huge; the same in every direction.

use crate::common::{cube, tetrahedron};
use splitplane::core::backend::locate_along;
use splitplane::core::query::inside::DIRECTION;
use splitplane::{Backend, BuildOptions, CpuBackend, LocateOptions, Located, Location, Rule};
use splitplane_test_support::random::Random;
use splitplane_test_support::rational;
use splitplane_test_support::scenes::{self, Scene};

fn locate(scene: &Scene, points: &[[f32; 3]]) -> Located {
    let accelerator = CpuBackend::new().build(&scene.mesh(), &BuildOptions::default()).unwrap();
    let located = accelerator.locate(points, &LocateOptions::default()).unwrap();
    // Any direction gives the same, those along axes and edges too.
    let mut random = Random::new(points.len() as u64);
    let mut directions = vec![
        [1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 1.0, 0.0],
        [-1.0, 1.0, -1.0],
    ];
    directions.extend((0..3).map(|_| random.direction().map(|x| x as f32)));
    for direction in directions {
        let other =
            locate_along(&*accelerator, points, direction, &LocateOptions::default()).unwrap();
        assert_eq!(other, located, "{} {direction:?}", scene.name);
    }
    assert!(DIRECTION.iter().all(|x| *x != 0.0) && located.report.answered_by_cpu == 0);
    located
}

/// A torus around the z axis, `around` by `across` quads, outside in front.
fn torus(around: u32, across: u32) -> Scene {
    let turn = |i: u32, n: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..around {
        for j in 0..across {
            let (u, v) = (turn(i, around), turn(j, across));
            let out = 2.0 + 0.75 * v.cos();
            positions.push([out * u.cos(), out * u.sin(), 0.75 * v.sin()].map(|x| x as f32));
            let at = |i: u32, j: u32| i % around * across + j % across;
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    Scene { name: "torus".into(), positions, indices: Some(triangles) }
}

fn turned(scene: &Scene) -> Scene {
    let indices = scene.indices.iter().flatten().map(|&[a, b, c]| [a, c, b]).collect();
    Scene { indices: Some(indices), ..scene.clone() }.named("turned inside out")
}

fn scenes_to_ask() -> Vec<Scene> {
    let one = cube([-1.0; 3], [1.0; 3]);
    vec![
        tetrahedron(),
        scenes::sphere(6, [0.0; 3], 1.0),
        scenes::sphere(5, [3e5, -2e5, 1e5], 1.0),
        torus(9, 6),
        one.joined(&cube([-0.5; 3], [0.5; 3]), "nested cubes"),
        one.joined(&turned(&cube([-0.5; 3], [0.5; 3])), "a hollow cube"),
        one.joined(&cube([1.0, -1.0, -1.0], [3.0, 1.0, 1.0]), "cubes that share a face"),
        one.joined(&cube([1.0; 3], [2.0; 3]), "cubes that share a corner"),
        one.joined(&one, "the same cube twice"),
        one.joined(&turned(&one), "a cube and its inside"),
        turned(&one),
        scenes::scaled(&tetrahedron(), 1e-37, "tiny"),
        scenes::scaled(&torus(5, 4), 1e37, "huge"),
        one,
    ]
}

/// Points in, around and exactly on a scene, and beside those by one float.
fn points(scene: &Scene, count: usize, seed: u64) -> Vec<[f32; 3]> {
    let mut random = Random::new(seed);
    let mesh = scene.mesh();
    let (mut lo, mut hi) = ([f32::MAX; 3], [-f32::MAX; 3]);
    for position in &scene.positions {
        for axis in 0..3 {
            lo[axis] = lo[axis].min(position[axis]);
            hi[axis] = hi[axis].max(position[axis]);
        }
    }
    let mut points = Vec::new();
    for _ in 0..count {
        // Somewhere; then on quarters of the box, where the planes of faces are.
        points.push([0, 1, 2].map(|axis| {
            random.between(f64::from(lo[axis]) * 1.1, f64::from(hi[axis]) * 1.1 + 1e-40) as f32
        }));
        points.push([0, 1, 2].map(|axis| {
            lo[axis] + (hi[axis] - lo[axis]) * ((random.below(7) as f32 - 1.0) * 0.25)
        }));
        // A corner, the middle of an edge, a point of a face, as near as floats come.
        let corners = mesh.triangle(random.below(mesh.len()));
        let weights = [
            [1.0, 0.0, 0.0],
            [0.5, 0.5, 0.0],
            [0.25, 0.75, 0.0],
            [0.5, 0.25, 0.25],
            random.barycentric(),
        ];
        for weights in weights {
            let point = [0, 1, 2].map(|axis| {
                (0..3).map(|i| weights[i] * f64::from(corners[i][axis])).sum::<f64>() as f32
            });
            points.push(point);
            let axis = random.below(3);
            for beside in [point[axis].next_up(), point[axis].next_down()] {
                let mut near = point;
                near[axis] = beside;
                points.push(near);
            }
        }
    }
    points
}

#[test]
fn windings_are_those_of_whole_numbers() {
    let mut tally = std::collections::BTreeMap::new();
    for (number, scene) in scenes_to_ask().iter().enumerate() {
        let mesh = scene.mesh();
        let points = points(scene, 16, number as u64);
        let located = locate(scene, &points);
        for (i, &point) in points.iter().enumerate() {
            let expected = match rational::on_surface(&mesh, point) {
                Some(_) => None,
                None => Some(rational::winding(&mesh, point)),
            };
            assert_eq!(located.windings[i], expected, "{} {point:?}", scene.name);
            let odd = expected.map(|winding| winding % 2 != 0);
            let location = located.location(i, Rule::EvenOdd);
            assert_eq!(location == Location::Boundary, odd.is_none());
            assert_eq!(location == Location::Inside, odd == Some(true));
            let location = located.location(i, Rule::NonZero);
            assert_eq!(location == Location::Inside, expected.is_some_and(|w| w != 0));
            *tally.entry(expected).or_insert(0) += 1;
        }
    }
    for winding in [None, Some(-1), Some(0), Some(1), Some(2)] {
        assert!(tally.get(&winding).is_some_and(|&count| count > 20), "{tally:?}");
    }
}

/// A cube, whose inside needs no other arithmetic than comparison; far away too, where few floats are left.
#[test]
fn a_cube_is_what_comparison_says() {
    let mut counts = [0; 3];
    for (lo, hi) in [
        ([-1.0f32; 3], [1.0f32; 3]),
        ([1e7; 3], [1e7 + 8.0; 3]),
        ([-1e-37; 3], [3e-37; 3]),
        ([-1e38; 3], [1e38; 3]),
        ([0.0, -5.0, 100.0], [1e-20, 5.0, 1e10]),
    ] {
        let scene = cube(lo, hi);
        let points = points(&scene, 150, 5);
        let located = locate(&scene, &points);
        for (i, point) in points.iter().enumerate() {
            let snapped = point.map(splitplane_test_support::oracle::snap);
            let outside = (0..3).any(|k| snapped[k] < lo[k] || snapped[k] > hi[k]);
            let on = (0..3).any(|k| snapped[k] == lo[k] || snapped[k] == hi[k]);
            let expected = match (outside, on) {
                (true, _) => Location::Outside,
                (false, true) => Location::Boundary,
                (false, false) => Location::Inside,
            };
            assert_eq!(located.location(i, Rule::NonZero), expected, "{lo:?} {point:?}");
            counts[expected as usize] += 1;
        }
    }
    assert!(counts.iter().all(|count| *count > 200), "{counts:?}");
}

#[test]
fn odd_points_and_scenes() {
    let scene = cube([-1.0; 3], [1.0; 3]);
    let nan = [[f32::NAN, 0.0, 0.0], [0.0, f32::INFINITY, 0.0]];
    assert_eq!(locate(&scene, &nan).windings, [Some(0); 2]);
    assert_eq!(locate(&scene, &[]).windings, []);
    assert_eq!(locate(&scenes::none(), &[[0.0; 3]]).windings, [Some(0)]);
    // What is snapped: a point that counts as the origin, which is a corner of the tetrahedron.
    assert_eq!(locate(&tetrahedron(), &[[1e-40, -0.0, 0.0]]).windings, [None]);
    // More than one part.
    let many: Vec<[f32; 3]> = (0..10_000).map(|i| [i as f32 / 5_000.0, 0.1, 0.2]).collect();
    let located = locate(&scene, &many);
    for (i, winding) in located.windings.iter().enumerate() {
        let expected = (i != 5_000).then_some(i32::from(i < 5_000));
        assert_eq!(*winding, expected, "{i}");
    }
}
