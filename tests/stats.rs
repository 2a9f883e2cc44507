//! What a tree is expected to cost a random ray, against what rays do.

use proptest::prelude::*;
use proptest::test_runner::{RngSeed, TestRunner};
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::query::lines::{Lines, Measured, Tally, Visits, scene_scale, trace_lines};
use splitplane_core::query::traverse::{Query, trace_observed};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::sah::half_area_of;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::NodeKind;
use splitplane_core::tree::stats::{RayCost, TreeStats};
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};

fn build(scene: &Scene, config: BuildConfig) -> CpuAccelerator {
    let built = CpuBackend::new().build_accelerator(&scene.mesh(), &BuildOptions::from(config));
    built.unwrap_or_else(|error| panic!("{}: {error}", scene.name))
}

fn measure(scene: &Scene, tree: &KdTreeView<'_>, rays: u64) -> Measured {
    let lines = Lines::through(&tree.bounds, 7).expect("bounds with an area");
    let (mesh, options) = (scene.mesh(), QueryOptions::default());
    let scale = scene_scale(tree, &mesh);
    trace_lines(tree, &mesh, &scale, &lines, 0..rays, &options)
}

/// Whether each mean is where it is expected, within five standard errors: one in 1.7 million is
/// farther off by chance.
fn agree(expected: RayCost, tally: &Tally) -> Result<(), String> {
    let (means, errors) = (tally.mean().to_array(), tally.standard_error().to_array());
    for (k, want) in expected.to_array().into_iter().enumerate() {
        let (mean, error) = (means[k], errors[k]);
        if (mean - want).abs() > 5.0 * error + 1e-9 * want {
            let name = RayCost::NAMES[k];
            return Err(format!("{name}: {mean} measured, {want} expected, error {error}"));
        }
    }
    Ok(())
}

/// A soup in a box of any shape, and a configuration that makes a tree of some depth of it.
fn stretched_soup() -> impl Strategy<Value = (Scene, BuildConfig)> {
    let stretch = || proptest::sample::select(vec![0.05f32, 0.3, 1.0, 4.0]);
    let shape = (2usize..600, 0.02..0.6f64, any::<u16>(), [stretch(), stretch(), stretch()]);
    let costs = proptest::sample::select(vec![(1, 4, 16), (3, 2, 1), (1, 10, 1), (1, 2, 4)]);
    let preset = proptest::sample::select(vec![Preset::Fast, Preset::Balanced]);
    (shape, costs, preset, 4u32..=64).prop_map(|(shape, costs, preset, small_node_limit)| {
        let (count, size, seed, stretch) = shape;
        let mut scene = scenes::soup(count, size, u64::from(seed));
        for position in &mut scene.positions {
            for k in 0..3 {
                position[k] *= stretch[k];
            }
        }
        let (traversal_cost, intersection_cost, block_width) = costs;
        let config =
            BuildConfig { traversal_cost, intersection_cost, block_width, ..preset.config() }
                .with_stages(|stages| stages.small_node_limit = small_node_limit);
        (scene, config)
    })
}

fn runner(cases: u32) -> TestRunner {
    TestRunner::new(proptest::test_runner::Config {
        cases,
        rng_seed: RngSeed::Fixed(5),
        failure_persistence: None,
        ..Default::default()
    })
}

#[test]
fn rays_that_pass_cost_what_surface_areas_say() {
    let outcome = runner(40).run(&stretched_soup(), |(scene, config)| {
        let accelerator = build(&scene, config);
        let tree = accelerator.tree().view();
        let measured = measure(&scene, &tree, 20_000);
        prop_assert_eq!(measured.passing.rays, 20_000);
        agree(TreeStats::of(&tree).expected, &measured.passing).map_err(TestCaseError::fail)
    });
    if let Err(error) = outcome {
        panic!("{error}");
    }
}

