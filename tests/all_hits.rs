//! All hits against whole-number brute force: every surface crossing once, in order, rays through
//! edges, vertices and planes included.

use crate::common::{cube, tetrahedron};
use splitplane::{
    Accelerator, AllHits, AllHitsOptions, Backend, BuildOptions, CpuBackend, Culling, Mesh, Preset,
    QueryOptions, Ray,
};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::oracle::Oracle;
use splitplane_test_support::random::Random;
use splitplane_test_support::rational::{self, Shift};
use splitplane_test_support::scenes::{self, Scene};

fn accelerators(mesh: &Mesh<'_>) -> Vec<Box<dyn Accelerator>> {
    let presets = [Preset::Fast, Preset::Balanced, Preset::Best];
    let options = presets.map(|preset| BuildOptions::from(preset.config()));
    options.iter().map(|options| CpuBackend::new().build(mesh, options).unwrap()).collect()
}

/// Closed surfaces, each edge passed once either way.
fn closed() -> Vec<Scene> {
    let one = cube([-1.0; 3], [1.0; 3]);
    let beside = cube([1.0, -1.0, -1.0], [3.0, 1.0, 1.0]);
    vec![
        tetrahedron(),
        one.joined(&beside, "cubes that share a face"),
        one.joined(&cube([-0.5; 3], [0.5; 3]), "nested cubes"),
        one.joined(&cube([1.0; 3], [2.0; 3]), "cubes that share a corner"),
        one.joined(&one, "the same cube twice"),
        scenes::sphere(6, [0.0; 3], 1.0),
        scenes::sphere(5, [1e5, -2e5, 3e5], 1.0),
        scenes::scaled(&cube([-1.0; 3], [1.0; 3]), 1e-37, "tiny cube"),
        scenes::scaled(&tetrahedron(), 1e37, "huge tetrahedron"),
        one,
    ]
}

/// Rays of every aim, and some between whole and half points of the bounds, which run along edges and in
/// the planes of faces.
fn rays(scene: &Scene, count: usize, seed: u64) -> Vec<Ray> {
    let mesh = scene.mesh();
    let mut rays: Vec<Ray> =
        Kind::ALL.iter().flat_map(|&kind| aim::rays(&mesh, kind, count, seed)).collect();
    let mut random = Random::new(seed);
    let (mut lo, mut hi) = ([f32::MAX; 3], [-f32::MAX; 3]);
    for position in &scene.positions {
        for axis in 0..3 {
            lo[axis] = lo[axis].min(position[axis]);
            hi[axis] = hi[axis].max(position[axis]);
        }
    }
    for _ in 0..4 * count {
        let mut point = || -> [f32; 3] {
            // Quarters of the box, from outside to outside.
            [0, 1, 2].map(|axis| {
                let part = (random.below(9) as f32 - 2.0) * 0.25;
                lo[axis] + (hi[axis] - lo[axis]) * part
            })
        };
        let (from, to) = (point(), point());
        let direction = [0, 1, 2].map(|axis| to[axis] - from[axis]);
        if direction != [0.0; 3] {
            let limit = [f32::INFINITY, 1.0, 0.5, f32::MAX][random.below(4)];
            let least = [0.0, f32::NEG_INFINITY, 0.25, -1.0][random.below(4)];
            rays.push(Ray::new(from, direction).with_limits(least, limit));
        }
    }
    rays
}

fn bits(all: &AllHits, ray: usize) -> Vec<(u32, u32, bool)> {
    all.of(ray).iter().map(|met| (met.hit.t.to_bits(), met.hit.triangle, met.front)).collect()
}

