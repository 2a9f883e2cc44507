//! Whatever floating-point state a thread comes with, trees and answers are those of the default
//! state, and the thread has its own state again afterwards: the calling thread, and the threads of
//! a pool that the caller made.

#![cfg(all(target_arch = "x86_64", not(miri)))]

use core::arch::asm;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};

use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::mesh::Mesh;
use splitplane_core::points::build::PointOptions;
use splitplane_core::points::nearest::{NearestOptions, Neighbour};
use splitplane_core::query::all_hits::AllHitsOptions;
use splitplane_core::query::cast::{Cast, CastOptions, Impact};
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
use splitplane_core::query::inside::LocateOptions;
use splitplane_core::query::overlap::{OverlapOptions, Plane, Volume};
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::scene::{Instance, Scene, SceneHit, SceneOptions};
use splitplane_core::watch::Progress;
use splitplane_cpu::{CpuBackend, CpuPointTree, InstructionSet};
use splitplane_test_support::random::Random;

fn read() -> u32 {
    let mut word = 0u32;
    // SAFETY: stores MXCSR to a variable of this function.
    unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut word, options(nostack)) };
    word
}

fn write(word: u32) {
    // SAFETY: loads MXCSR with a word without reserved bits.
    unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const word, options(nostack)) };
}

const DEFAULT: u32 = 0x1f80;
/// Exception flags, which any operation may raise.
const FLAGS: u32 = 0x3f;

/// Rounding modes, flush to zero, denormals are zero; and one with exceptions that are not masked
/// (division by zero, invalid).
fn states() -> Vec<u32> {
    let bits = |round: u32, flush: u32, zero: u32| DEFAULT | round << 13 | flush << 15 | zero << 6;
    let mut all: Vec<u32> = (0..16).map(|i| bits(i & 3, i >> 2 & 1, i >> 3 & 1)).collect();
    all.push(0x1f80 & !(0b101 << 7));
    all
}

/// Does work in a state; fails if it is another afterwards.
#[inline(never)]
fn within<R>(state: u32, work: &dyn Fn() -> R) -> R {
    write(state);
    let done = catch_unwind(AssertUnwindSafe(work));
    let after = read();
    write(DEFAULT);
    assert_eq!(after & !FLAGS, state, "{state:#x} became {after:#x}");
    done.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

struct Given {
    vertices: Vec<[f32; 3]>,
    indices: Vec<[u32; 3]>,
    rays: Vec<Ray>,
    points: Vec<[f32; 3]>,
    transforms: Vec<[[f32; 4]; 3]>,
}

fn given() -> Given {
    let mut random = Random::new(3);
    let mut vertices = Vec::new();
    for _ in 0..700 {
        let at = random.point(1.0);
        for _ in 0..3 {
            let off = random.point(0.1);
            vertices.push([0, 1, 2].map(|axis| at[axis] + off[axis]));
        }
    }
    // Some of which only subnormals tell apart.
    for i in 0..30u32 {
        vertices.push([f32::from_bits(1 + i * 77_777), 0.5, f32::from_bits(0x0080_0000 + i)]);
    }
    let indices = (0..vertices.len() as u32 / 3).map(|i| [0, 1, 2].map(|k| 3 * i + k)).collect();
    let mut rays = Vec::new();
    for _ in 0..4200 {
        rays.push(Ray::new(random.point(2.0), random.point(1.0)));
    }
    let points = (0..2100).map(|_| random.point(1.3)).collect();
    let transform = |i: u32| {
        let x = i as f32 * 0.7;
        [[0.8, 0.6, 0.0, x], [-0.6, 0.8, 0.0, 0.1], [0.0, 0.0, 1.1, x / 3.0]]
    };
    Given { vertices, indices, rays, points, transforms: (0..5).map(transform).collect() }
}

fn bits(values: impl IntoIterator<Item = f32>) -> Vec<u32> {
    values.into_iter().map(f32::to_bits).collect()
}

fn of_hits(hits: &[Hit]) -> Vec<u32> {
    hits.iter()
        .flat_map(|hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.triangle])
        .collect()
}

/// What a case gives, by name.
type Results = Vec<(String, Vec<u32>)>;

