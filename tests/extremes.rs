//! Inputs on which builders hang, lose triangles or run out of memory: one test each, by name. Each
//! builds, checks the tree against the mesh, and holds hits against the exact oracle; a watchdog
//! turns a hang into a failure (its limit is far beyond what any of them takes).

use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use splitplane::scene::builtin;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::validate::validate_mesh;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::judge::Judge;
use splitplane_test_support::oracle::Oracle;
use splitplane_test_support::scenes::{self, Scene};

/// Far beyond what any scene takes on a slow machine.
const HANG: Duration = Duration::from_secs(180);

fn check(scene: Scene, rays_each: usize) {
    let name = scene.name.clone();
    let (done, finished) = mpsc::channel();
    let worker = thread::spawn(move || {
        examine(&scene, rays_each);
        // The receiver is gone only if the test has failed already.
        let _ = done.send(());
    });
    match finished.recv_timeout(HANG) {
        Err(mpsc::RecvTimeoutError::Timeout) => panic!("{name}: does not end"),
        _ => worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)),
    }
}

fn examine(scene: &Scene, rays_each: usize) {
    let mesh = scene.mesh();
    let built = CpuBackend::new().build(&mesh, &BuildOptions::default()).expect("a tree");
    validate_mesh(&built.tree().view(), &mesh).expect("a valid tree");
    let cap = BuildOptions::default().config.reference_cap(mesh.len() as u32) as usize;
    // The cap binds large nodes; small roots may add their constant beyond it.
    assert!(built.tree().references.len() <= 16 * cap, "{}", built.tree().references.len());
    let summary = built.summary();
    assert_eq!(summary.triangles as usize, mesh.len());
    if summary.dropped == summary.triangles {
        let ray = Ray::new([0.3; 3], [1.0, 0.1, 0.2]);
        assert_eq!(built.closest_hit(&ray, &QueryOptions::default()), None);
        return;
    }
    let oracle = Oracle::new(&mesh);
    let judge = Judge::new(&mesh, &oracle);
    let options = QueryOptions::default();
    for kind in Kind::ALL {
        let rays = aim::rays(&mesh, kind, rays_each, 77);
        let mut hits = vec![Hit::MISS; rays.len()];
        built.closest_hits(&rays, &mut hits, &options).expect("equal lengths");
        for (ray, hit) in rays.iter().zip(&hits) {
            if let Err(why) = judge.closest(ray, &options, hit.some()) {
                panic!("{}, {kind:?}: {why}\n{ray:?}\n{hit:?}", scene.name);
            }
        }
    }
}

macro_rules! extremes {
    ($($name:ident: $scene:expr, $rays:expr;)*) => {
        $(#[test] fn $name() { check($scene, $rays); })*
    };
}

extremes! {
    no_triangle: scenes::none(), 10;
    one_triangle: scenes::one(), 100;
    triangles_64: scenes::soup(64, 0.1, 64), 100;
    triangles_65: scenes::soup(65, 0.1, 65), 100;
    triangles_255: scenes::soup(255, 0.1, 255), 100;
    triangles_256: scenes::soup(256, 0.1, 256), 100;
    triangles_257: scenes::soup(257, 0.1, 257), 100;
    identical_20_000: scenes::identical(20_000), 5;
    fan_of_20_000: scenes::fan(20_000), 20;
    needles_5_000: scenes::needles(5_000), 50;
    coplanar_on_x: scenes::coplanar(0, 500), 50;
    coplanar_on_y: scenes::coplanar(1, 500), 50;
    coplanar_on_z: scenes::coplanar(2, 500), 50;
    coplanar_oblique: scenes::coplanar_oblique(500), 50;
    grid_aligned_boxes: scenes::grid_boxes(6), 50;
    near_1e7: scenes::sphere(20, [1e7, -1e7, 1e7], 1000.0), 50;
    at_1e_minus_30: scenes::scaled(&scenes::soup(600, 0.3, 31), 1e-30, "soup at 1e-30"), 50;
    at_1e30: scenes::scaled(&scenes::soup(600, 0.3, 32), 1e30, "soup at 1e30"), 50;
    size_ratio_1e6: scenes::ratio(), 50;
    t_junctions_along_axes: scenes::seams(false), 100;
    t_junctions_oblique: scenes::seams(true), 100;
    collinear_triangles: scenes::collinear(), 50;
    equal_corners: scenes::equal_corners(), 50;
    nan_and_infinite_vertices: scenes::bad_vertices(), 50;
    nothing_but_bad_vertices: scenes::all_bad(), 10;
    staircase: scenes::stairs(20), 50;
    zeros_and_subnormals: scenes::zeros_and_subnormals(), 50;
}

/// A built-in scene, as the checks take it.
fn built_in(name: &str) -> Scene {
    let scene = builtin::open(name).expect("a built-in scene");
    Scene {
        name: name.into(),
        positions: scene.positions.clone(),
        indices: Some(scene.indices.clone()),
    }
}

extremes! {
    built_in_cornell: built_in("cornell"), 200;
    built_in_spheres: built_in("spheres"), 200;
    built_in_stadium: built_in("stadium"), 200;
    built_in_city: built_in("city:2000"), 200;
}