/// A grid of boxes has flat cells and planes on walls, and a flat scene has flat bounds.
#[test]
fn flat_scenes_and_walls_cost_what_surface_areas_say() {
    let fine = BuildConfig { intersection_cost: 10, block_width: 1, ..BuildConfig::default() };
    for scene in [
        scenes::grid_boxes(4),
        scenes::coplanar(0, 300),
        scenes::coplanar(1, 300),
        scenes::coplanar(2, 300),
        scenes::sphere(12, [0.0; 3], 1.0),
        scenes::needles(300),
    ] {
        let accelerator = build(&scene, fine);
        let tree = accelerator.tree().view();
        let stats = TreeStats::of(&tree);
        assert!(stats.max_depth > 3, "{}: not a tree to measure", scene.name);
        let measured = measure(&scene, &tree, 50_000);
        if let Err(reason) = agree(stats.expected, &measured.passing) {
            panic!("{}: {reason}", scene.name);
        }
    }
}

/// Sums over the nodes of a measure of their cells, over that of the root.
fn expected_by(tree: &KdTreeView<'_>, measure: impl Fn(&Aabb) -> f64) -> RayCost {
    let mut sums = RayCost::default();
    tree.walk(|_, kind, cell, _| match kind {
        NodeKind::Interior { .. } => sums.interior += measure(cell),
        NodeKind::Leaf { count, .. } => {
            let part = measure(cell);
            sums.leaves += part;
            sums.empty_leaves += if count == 0 { part } else { 0.0 };
            sums.tests += part * f64::from(count);
            sums.blocks += part * f64::from(count.div_ceil(tree.config.block_width));
        }
    });
    let root = measure(&tree.bounds);
    RayCost::from_array(sums.to_array().map(|sum| sum / root))
}

fn extents(cell: &Aabb) -> [f64; 3] {
    [0, 1, 2].map(|k| f64::from(cell.hi[k]) - f64::from(cell.lo[k]))
}

/// The check above sees areas that are wrong, and lines that are not uniform.
#[test]
fn wrong_areas_and_lines_that_are_not_uniform_are_seen() {
    let fine = BuildConfig { intersection_cost: 10, block_width: 1, ..BuildConfig::default() };
    let scene = scenes::soup(400, 0.2, 3);
    let accelerator = build(&scene, fine);
    let tree = accelerator.tree().view();
    let passing = measure(&scene, &tree, 20_000).passing;
    assert_eq!(agree(expected_by(&tree, half_area_of), &passing), Ok(()));

    let wrong: [fn(&Aabb) -> f64; 3] = [
        // One of the three products left out.
        |cell| {
            let [x, y, z] = extents(cell);
            x * (y + z)
        },
        |cell| extents(cell).iter().product(),
        |cell| extents(cell).iter().sum(),
    ];
    for (which, area) in wrong.into_iter().enumerate() {
        assert!(agree(expected_by(&tree, area), &passing).is_err(), "area {which} goes unnoticed");
    }

    // From the same points, in directions uniform over the half of space that points inward; and
    // between two points of the surface.
    let lines = Lines::through(&tree.bounds, 7).expect("bounds with an area");
    let scale = scene_scale(&tree, &scene.mesh());
    let mut random = Random::new(1);
    let [mut hemisphere, mut between] = [Tally::default(); 2];
    for number in 0..20_000 {
        let ray = lines.line(number);
        let axis = (0..3)
            .find(|&k| {
                let (at, bounds) = (ray.origin[k], tree.bounds);
                (at == bounds.lo[k] && ray.direction[k] >= 0.0)
                    || (at == bounds.hi[k] && ray.direction[k] <= 0.0)
            })
            .expect("a line starts on a face");
        let mut direction = random.direction().map(|d| d as f32);
        direction[axis] = direction[axis].abs().copysign(ray.direction[axis]);
        let other = lines.line(20_000 + number).origin;
        for (tally, ray) in [
            (&mut hemisphere, Ray::new(ray.origin, direction)),
            (&mut between, Ray::new(ray.origin, [0, 1, 2].map(|k| other[k] - ray.origin[k]))),
        ] {
            let mut visits = Visits::new(tree.config.block_width, true);
            let (mesh, options) = (scene.mesh(), QueryOptions::default());
            let query = Query::Closest;
            trace_observed::<Strict, _>(&tree, &mesh, &scale, &ray, &options, query, &mut visits);
            tally.add(&visits, false);
        }
    }
    let expected = TreeStats::of(&tree).expected;
    assert!(agree(expected, &hemisphere).is_err(), "lines of another measure go unnoticed");
    assert!(agree(expected, &between).is_err(), "chords of the box go unnoticed");
}

