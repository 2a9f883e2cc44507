//! Closest points on the CPU: the answers of brute force over all triangles, bit for bit, from every path, tree and instruction
//! set; distances against whole numbers.
//!
//! `SPLITPLANE_LONG=1` asks 20 times as many points.

use core::ops::ControlFlow;

use crate::common::{ask, long};
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, BuildOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::closest_point::{
    ClosestPoint, ClosestPointOptions, closest_point, of_triangle,
};
use splitplane_core::ray::Accuracy;
use splitplane_core::triangle::prepare;
use splitplane_core::watch::Progress;
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::aim::{Aim, Kind};
use splitplane_test_support::near;
use splitplane_test_support::random::Random;
use splitplane_test_support::rational;
use splitplane_test_support::scenes::{self, Scene};

const ANY: ClosestPointOptions<'static> = ClosestPointOptions {
    max_distance: f32::INFINITY,
    accuracy: Accuracy::Watertight,
    ignore: None,
    watch: None,
};

fn many(points: usize) -> usize {
    if long() { 20 * points } else { points }
}

/// Points on corners, edges and faces, near them, in the box, and far off.
fn points(scene: &Scene, count: usize, seed: u64) -> Vec<[f32; 3]> {
    let mesh = scene.mesh();
    if mesh.is_empty() {
        return vec![[0.5; 3]; count];
    }
    let mut aim = Aim::new(&mesh, seed);
    let bounds = aim.bounds();
    let size = bounds.diagonal().clamp(1e-30, 1e38);
    (0..count)
        .map(|number| {
            let target = aim.target(Kind::ALL[number % Kind::ALL.len()]);
            let random = aim.random();
            let away = match number % 5 {
                0 => 0.0,
                1 => 1e-6 * size,
                2 => 0.03 * size,
                3 => size,
                _ => 1e4 * size,
            };
            let direction = random.direction();
            [0, 1, 2].map(|axis| (target[axis] + away * direction[axis]) as f32)
        })
        .collect()
}

fn bits(found: &ClosestPoint) -> (u64, u32, [u32; 5]) {
    let [x, y, z] = found.point.map(f32::to_bits);
    let words = [x, y, z, found.u.to_bits(), found.v.to_bits()];
    (found.distance_squared.to_bits(), found.triangle, words)
}

/// The first point that is answered otherwise than by brute force.
fn first_fault(
    mesh: &Mesh<'_>,
    points: &[[f32; 3]],
    options: &ClosestPointOptions<'_>,
    answers: &[ClosestPoint],
) -> Option<String> {
    points.iter().zip(answers).find_map(|(&point, answer)| {
        let expected = near::closest_point(mesh, point, options);
        (bits(&expected) != bits(answer))
            .then(|| format!("{point:?}: {answer:?} in place of {expected:?}"))
    })
}

/// Scenes whose numbers are far from 1, too.
fn hostile() -> Vec<Scene> {
    let mut all = scenes::awkward();
    for (factor, name) in [(1e-30, "tiny"), (1e30, "huge"), (3e37, "at the end of the range")] {
        all.push(scenes::scaled(&scenes::soup(60, 0.3, 4), factor, name));
    }
    all.push(scenes::sphere(5, [1e7, -1e7, 1e7], 1000.0));
    all
}

#[test]
fn every_path_answers_as_brute_force() {
    let mut found = 0;
    for (number, scene) in hostile().iter().enumerate() {
        let mesh = scene.mesh();
        let points = points(scene, many(60), number as u64);
        let reach = points_limit(&mesh);
        let some = ClosestPointOptions { max_distance: reach, ignore: Some(3), ..ANY };
        for preset in [Preset::Fast, Preset::Best] {
            for layout in [QueryLayout::Fast, QueryLayout::Compact] {
                let options =
                    BuildOptions { config: preset.config(), layout, ..Default::default() };
                for set in InstructionSet::available() {
                    let backend = CpuBackend::with_instruction_set(set);
                    let tree = backend.build_accelerator(&mesh, &options).expect("a tree");
                    for options in [&ANY, &some] {
                        let answers = ask(&tree, &points, options);
                        let fault = first_fault(&mesh, &points, options, &answers);
                        assert_eq!(fault, None, "{} {preset:?} {layout:?} {set:?}", scene.name);
                        found += answers.iter().filter(|answer| answer.is_some()).count();
                    }
                    // The reference in the core, through the same tree.
                    let by_core = points.iter().map(|&point| {
                        closest_point(&tree.tree().view(), &mesh, point, &ANY).expect("memory")
                    });
                    let by_core: Vec<_> = by_core.collect();
                    assert_eq!(first_fault(&mesh, &points, &ANY, &by_core), None, "{}", scene.name);
                }
            }
        }
    }
    assert!(found > 10_000, "{found}");
}