fn all_results(given: &Given, set: InstructionSet) -> Results {
    let mut all = Results::new();
    let mesh = Mesh::indexed(&given.vertices, &given.indices).unwrap();
    let backend = CpuBackend::with_instruction_set(set);
    for preset in [Preset::Fast, Preset::Balanced, Preset::Best] {
        let options = BuildOptions::from(preset);
        let accelerator = backend.build_accelerator(&mesh, &options).unwrap();
        let digest = accelerator.tree().digest().0;
        all.push((format!("{preset:?}"), vec![digest as u32, (digest >> 32) as u32]));
        if preset != Preset::Fast {
            continue;
        }
        for accuracy in [Accuracy::Watertight, Accuracy::Exact, Accuracy::Fast] {
            let options = QueryOptions { accuracy, ..QueryOptions::default() };
            let mut hits = vec![Hit::MISS; given.rays.len()];
            accelerator.closest_hits(&given.rays, &mut hits, &options).unwrap();
            all.push((format!("closest {accuracy:?}"), of_hits(&hits)));
            let mut occluded = vec![false; given.rays.len()];
            accelerator.any_hits(&given.rays, &mut occluded, &options).unwrap();
            all.push((
                format!("any {accuracy:?}"),
                occluded.iter().map(|&x| u32::from(x)).collect(),
            ));
            let single: Vec<Hit> = given.rays[..200]
                .iter()
                .map(|ray| accelerator.closest_hit(ray, &options).unwrap_or(Hit::MISS))
                .collect();
            all.push((format!("single {accuracy:?}"), of_hits(&single)));
        }
        let found = accelerator.all_hits(&given.rays[..600], &AllHitsOptions::default()).unwrap();
        all.push(("all hits".into(), bits(found.crossings.iter().map(|crossing| crossing.hit.t))));
        let located = accelerator.locate(&given.points[..200], &LocateOptions::default()).unwrap();
        all.push((
            "locate".into(),
            located.windings.iter().map(|w| w.map_or(u32::MAX, i32::cast_unsigned)).collect(),
        ));
        let mut closest = vec![ClosestPoint::NONE; given.points.len()];
        let options = ClosestPointOptions::default();
        accelerator.closest_points(&given.points, &mut closest, &options).unwrap();
        all.push(("closest points".into(), bits(closest.iter().flat_map(|c| c.point))));
        let casts: Vec<Cast> = given.rays[..150].iter().map(|&ray| Cast::ball(ray, 0.01)).collect();
        let mut impacts = vec![Impact::NONE; casts.len()];
        accelerator.impacts(&casts, &mut impacts, &CastOptions::default()).unwrap();
        all.push((
            "impacts".into(),
            impacts.iter().flat_map(|i| [i.t.to_bits(), i.triangle]).collect(),
        ));
        let planes = [
            Plane { normal: [1.0, 0.3, 0.1], offset: 0.2 },
            Plane { normal: [-1.0, 0.2, 0.7], offset: 0.3 },
        ];
        let mut volumes = vec![Volume::Planes(&planes)];
        volumes
            .extend(given.points[..100].iter().map(|&centre| Volume::Ball { centre, radius: 0.1 }));
        let found = accelerator.overlaps(&volumes, &OverlapOptions::default()).unwrap();
        all.push(("overlaps".into(), found.triangles));
    }
    let mut scene = Scene::new();
    let geometry = scene.add_mesh(&mesh).unwrap();
    for &transform in &given.transforms {
        scene.add_instance(Instance::new(geometry, transform)).unwrap();
    }
    let built = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
    let mut hits = vec![SceneHit::MISS; given.rays.len()];
    built.closest_hits(&given.rays, &mut hits, &SceneOptions::default()).unwrap();
    all.push((
        "scene".into(),
        hits.iter().flat_map(|h| [h.t.to_bits(), h.u.to_bits(), h.instance, h.triangle]).collect(),
    ));
    let single = given.rays[..300].iter().map(|ray| {
        built.closest_hit(ray, &SceneOptions::default()).map_or(0, |hit| hit.t.to_bits())
    });
    all.push(("scene, single".into(), single.collect()));

    let tree = CpuPointTree::build(&given.points, &PointOptions::default()).unwrap();
    let digest = tree.tree().digest().0;
    all.push(("point tree".into(), vec![digest as u32, (digest >> 32) as u32]));
    for k in [1, 5, 30] {
        let mut found = vec![Neighbour::NONE; k * given.rays.len()];
        let options = NearestOptions { k, ..NearestOptions::default() };
        let queries: Vec<[f32; 3]> = given.rays.iter().map(|ray| ray.origin).collect();
        tree.nearest(&queries, &mut found, &options).unwrap();
        all.push((
            format!("{k} nearest"),
            found
                .iter()
                .flat_map(|n| {
                    let d = n.distance_squared.to_bits();
                    [d as u32, (d >> 32) as u32, n.point]
                })
                .collect(),
        ));
    }
    let options = NearestOptions { max_distance: 0.1, ..NearestOptions::default() };
    let lists = tree.within_each(&given.points[..400], &options).unwrap();
    all.push(("within".into(), lists.found.iter().map(|n| n.point).collect()));
    all
}