/// Whether a ray meets a cell that is so much wider on every side; in a way that shares nothing with
/// the traversal.
fn meets(ray: &Ray, cell: &Aabb, wider: f64) -> bool {
    let (mut enter, mut exit) = (0.0f64, f64::INFINITY);
    for k in 0..3 {
        let (origin, direction) = (f64::from(ray.origin[k]), f64::from(ray.direction[k]));
        let (lo, hi) = (f64::from(cell.lo[k]) - wider, f64::from(cell.hi[k]) + wider);
        if direction == 0.0 {
            if origin < lo || origin > hi {
                return false;
            }
            continue;
        }
        let (a, b) = ((lo - origin) / direction, (hi - origin) / direction);
        enter = enter.max(a.min(b));
        exit = exit.min(a.max(b));
    }
    enter <= exit
}

#[test]
fn a_passing_ray_visits_the_cells_that_it_meets() {
    let outcome = runner(16).run(&stretched_soup(), |(scene, config)| {
        let accelerator = build(&scene, config);
        let tree = accelerator.tree().view();
        let (mesh, options) = (scene.mesh(), QueryOptions::default());
        let scale = scene_scale(&tree, &mesh);
        let mut cells = Vec::new();
        tree.walk(|_, kind, cell, _| cells.push((kind, *cell)));
        let lines = Lines::through(&tree.bounds, 8).expect("bounds with an area");
        for ray in (0..300).map(|number| lines.line(number)) {
            let mut visits = Visits::new(config.block_width, true);
            let query = Query::Closest;
            trace_observed::<Strict, _>(&tree, &mesh, &scale, &ray, &options, query, &mut visits);
            let count = |wider: f64| {
                let met = cells.iter().filter(|(_, cell)| meets(&ray, cell, wider));
                let mut counts = [0u32; 5];
                for (kind, _) in met {
                    counts[0] += 1;
                    if let NodeKind::Leaf { count, .. } = kind {
                        counts[1] += 1;
                        counts[2] += u32::from(*count == 0);
                        counts[3] += count;
                        counts[4] += count.div_ceil(config.block_width);
                    }
                }
                counts
            };
            // A cell may be narrower than the shrinking: then only the wide count says something.
            let (least, most) = (count(-1e-5), count(1e-5));
            let Visits { nodes, leaves, empty_leaves, tests, blocks, .. } = visits;
            for (k, found) in [nodes, leaves, empty_leaves, tests, blocks].into_iter().enumerate() {
                let range = least[k]..=most[k];
                prop_assert!(range.contains(&found), "{k}: {found} not in {range:?}, {ray:?}");
            }
        }
        Ok(())
    });
    if let Err(error) = outcome {
        panic!("{error}");
    }
}

#[test]
fn tallies_do_not_depend_on_how_lines_are_shared_and_hits_are_those_of_the_backend() {
    let scene = scenes::soup(500, 0.1, 9);
    let accelerator = build(&scene, BuildConfig::default());
    let tree = accelerator.tree().view();
    let whole = measure(&scene, &tree, 3_000);
    let lines = Lines::through(&tree.bounds, 7).expect("bounds with an area");
    let (mesh, options) = (scene.mesh(), QueryOptions::default());
    let scale = scene_scale(&tree, &mesh);
    let part = |from, to| trace_lines(&tree, &mesh, &scale, &lines, from..to, &options);
    assert_eq!(part(1_000, 3_000).union(part(0, 1)).union(part(1, 1_000)), whole);

    let rays: Vec<Ray> = (0..3_000).map(|number| lines.line(number)).collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    accelerator.closest_hits(&rays, &mut hits, &options).expect("equal lengths");
    assert_eq!(whole.closest.hits, hits.iter().filter(|hit| hit.is_hit()).count() as u64);
    assert!(whole.closest.hits > 500 && whole.passing.hits == 0);
    let [closest, passing] = [whole.closest, whole.passing].map(|tally| tally.mean().to_array());
    assert!(closest.iter().zip(passing).all(|(a, b)| *a < b), "{closest:?} {passing:?}");
}
