//! Inputs on which builders hang, lose triangles or run out of memory: one test each, by name. Each
//! builds, checks the tree against the mesh, and holds hits against the exact oracle; a watchdog
//! turns a hang into a failure (its limit is far beyond what any of them takes).

use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use splitplane::scene::builtin;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::tree::validate::validate_mesh;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::judge::Judge;
use splitplane_test_support::oracle::Oracle;
use splitplane_test_support::scenes::{self, Scene};

/// Far beyond what any scene takes on a slow machine.
const HANG: Duration = Duration::from_secs(600);

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

/// The scenes of the extremes suite, gone through by every preset, instruction set and accuracy.
mod suite {
    use super::*;
    use splitplane_core::backend::Accelerator;
    use splitplane_core::config::Preset;
    use splitplane_core::ray::Accuracy;
    use splitplane_cpu::{CpuAccelerator, InstructionSet};
    use splitplane_test_support::aim::Aim;
    use splitplane_test_support::extremes;
    use splitplane_test_support::judge::Verdict;

    /// Bits, so that -0 differs from 0.
    fn bits(hit: &Hit) -> [u32; 4] {
        [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()]
    }

    fn options(accuracy: Accuracy) -> QueryOptions<'static> {
        QueryOptions { accuracy, ..QueryOptions::default() }
    }

    fn closest(built: &CpuAccelerator, rays: &[Ray], options: &QueryOptions<'_>) -> Vec<Hit> {
        let stale = Hit { t: -7.0, triangle: 0xdead, u: 7.0, v: 7.0 };
        let mut hits = vec![stale; rays.len()];
        built.closest_hits(rays, &mut hits, options).expect("equal lengths");
        hits
    }

    /// The accelerators of one preset on every instruction set, which must have one tree.
    fn build_all(scene: &Scene, preset: Preset) -> Vec<CpuAccelerator> {
        let mesh = scene.mesh();
        let build = BuildOptions::from(preset.config());
        let built: Vec<CpuAccelerator> = InstructionSet::available()
            .into_iter()
            .map(|set| {
                let backend = CpuBackend::with_instruction_set(set);
                backend.build_accelerator(&mesh, &build).expect("a tree")
            })
            .collect();
        let tree = built[0].tree();
        if let Err(violation) = validate_mesh(&tree.view(), &mesh) {
            panic!("{}, {}: {violation}", scene.name, preset.name());
        }
        for other in &built[1..] {
            assert!(other.tree() == tree, "{}, {}", scene.name, preset.name());
        }
        built
    }

    /// One accuracy over one batch: the same bits from every kind of query, on every tree and
    /// instruction set. Returns the hits.
    fn one_answer(
        scene: &Scene,
        all: &[Vec<CpuAccelerator>],
        rays: &[Ray],
        accuracy: Accuracy,
    ) -> Vec<Hit> {
        let name = &scene.name;
        let options = options(accuracy);
        let first = closest(&all[0][0], rays, &options);
        for (set, built) in all.iter().flat_map(|sets| sets.iter().enumerate()) {
            let what = (built.tree().config.preset().name(), built.instruction_set().name());
            let batch = closest(built, rays, &options);
            let mut occluded = vec![false; rays.len()];
            built.any_hits(rays, &mut occluded, &options).expect("equal lengths");
            for (i, ray) in rays.iter().enumerate() {
                // Alone on one instruction set of each preset: they are slow.
                let alone = match set {
                    0 => built.closest_hit(ray, &options).unwrap_or(Hit::MISS),
                    _ => batch[i],
                };
                assert_eq!(
                    bits(&batch[i]),
                    bits(&alone),
                    "{name}, {what:?}, {accuracy:?}: {ray:?}"
                );
                // The fast test may see an edge otherwise where the tree is otherwise.
                if accuracy != Accuracy::Fast {
                    assert_eq!(bits(&alone), bits(&first[i]), "{name}, {what:?}: {ray:?}");
                    assert_eq!(occluded[i], alone.is_hit(), "{name}, {what:?}: {ray:?}");
                    if set == 0 {
                        assert_eq!(built.any_hit(ray, &options), alone.is_hit(), "{name}: {ray:?}");
                    }
                }
            }
        }
        first
    }

    /// Judges watertight hits, and holds exact ones against the oracle. Gives how many rays hit, of how
    /// many the judge had to say that rounding accounts for them, and how many were not judged.
    fn judge(scene: &Scene, oracle: &Oracle, rays: &[Ray], hits: [&[Hit]; 2]) -> [usize; 3] {
        let mesh = scene.mesh();
        let judge = Judge::new(&mesh, oracle);
        let (watertight, exact) = (options(Accuracy::Watertight), options(Accuracy::Exact));
        let (mut met, mut excused, mut beyond) = (0, 0, 0);
        for (i, ray) in rays.iter().enumerate() {
            if is_beyond_floats(oracle, ray) {
                beyond += 1;
            } else {
                match judge.closest(ray, &watertight, hits[0][i].some()) {
                    Err(why) => panic!("{}: {why}", scene.name),
                    Ok(verdict) => excused += usize::from(verdict == Verdict::Rounding),
                }
            }
            let nearest = oracle.nearest(ray, &exact);
            let given = hits[1][i].some().map(|hit| (hit.t, hit.triangle));
            assert_eq!(given, nearest.map(|n| (n.t, n.triangle)), "{}, exact: {ray:?}", scene.name);
            met += usize::from(nearest.is_some());
        }
        [met, excused, beyond]
    }

    /// Whether the ray meets something further away than the greatest float, measured along the
    /// longest component of its direction: the documented end of what watertight distances can say.
    fn is_beyond_floats(oracle: &Oracle, ray: &Ray) -> bool {
        let largest = ray.direction.iter().fold(0.0, |m, x| f64::from(x.abs()).max(m));
        let limit = f64::from(f32::MAX) / largest.log2().floor().exp2();
        let crossings = oracle.crossings_unsorted(ray, &QueryOptions::default());
        largest.is_finite() && crossings.iter().any(|crossing| crossing.t.abs() >= limit)
    }

    /// `SPLITPLANE_LONG=1` casts 20 times as many rays.
    fn effort() -> usize {
        if crate::common::long() { 20 } else { 1 }
    }

    fn go_through(scene: &Scene, each: usize) -> (usize, [usize; 3]) {
        let mesh = scene.mesh();
        let all: Vec<Vec<CpuAccelerator>> =
            Preset::ALL.map(|preset| build_all(scene, preset)).into();
        let oracle = Oracle::new(&mesh);
        let mut rays = extremes::rays(&mesh, each, 91);
        for built in &all {
            let view = built[0].tree().view();
            let mut aim = Aim::new(&mesh, 92);
            rays.extend((0..each).map(|_| aim.in_split_plane(&view)));
        }
        let limited = {
            let hits = closest(&all[0][0], &rays, &options(Accuracy::Watertight));
            let mut limited = extremes::with_limits_at(&rays, &hits);
            // Some of all kinds, not all of one.
            let step = (limited.len() / (8 * each)).max(1);
            limited = limited.into_iter().step_by(step).collect();
            limited
        };
        rays.extend(limited);
        let watertight = one_answer(scene, &all, &rays, Accuracy::Watertight);
        let exact = one_answer(scene, &all, &rays, Accuracy::Exact);
        one_answer(scene, &all, &rays, Accuracy::Fast);
        (rays.len(), judge(scene, &oracle, &rays, [&watertight, &exact]))
    }

    #[test]
    fn every_scene_by_every_way() {
        let (mut rays, mut met, mut out) = (0, 0, 0);
        for scene in extremes::scenes() {
            // Rays that meet thousands of triangles at once take their time.
            let each = if scene.name.contains("identical") { 1 } else { 6 };
            let (cast, [hit, excused, beyond]) = go_through(&scene, each * effort());
            println!(
                "{} | {} | {cast} | {hit} | {excused} | {beyond}",
                scene.name,
                scene.mesh().len()
            );
            rays += cast;
            met += hit;
            out += beyond;
        }
        assert!(out * 50 < rays, "{out} of {rays} are beyond floats");
        assert!(met * 3 > rays, "{met} of {rays}");
    }
}