/// A limit that some of the points are within.
fn points_limit(mesh: &Mesh<'_>) -> f32 {
    if mesh.is_empty() {
        return 1.0;
    }
    let bounds: Aabb = Aim::new(mesh, 1).bounds();
    (0.1 * bounds.diagonal()) as f32
}

/// The check sees what it is there for.
#[test]
fn faults_are_found() {
    let scene = scenes::grid_boxes(3);
    let mesh = scene.mesh();
    let points = points(&scene, 400, 1);
    let tree =
        CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
    let right = ask(&tree, &points, &ANY);
    assert_eq!(first_fault(&mesh, &points, &ANY, &right), None);
    let damaged = |damage: &dyn Fn(&mut ClosestPoint)| {
        let mut answers = right.clone();
        answers.iter_mut().for_each(damage);
        first_fault(&mesh, &points, &ANY, &answers)
    };
    // The higher of two triangles that are as near; one that lies behind; a last bit of the place.
    let last = (mesh.len() - 1) as u32;
    let among_equals = |answer: &mut ClosestPoint| {
        let again = ClosestPointOptions { ignore: Some(answer.triangle), ..ANY };
        let other = near::closest_point(&mesh, answer.point, &again);
        if other.distance_squared == 0.0 {
            answer.triangle = other.triangle;
        }
    };
    assert!(damaged(&among_equals).is_some());
    assert!(damaged(&|answer| answer.triangle = last).is_some());
    assert!(damaged(&|answer| answer.u = answer.u.next_up()).is_some());
    assert!(damaged(&|answer| answer.point[1] = -answer.point[1]).is_some());
    // A search that passes over boxes too early.
    let near: Vec<_> = points
        .iter()
        .zip(&right)
        .map(|(&point, answer)| {
            let early = ClosestPointOptions { max_distance: answer.distance() * 0.999, ..ANY };
            ask(&tree, &[point], &early)[0]
        })
        .collect();
    assert!(first_fault(&mesh, &points, &ANY, &near).is_some());
}

/// Distances against whole numbers: the error is a few roundings of the greatest difference of coordinates.
#[test]
fn distances_are_those_of_whole_numbers() {
    let mut random = Random::new(5);
    let mut worst = 0.0f64;
    for round in 0..many(4_000) {
        let scale = 2f64.powi(random.below(160) as i32 - 80);
        let reach = |random: &mut Random, size: f64| {
            [(); 3].map(|()| (random.between(-1.0, 1.0) * size * scale) as f32)
        };
        let a = reach(&mut random, 1.0);
        let far = if round % 3 == 0 { 1e3 } else { 1.0 };
        let point = reach(&mut random, far);
        let corners = match round % 5 {
            // Needles with a short edge at the origin, where floats are fine: longer than wide by up to 2^50, any corner first.
            4 => {
                let thin = 2f64.powi(-(random.below(50) as i32));
                let mut all = [1.0, thin, thin].map(|size| reach(&mut random, size));
                all.rotate_left(random.below(3));
                all
            }
            // Needles and slivers, down to no area at all.
            0 => {
                let (b, thin) = (reach(&mut random, 1.0), 2f64.powi(-(random.below(60) as i32)));
                let part = random.unit();
                let off = reach(&mut random, thin);
                let c = [0, 1, 2].map(|i| {
                    let (from, to) = (f64::from(a[i]), f64::from(b[i]));
                    (from + part * (to - from) + f64::from(off[i])) as f32
                });
                [a, b, c]
            }
            // Two corners almost the same.
            1 => [a, a.map(|x| x * 1.000_001), reach(&mut random, 1.0)],
            // Small beside its place.
            2 => [a, [0, 1, 2].map(|i| a[i] * (1.0 + 1e-5 * random.signed())), a.map(f32::next_up)],
            _ => [a, reach(&mut random, 1.0), reach(&mut random, 1.0)],
        };
        // On the triangle as nearly as floats can be, now and then.
        let point = if round % 7 < 2 {
            let weights = random.barycentric();
            [0, 1, 2]
                .map(|i| (0..3).map(|k| weights[k] * f64::from(corners[k][i])).sum::<f64>() as f32)
        } else {
            point
        };
        let corners = prepare(&corners).corners;
        let at = prepare(&[point; 3]).corners[0];
        let exact = rational::distance_squared(&corners, at).sqrt();
        let found = of_triangle(at.map(f64::from), &corners);
        let reach = corners.as_flattened().iter().zip(at.iter().cycle());
        let reach = reach.fold(0.0f64, |most, (x, at)| most.max(f64::from(x - at).abs()));
        let error = (found.distance_squared.sqrt() - exact).abs();
        let units = error / (reach * f64::EPSILON / 2.0).max(f64::MIN_POSITIVE);
        assert!(units <= 16.0, "{units} units: {corners:?} {at:?}");
        worst = worst.max(units);
        let sum = f64::from(found.u) + f64::from(found.v);
        assert!(found.u >= 0.0 && found.v >= 0.0 && sum <= 1.0 + 1e-6, "{found:?}");
    }
    println!("worst error: {worst:.1} units");
}