#[test]
fn every_crossing_is_that_of_whole_numbers() {
    let (mut crossings, mut grazing) = (0, 0);
    let mut meshes = closed();
    meshes.push(scenes::soup(60, 0.5, 3));
    meshes.push(scenes::coplanar(1, 30));
    meshes.push(scenes::identical(20));
    meshes.push(scenes::needle_star());
    meshes.push(scenes::collinear());
    for (number, scene) in meshes.iter().enumerate() {
        let mesh = scene.mesh();
        let rays = rays(scene, 6, number as u64);
        for culling in [Culling::None, Culling::Back, Culling::Front] {
            let ignore = (number % 3 == 0).then_some(number as u32 % 4);
            let options = AllHitsOptions { culling, ignore, ..Default::default() };
            let query = options.query();
            let mut first = None;
            for accelerator in accelerators(&mesh) {
                let all = accelerator.all_hits(&rays, &options).unwrap();
                assert_eq!((all.rays(), all.report.answered_by_cpu), (rays.len(), 0));
                let found: Vec<_> = (0..rays.len()).map(|ray| bits(&all, ray)).collect();
                if let Some(first) = &first {
                    assert_eq!(first, &found, "{}", scene.name);
                    continue;
                }
                for (ray, found) in rays.iter().zip(&found) {
                    let by_hand: Vec<(u32, u32, bool)> =
                        rational::surface_crossings(&mesh, ray, &query, Shift::TINY)
                            .iter()
                            .filter(|met| rational::is_within(&met.t, ray))
                            .map(|met| (met.t.rounded().to_bits(), met.triangle, met.front))
                            .collect();
                    assert_eq!(found, &by_hand, "{} {ray:?} {options:?}", scene.name);
                    crossings += found.len();
                    let touched = rational::crossings(&mesh, ray, &query);
                    let touched =
                        touched.iter().filter(|met| rational::is_within(&met.t, ray)).count();
                    grazing += usize::from(touched > found.len());
                }
                first = Some(found);
            }
        }
    }
    assert!(crossings > 2_500 && grazing > 100, "{crossings} {grazing}");
}

#[test]
fn closed_surfaces_are_entered_and_left_in_turn() {
    let mut several = 0;
    for (number, scene) in closed().iter().enumerate() {
        let mesh = scene.mesh();
        let oracle = Oracle::new(&mesh);
        let accelerator = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
        // Whole lines.
        let lines: Vec<Ray> = rays(scene, 100, 70 + number as u64)
            .iter()
            .map(|ray| ray.with_limits(f32::NEG_INFINITY, f32::INFINITY))
            .collect();
        let all = accelerator.all_hits(&lines, &AllHitsOptions::default()).unwrap();
        for (ray, line) in lines.iter().enumerate() {
            let found = all.of(ray);
            assert!(found.len() <= oracle.crossings(line, &QueryOptions::default()).len() * 2);
            let mut within = 0i32;
            let mut i = 0;
            while i < found.len() {
                // What lies at one distance is passed at once.
                let t = found[i].hit.t;
                while i < found.len() && found[i].hit.t == t {
                    within += if found[i].front { 1 } else { -1 };
                    i += 1;
                }
                assert!(within >= 0, "{} {line:?}: left before it was entered", scene.name);
            }
            assert_eq!(within, 0, "{} {line:?}", scene.name);
            several += usize::from(found.len() > 2);
            let mut triangles: Vec<u32> = found.iter().map(|met| met.hit.triangle).collect();
            triangles.sort_unstable();
            triangles.dedup();
            assert_eq!(triangles.len(), found.len(), "{line:?}: a triangle twice");
            assert!(found.windows(2).all(|pair| pair[0].hit.t <= pair[1].hit.t));
        }
    }
    assert!(several > 250, "{several}");
}

#[test]
fn limits_are_closed() {
    let scene = cube([-1.0; 3], [1.0; 3]);
    let mesh = scene.mesh();
    let accelerator = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let ray = Ray::new([0.25, 0.5, -3.0], [0.0, 0.0, 1.0]);
    let count = |t_min: f32, t_max: f32| {
        let ray = ray.with_limits(t_min, t_max);
        accelerator.all_hits(&[ray], &AllHitsOptions::default()).unwrap().of(0).len()
    };
    assert_eq!(count(0.0, f32::INFINITY), 2);
    assert_eq!(count(2.0, 4.0), 2);
    assert_eq!(count(2.0f32.next_up(), 4.0), 1);
    assert_eq!(count(2.0, 4.0f32.next_down()), 1);
    assert_eq!(count(2.0, 2.0), 1);
    assert_eq!(count(3.0, 2.0), 0);
    assert_eq!(count(f32::NAN, 9.0), 0);
    // Rays that hit nothing: a direction of zeros, coordinates that are no numbers.
    let odd = [
        Ray::new([0.0; 3], [0.0; 3]),
        Ray::new([f32::NAN, 0.0, 0.0], [1.0; 3]),
        Ray::new([0.0; 3], [f32::INFINITY, 0.0, 0.0]),
    ];
    let all = accelerator.all_hits(&odd, &AllHitsOptions::default()).unwrap();
    assert_eq!((all.rays(), all.crossings.len()), (3, 0));
    assert_eq!(accelerator.all_hits(&[], &AllHitsOptions::default()).unwrap(), AllHits::none());
}