fn hold(expected: &Results, found: &Results, state: u32) {
    for ((name, expected), (_, found)) in expected.iter().zip(found) {
        let differ = expected.iter().zip(found).filter(|(a, b)| a != b).count();
        assert!(
            expected == found,
            "in state {state:#x}: {name}: {differ} of {} words differ",
            expected.len()
        );
    }
}

#[test]
fn answers_do_not_depend_on_the_state_of_the_calling_thread() {
    let given = given();
    for set in InstructionSet::available() {
        let expected = all_results(&given, set);
        // All states with the vectors that calls use, one of each kind with the others.
        let states = states();
        let step = if set == InstructionSet::detect() { 1 } else { 7 };
        for &state in states.iter().skip(1).step_by(step) {
            let found = within(state, &|| all_results(&given, set));
            hold(&expected, &found, state);
        }
    }
}

#[test]
fn answers_do_not_depend_on_the_state_of_a_pool() {
    let given = given();
    let set = InstructionSet::detect();
    let expected = all_results(&given, set);
    for state in states().into_iter().skip(1).step_by(3) {
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(3).start_handler(move |_| write(state));
        let pool = pool.build().unwrap();
        let found = pool.install(|| all_results(&given, set));
        hold(&expected, &found, state);
        let after = pool.broadcast(|_| {
            let after = read();
            write(DEFAULT);
            after & !FLAGS
        });
        assert_eq!(after, [state; 3]);
    }
}

#[test]
fn the_state_comes_back_after_errors_and_panics() {
    let given = given();
    let mesh = Mesh::indexed(&given.vertices, &given.indices).unwrap();
    let backend = CpuBackend::new();
    let ends = |_: &Progress| ControlFlow::Break(());
    let panics = |_: &Progress| -> ControlFlow<()> { panic!("by the watch") };
    for state in states() {
        let options = BuildOptions { watch: Some(&ends), ..BuildOptions::default() };
        assert!(within(state, &|| backend.build(&mesh, &options).is_err()));
        let options = BuildOptions { watch: Some(&panics), ..BuildOptions::default() };
        within(state, &|| {
            let ended = catch_unwind(AssertUnwindSafe(|| backend.build(&mesh, &options).is_err()));
            assert!(ended.is_err());
            assert_eq!(read() & !FLAGS, state);
        });
        let accelerator = backend.build(&mesh, &BuildOptions::default()).unwrap();
        let options = QueryOptions { watch: Some(&panics), ..QueryOptions::default() };
        within(state, &|| {
            let mut hits = vec![Hit::MISS; given.rays.len()];
            let traced = || accelerator.closest_hits(&given.rays, &mut hits, &options).is_err();
            assert!(catch_unwind(AssertUnwindSafe(traced)).is_err());
            assert_eq!(read() & !FLAGS, state);
        });
        let tree = CpuPointTree::build(&given.points, &PointOptions::default()).unwrap();
        let filter = |_: u32| -> bool { panic!("by the filter") };
        let options = NearestOptions { filter: Some(&filter), ..NearestOptions::default() };
        within(state, &|| {
            let nearest =
                || tree.nearest(&given.points, &mut [Neighbour::NONE; 2100], &options).is_err();
            assert!(catch_unwind(AssertUnwindSafe(nearest)).is_err());
            assert_eq!(read() & !FLAGS, state);
        });
    }
}