/// Closed meshes, counted by the program of `benches/stability` too: from inside, no ray is missed
/// however it is aimed, near and far; from outside, none goes through the surface.
mod stability {
    use super::*;
    use splitplane_core::ray::Accuracy;
    use splitplane_test_support::aim::Aim;
    use splitplane_test_support::faulty::LeakyBackend;
    use splitplane_test_support::stability::{Counter, Place, Shots, Side, Subject, Tally, Target};

    fn subjects() -> Vec<Subject> {
        vec![
            Subject::new(scenes::sphere(24, [0.0; 3], 2.0), Some(([0.0; 3], 1.0))),
            Subject::new(scenes::seams(true), Some(([3.3, -1.7, 0.9], 0.5))),
            Subject::new(scenes::grid_boxes(3), Some(([1.5; 3], 1.0))),
        ]
    }

    fn count(backend: &dyn Backend, accuracy: Accuracy, side: Side, rays: usize) -> Vec<Tally> {
        let options = QueryOptions { accuracy, ..QueryOptions::default() };
        let mut tallies = vec![Tally::default(); 2 * Target::ALL.len()];
        let subjects = subjects();
        for (at, place) in [Place::Near, Place::Far].into_iter().enumerate() {
            let share = rays / (subjects.len() * place.moves().len());
            for subject in &subjects {
                for &sizes in place.moves() {
                    let moved = subject.moved(sizes);
                    let mesh = moved.scene.mesh();
                    let built = backend.build(&mesh, &BuildOptions::default()).expect("a tree");
                    let oracle = Oracle::new(&mesh);
                    let counter = Counter::new(&mesh, &oracle, options);
                    let aim = Aim::new(&mesh, 0);
                    for (i, target) in Target::ALL.into_iter().enumerate() {
                        let rays = Shots { target, place, side }.rays(&moved, &aim, share, 96);
                        let mut hits = vec![Hit::MISS; rays.len()];
                        built.closest_hits(&rays, &mut hits, &options).expect("equal lengths");
                        let mut any = vec![false; rays.len()];
                        built.any_hits(&rays, &mut any, &options).expect("equal lengths");
                        tallies[3 * at + i].add(&counter.count(&rays, &hits, Some(&any)));
                    }
                }
            }
        }
        tallies
    }