#[test]
fn what_cannot_be_answered_has_no_answer() {
    let scene = scenes::sphere(6, [0.0; 3], 1.0);
    let mesh = scene.mesh();
    let tree =
        CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
    let odd = [[f32::NAN, 0.0, 0.0], [0.0, f32::INFINITY, 0.0], [0.0, 0.0, f32::NEG_INFINITY]];
    assert!(ask(&tree, &odd, &ANY).iter().all(|answer| *answer == ClosestPoint::NONE));
    // The greatest distance is included, and nothing is within less than 0 or a NaN.
    let corner = scene.positions[0];
    let above = [corner[0], corner[1], corner[2]].map(|x| 3.0 * x);
    let distance = ask(&tree, &[above], &ANY)[0].distance_squared;
    let within = |max_distance: f32| {
        let options = ClosestPointOptions { max_distance, ..ANY };
        (ask(&tree, &[above], &options)[0].is_some(), ask(&tree, &[corner], &options)[0].is_some())
    };
    let rounded = distance.sqrt() as f32;
    assert_eq!(within(rounded.next_up()), (true, true));
    assert_eq!(within(rounded.next_down()), (false, true));
    assert_eq!(within(0.0), (false, true));
    assert_eq!(within(-0.0), (false, true));
    assert_eq!(within(-1.0), (false, false));
    assert_eq!(within(f32::NAN), (false, false));
    let mut short = [ClosestPoint::NONE; 2];
    let refused = tree.closest_points(&[above; 3], &mut short, &ANY);
    assert_eq!(refused, Err(QueryError::LengthMismatch { rays: 3, results: 2 }));
}

#[test]
fn a_watch_can_cancel() {
    let scene = scenes::sphere(20, [0.0; 3], 1.0);
    let tree = CpuBackend::new()
        .build_accelerator(&scene.mesh(), &BuildOptions::default())
        .expect("a tree");
    let points = points(&scene, 20_000, 3);
    let mut closest = vec![ClosestPoint::NONE; points.len()];
    let stop = |progress: &Progress| match progress.done {
        0 => ControlFlow::Continue(()),
        _ => ControlFlow::Break(()),
    };
    let options = ClosestPointOptions { watch: Some(&stop), ..ANY };
    match tree.closest_points(&points, &mut closest, &options) {
        Err(QueryError::Cancelled { done, total: 20_000 }) => assert!(done < 20_000, "{done}"),
        other => panic!("{other:?}"),
    }
    let go_on = |_: &Progress| ControlFlow::Continue(());
    let options = ClosestPointOptions { watch: Some(&go_on), ..ANY };
    tree.closest_points(&points, &mut closest, &options).expect("not cancelled");
    assert_eq!(closest, ask(&tree, &points, &ANY));
}