    #[test]
    fn no_ray_from_inside_is_missed() {
        for tally in count(&CpuBackend::new(), Accuracy::Watertight, Side::Inside, 20_000) {
            assert!(tally.rays > 19_000 && tally.hits * 10 > tally.rays * 9, "{tally:?}");
            assert_eq!((tally.missed, tally.wrong, tally.contradictions), (0, 0, 0), "{tally:?}");
        }
    }

    #[test]
    fn no_ray_from_outside_goes_through() {
        for tally in count(&CpuBackend::new(), Accuracy::Watertight, Side::Outside, 10_000) {
            assert!(tally.rays > 9_000 && tally.hits * 10 > tally.rays * 8, "{tally:?}");
            assert_eq!((tally.holes, tally.wrong, tally.contradictions), (0, 0, 0), "{tally:?}");
        }
    }

    #[test]
    fn exact_answers_are_the_oracles() {
        for side in Side::ALL {
            for tally in count(&CpuBackend::new(), Accuracy::Exact, side, 4_000) {
                assert_eq!((tally.inexact, tally.missed), (0, 0), "{tally:?}");
            }
        }
    }

    /// The textbook test leaks, and the counter sees it.
    #[test]
    fn leaks_are_counted() {
        let tallies = count(&LeakyBackend, Accuracy::Watertight, Side::Inside, 3_000);
        let missed: u64 = tallies.iter().map(|tally| tally.missed).sum();
        let holes: u64 = tallies.iter().map(|tally| tally.holes).sum();
        assert!(missed > 20 && holes > 20, "{missed} {holes}");
    }
}

/// A million triangles at one place: no plane separates anything, and every preset must end.
#[test]
fn identical_1_000_000() {
    use splitplane_core::config::Preset;
    let scene = scenes::identical(1_000_000);
    let mesh = scene.mesh();
    let rays = aim::rays(&mesh, Kind::Faces, 2, 93);
    for preset in Preset::ALL {
        let build = BuildOptions::from(preset.config());
        let built = CpuBackend::new().build(&mesh, &build).expect("a tree");
        validate_mesh(&built.tree().view(), &mesh).expect("a valid tree");
        let cap = build.config.reference_cap(mesh.len() as u32) as usize;
        assert!(built.tree().references.len() <= cap, "{}", preset.name());
        for ray in &rays {
            let hit = built.closest_hit(ray, &QueryOptions::default()).expect("a hit");
            assert_eq!(hit.triangle, 0, "{}: {ray:?}", preset.name());
        }
    }
}
