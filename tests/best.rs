//! Preset `best`: the tree is the one that a builder finds which counts both sides of every plane;
//! clipped bounds hold what they must; costs fall where they must.

use crate::common::{all_scenes, long};
use proptest::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::snap;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::tree::KdTree;
use splitplane_core::tree::dump::dump;
use splitplane_core::tree::stats::TreeStats;
use splitplane_core::tree::validate::validate_mesh;
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_cpu::testing::clip;
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::greedy;
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use std::fmt::Write;

fn best() -> BuildConfig {
    Preset::Best.config()
}

/// The costs of Wald and Havran, 15 and 20, in lowest terms.
fn classic() -> BuildConfig {
    BuildConfig { traversal_cost: 3, intersection_cost: 4, block_width: 1, ..best() }
}

/// Configurations that reach every rule.
fn configs() -> Vec<BuildConfig> {
    let plain = classic().with_sweep(|sweep| {
        sweep.empty_bonus = 0;
        sweep.bad_splits = 0;
    });
    vec![
        best(),
        BuildConfig { clip: false, ..best() },
        best().with_sweep(|sweep| {
            sweep.empty_bonus = 0;
            sweep.bad_splits = 0;
        }),
        best().with_sweep(|sweep| sweep.bad_splits = 3),
        BuildConfig { intersection_cost: 4, block_width: 16, ..best() }
            .with_sweep(|sweep| sweep.bad_splits = 1),
        classic(),
        plain,
        BuildConfig { clip: false, ..plain },
        plain.with_sweep(|sweep| sweep.empty_bonus = 51),
        plain.with_sweep(|sweep| sweep.bad_splits = 3),
        BuildConfig { block_width: 3, ..plain }.with_sweep(|sweep| sweep.bad_splits = 8),
        BuildConfig { max_depth: 5, clip: false, ..plain }.with_sweep(|sweep| {
            sweep.bad_splits = 3;
            sweep.empty_bonus = 255;
        }),
        BuildConfig { max_depth: 1, ..plain },
        BuildConfig { traversal_cost: 1, intersection_cost: 40, block_width: 4, ..best() },
    ]
}

fn build(mesh: &Mesh<'_>, config: BuildConfig) -> KdTree {
    CpuBackend::new().build_tree(mesh, &config.into()).expect("no limit binds").0
}

fn every_plane(mesh: &Mesh<'_>, config: BuildConfig) -> KdTree {
    greedy::every_plane(mesh, &config, config.clip.then_some(&clip))
}

/// Where two trees first differ.
fn difference(one: &KdTree, other: &KdTree) -> String {
    let node = one.nodes.iter().zip(&other.nodes).position(|(a, b)| a != b);
    let at = |tree: &KdTree| node.map(|i| tree.nodes[i].kind());
    format!(
        "node {node:?}: {:?} and {:?}; {} and {} nodes, {} and {} references",
        at(one),
        at(other),
        one.nodes.len(),
        other.nodes.len(),
        one.references.len(),
        other.references.len()
    )
}

fn check_greedy(name: &str, mesh: &Mesh<'_>, config: BuildConfig) {
    let (tree, expected) = (build(mesh, config), every_plane(mesh, config));
    if let Err(violation) = validate_mesh(&tree.view(), mesh) {
        panic!("{name}, {config:?}: {violation}");
    }
    assert!(tree == expected, "{name}, {config:?}: {}", difference(&tree, &expected));
}

/// At most this many triangles of a scene: scenes that go through all configurations are kept
/// small.
fn shortened(scene: &Scene, most: usize) -> Vec<Triangle> {
    let mesh = scene.mesh();
    (0..mesh.len().min(most)).map(|index| mesh.triangle(index)).collect()
}

#[test]
fn the_planes_are_those_of_a_search_over_all() {
    for scene in scenes::awkward() {
        let triangles = shortened(&scene, 260);
        let mesh = Mesh::soup(&triangles).expect("a soup");
        for config in configs() {
            check_greedy(&scene.name, &mesh, config);
        }
    }
}

/// Enough triangles for many bins, several tasks, and nodes that several tasks look through.
#[test]
fn large_nodes_are_split_where_a_search_over_all_splits_them() {
    let mut all = vec![
        scenes::soup(40_000, 0.01, 81),
        scenes::sphere(100, [0.5; 3], 1.0),
        scenes::grid_boxes(16),
        scenes::stairs(10_000),
    ];
    all.extend(scenes::real("bunny"));
    for scene in all {
        check_greedy(&scene.name, &scene.mesh(), best());
        check_greedy(
            &scene.name,
            &scene.mesh(),
            classic().with_sweep(|sweep| sweep.empty_bonus = 51),
        );
    }
}

/// A soup whose corners lie on a grid, so that planes and ties abound, or anywhere; some triangles planar,
/// some twice, some slivers.
fn soups() -> impl Strategy<Value = Vec<Triangle>> {
    let coarse =
        prop::array::uniform3(prop::array::uniform3((0u8..6).prop_map(|x| f32::from(x) * 0.5)));
    let fine = prop::array::uniform3(prop::array::uniform3(-1.0f32..4.0));
    let planar = (coarse.clone(), 0usize..3).prop_map(|(mut triangle, axis)| {
        for corner in 1..3 {
            triangle[corner][axis] = triangle[0][axis];
        }
        triangle
    });
    let sliver = (fine.clone(), 0.0f32..1e-5).prop_map(|(mut triangle, wide)| {
        triangle[2] = triangle[1].map(|x| x + wide);
        triangle
    });
    let any = prop_oneof![coarse, fine, planar, sliver];
    prop::collection::vec(any, 1..90).prop_flat_map(|triangles| {
        let count = triangles.len();
        (Just(triangles), prop::collection::vec(0..count, 0..12)).prop_map(|(mut all, again)| {
            for index in again {
                all.push(all[index]);
            }
            all
        })
    })
}

fn any_config() -> impl Strategy<Value = BuildConfig> {
    let costs = prop_oneof![Just((3, 4, 1)), Just((1, 4, 16)), Just((1, 9, 5)), Just((2, 1, 2))];
    let knobs = (prop_oneof![Just(0u32), Just(26), Just(51), Just(255)], 0u32..=8, any::<bool>());
    (costs, knobs, prop_oneof![Just(64u32), 1u32..8], 1u32..9).prop_map(
        |((traversal_cost, intersection_cost, block_width), knobs, max_depth, references)| {
            let (empty_bonus, bad_splits, clip) = knobs;
            BuildConfig {
                traversal_cost,
                intersection_cost,
                block_width,
                clip,
                max_depth,
                references_per_triangle: references,
                ..best()
            }
            .with_sweep(|sweep| {
                sweep.empty_bonus = empty_bonus;
                sweep.bad_splits = bad_splits;
            })
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn soups_are_split_where_a_search_over_all_splits_them(
        triangles in soups(),
        config in any_config(),
    ) {
        check_greedy("a soup", &Mesh::soup(&triangles).expect("a soup"), config);
    }

    /// What is promised of splits that are tried although they do not pay: the finished tree costs no
    /// more than without them.
    #[test]
    fn tries_never_raise_the_cost(triangles in soups(), config in any_config(), tries in 1u32..=8) {
        let mesh = Mesh::soup(&triangles).expect("a soup");
        let without = cost(&build(&mesh, config.with_sweep(|sweep| sweep.bad_splits = 0)));
        let with = cost(&build(&mesh, config.with_sweep(|sweep| sweep.bad_splits = tries)));
        prop_assert!(with <= without * (1.0 + 1e-12), "{with} and {without}");
    }

    /// A finished tree costs no more than one leaf of all.
    #[test]
    fn no_tree_costs_more_than_a_leaf(triangles in soups(), config in any_config()) {
        let mesh = Mesh::soup(&triangles).expect("a soup");
        let tree = build(&mesh, config);
        let kept = build(&mesh, BuildConfig { max_depth: 1, ..config }).references.len();
        let leaf = kept.div_ceil(config.block_width as usize) as f64;
        prop_assert!(cost(&tree) <= leaf * (1.0 + 1e-12));
    }

    #[test]
    fn clipped_bounds_hold_the_part_and_little_more(
        triangle in prop::array::uniform3(prop::array::uniform3(-4.0f32..4.0)),
        cell in (prop::array::uniform3(-4.0f32..4.0), prop::array::uniform3(0.01f32..6.0)),
        axis in 0usize..3,
        place in 0.01f32..0.99,
        scale in prop_oneof![Just(0), Just(-100), Just(100)],
    ) {
        let scale = 2f32.powi(scale);
        let triangle = triangle.map(|corner| corner.map(|x| x * scale));
        let (lo, extent) = cell;
        let hi = [0, 1, 2].map(|k| lo[k] + extent[k]);
        let cell = Aabb { lo: lo.map(|x| x * scale), hi: hi.map(|x| x * scale) };
        let plane = cell.lo[axis] + place * (cell.hi[axis] - cell.lo[axis]);
        prop_assume!(cell.lo[axis] < plane && plane < cell.hi[axis]);
        check_clip(&triangle, &cell, axis, plane, true);
    }
}

/// The tree's cost as the builder counts it.
fn cost(tree: &KdTree) -> f64 {
    TreeStats::of(&tree.view()).block_cost
}

/// The part of a triangle in a box, in `f64`: points where edges pass sides, sides pass the plane, and
/// corners within. Written apart from the builder's: no polygon is cut, every pair of a line and a plane
/// is tried.
fn part_points(triangle: &Triangle, cell: &Aabb) -> Vec<[f64; 3]> {
    let corners = triangle.map(|corner| corner.map(f64::from));
    let (lo, hi) = (cell.lo.map(f64::from), cell.hi.map(f64::from));
    let slack = sizes(triangle).map(|size| size * 1e-14);
    let inside =
        |p: &[f64; 3]| (0..3).all(|k| lo[k] - slack[k] <= p[k] && p[k] <= hi[k] + slack[k]);
    let mut points: Vec<[f64; 3]> = corners.into_iter().filter(&inside).collect();
    // Edges of the triangle with sides of the box.
    for i in 0..3 {
        let (p, q) = (corners[i], corners[(i + 1) % 3]);
        for axis in 0..3 {
            for side in [lo[axis], hi[axis]] {
                let r = (side - p[axis]) / (q[axis] - p[axis]);
                if (0.0..=1.0).contains(&r) {
                    let mut point = [0, 1, 2].map(|k| p[k] + r * (q[k] - p[k]));
                    point[axis] = side;
                    points.extend(Some(point).filter(&inside));
                }
            }
        }
    }
    // Edges of the box with the triangle.
    let [e, f] = [1, 2].map(|c| [0, 1, 2].map(|k| corners[c][k] - corners[0][k]));
    let n = [0, 1, 2].map(|k| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        e[i] * f[j] - e[j] * f[i]
    });
    for axis in 0..3 {
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        for (u, v) in [(lo[i], lo[j]), (lo[i], hi[j]), (hi[i], lo[j]), (hi[i], hi[j])] {
            // Weights of the corners, seen along the edge.
            let (du, dv) = (u - corners[0][i], v - corners[0][j]);
            let b = (du * f[j] - dv * f[i]) / n[axis];
            let c = (e[i] * dv - e[j] * du) / n[axis];
            if b >= 0.0 && c >= 0.0 && b + c <= 1.0 {
                let mut point = [0.0; 3];
                (point[i], point[j]) = (u, v);
                point[axis] = corners[0][axis] + b * e[axis] + c * f[axis];
                points.extend(Some(point).filter(&inside));
            }
        }
    }
    points
}

/// The greatest coordinate, by axis.
fn sizes(triangle: &Triangle) -> [f64; 3] {
    [0, 1, 2].map(|k| triangle.iter().fold(0.0, |size: f64, p| size.max(f64::from(p[k].abs()))))
}

/// Both parts of a triangle hold what they must; where `tight`, they hold little more. False when the
/// plane does not meet it.
fn check_clip(triangle: &Triangle, cell: &Aabb, axis: usize, plane: f32, tight: bool) -> bool {
    let bounds = Aabb::of_points(triangle).intersection(cell);
    check_clip_within(triangle, cell, &bounds, axis, plane, tight).is_some()
}

/// [`check_clip`] within bounds that the part in the cell has. Returns the parts.
fn check_clip_within(
    triangle: &Triangle,
    cell: &Aabb,
    bounds: &Aabb,
    axis: usize,
    plane: f32,
    tight: bool,
) -> Option<[Option<Aabb>; 2]> {
    if bounds.is_empty() || !(bounds.lo[axis] < plane && plane < bounds.hi[axis]) {
        return None;
    }
    let parts = clip(triangle, cell, bounds, axis, plane);
    for (side, part) in parts.iter().enumerate() {
        let mut half = *cell;
        if side == 0 {
            half.hi[axis] = plane;
        } else {
            half.lo[axis] = plane;
        }
        let points = part_points(triangle, &half);
        let size = sizes(triangle);
        let Some(part) = part else {
            // Points within rounding of the cell may come from outside.
            let deep = |p: &[f64; 3]| {
                (0..3).all(|k| {
                    f64::from(half.lo[k]) + size[k] * 1e-9 < p[k]
                        && p[k] < f64::from(half.hi[k]) - size[k] * 1e-9
                })
            };
            assert!(!points.iter().any(deep), "{triangle:?} in {half:?} was lost");
            continue;
        };
        assert!(half.contains(part) && bounds.contains(part));
        for k in 0..3 {
            let least = points.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
            let most = points.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
            if points.is_empty() {
                continue;
            }
            let (lo, hi) = (f64::from(part.lo[k]), f64::from(part.hi[k]));
            let slack = size[k] * 1e-13;
            assert!(lo <= least + slack && most - slack <= hi, "{triangle:?} in {half:?}");
            // Two floats, and what `f64` leaves open where planes meet at a sharp angle.
            let loose = size[k] * 3e-7;
            assert!(
                !tight || (least - loose <= lo && hi <= most + loose),
                "{triangle:?} in {half:?}: {lo} to {hi} for {least} to {most}"
            );
        }
    }
    Some(parts)
}

/// Needles, planar and huge triangles: what the parts must hold, they do.
#[test]
fn clipped_bounds_hold_parts_of_awkward_triangles() {
    let mut random = Random::new(82);
    let mut checked = 0;
    for scene in scenes::awkward() {
        let mesh = scene.mesh();
        for _ in 0..if mesh.is_empty() { 0 } else { 300 } {
            let triangle = prepare(&mesh.triangle(random.below(mesh.len()))).corners;
            if !triangle.as_flattened().iter().all(|x| x.is_finite() && x.abs() < 1e37) {
                continue;
            }
            let bounds = Aabb::of_points(&triangle);
            let mut cell = bounds;
            for k in 0..3 {
                let at = |s: f64| {
                    let (lo, hi) = (f64::from(bounds.lo[k]), f64::from(bounds.hi[k]));
                    snap((lo + s * (hi - lo)) as f32)
                };
                (cell.lo[k], cell.hi[k]) =
                    (at(random.between(-0.5, 0.6)), at(random.between(0.4, 1.5)));
            }
            let axis = random.below(3);
            let plane = snap(0.5 * cell.lo[axis] + 0.5 * cell.hi[axis]);
            checked += usize::from(check_clip(&triangle, &cell, axis, plane, false));
        }
    }
    assert!(checked > 3_000, "{checked}");
}

/// Cell after cell, as down a tree: what the first cuts left out is missed nowhere below.
#[test]
fn clipped_bounds_hold_their_part_down_a_path() {
    let mut random = Random::new(86);
    let mut deepest = 0;
    for _ in 0..4_000 {
        let triangle = [(); 3].map(|()| [(); 3].map(|()| random.between(-1.0, 1.0) as f32));
        let mut bounds = Aabb::of_points(&triangle);
        let mut cell = bounds;
        for depth in 0..12 {
            let axis = random.below(3);
            let (lo, hi) = (f64::from(bounds.lo[axis]), f64::from(bounds.hi[axis]));
            let plane = random.between(lo, hi) as f32;
            let parts = check_clip_within(&triangle, &cell, &bounds, axis, plane, true);
            let Some(parts) = parts else { break };
            let side = random.below(2);
            let Some(part) = parts[side] else { break };
            bounds = part;
            if side == 0 {
                cell.hi[axis] = plane;
            } else {
                cell.lo[axis] = plane;
            }
            deepest = deepest.max(depth);
        }
    }
    assert_eq!(deepest, 11);
}

/// The tree is one: on any number of threads, instruction set, and in memory used before.
#[test]
fn every_scene_gives_one_valid_tree_on_any_threads() {
    let pools = [1, 2, 4, 7].map(|threads| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool")
    });
    let used = CpuBackend::new();
    for scene in all_scenes() {
        let mesh = scene.mesh();
        let tree = build(&mesh, best());
        if let Err(violation) = validate_mesh(&tree.view(), &mesh) {
            panic!("{}: {violation}", scene.name);
        }
        let leaf_of = |first: u32, count: u32| tree.view().leaf(first, count);
        tree.view().walk(|node, kind, _, _| {
            if let splitplane_core::tree::node::NodeKind::Leaf { first, count } = kind {
                let list = leaf_of(first, count);
                assert!(list.windows(2).all(|w| w[0] < w[1]), "{}: leaf {node}", scene.name);
            }
        });
        for pool in &pools {
            let again =
                pool.install(|| used.build_tree(&mesh, &best().into())).expect("no limit").0;
            assert!(again == tree, "{} on {} threads", scene.name, pool.current_num_threads());
        }
        for set in InstructionSet::available() {
            let backend = CpuBackend::with_instruction_set(set);
            let again = backend.build_tree(&mesh, &best().into()).expect("no limit").0;
            assert!(again == tree, "{} by {}", scene.name, set.name());
        }
    }
}

/// Hits are a function of ray and mesh: those of this tree are those of `fast`.
#[test]
fn hits_are_those_of_the_other_presets() {
    let mut random = Random::new(83);
    let backend = CpuBackend::new();
    let mut hit = 0;
    for scene in all_scenes() {
        let mesh = scene.mesh();
        let trees = [Preset::Best, Preset::Fast].map(|preset| {
            let options = BuildOptions::from(preset.config());
            backend.build(&mesh, &options).expect("no limit binds")
        });
        let bounds = trees[0].tree().bounds;
        if bounds.is_empty() {
            continue;
        }
        let mut point = || {
            [0, 1, 2].map(|k| {
                let (lo, hi) = (f64::from(bounds.lo[k]), f64::from(bounds.hi[k]));
                (lo + random.between(-0.2, 1.2) * (hi - lo)).clamp(-1e38, 1e38) as f32
            })
        };
        let rays: Vec<Ray> = (0..3_000)
            .map(|i| {
                let (from, mut to) = (point(), point());
                if i % 2 == 0 {
                    // At a corner: on edges and vertices.
                    let corner = mesh.triangle(i * 37 % mesh.len())[i % 3];
                    to = if corner.iter().all(|x| x.is_finite()) { corner } else { to };
                }
                Ray::new(from, [0, 1, 2].map(|k| 0.5 * to[k] - 0.5 * from[k]))
            })
            .collect();
        let mut hits = [vec![Hit::MISS; rays.len()], vec![Hit::MISS; rays.len()]];
        for (tree, hits) in trees.iter().zip(&mut hits) {
            tree.closest_hits(&rays, hits, &QueryOptions::default()).expect("equal lengths");
        }
        let bits = |hit: &Hit| [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()];
        for ((ray, a), b) in rays.iter().zip(&hits[0]).zip(&hits[1]) {
            assert_eq!(bits(a), bits(b), "{}: {ray:?}", scene.name);
        }
        hit += hits[0].iter().filter(|hit| hit.is_hit()).count();
    }
    assert!(hit > 10_000, "{hit}");
}

/// References of all leaves stay below the cap, however many planes would pay.
#[test]
fn the_cap_on_references_holds() {
    let mut bound = 0;
    for scene in scenes::awkward() {
        for references_per_triangle in [1, 3] {
            let config = BuildConfig { references_per_triangle, ..classic() };
            let tree = build(&scene.mesh(), config);
            let kept =
                build(&scene.mesh(), BuildConfig { max_depth: 1, ..best() }).references.len();
            let cap = config.reference_cap(kept as u32) as usize;
            assert!(tree.references.len() <= cap, "{}", scene.name);
            let free = build(&scene.mesh(), BuildConfig { references_per_triangle: 64, ..config });
            bound += usize::from(tree != free);
        }
    }
    assert!(bound > 3, "the cap bound in {bound} scenes only");
}

/// A limit on memory ends in its own error or changes nothing.
#[test]
fn memory_limits_end_in_an_error() {
    let scene = scenes::soup(50_000, 0.01, 84);
    let mesh = scene.mesh();
    let backend = CpuBackend::new();
    let built = backend.build_accelerator(&mesh, &best().into()).expect("no limit");
    let peak = built.summary().peak_bytes;
    let mut refused = 0;
    for eighth in 0..=12 {
        let max_memory = Some(peak * eighth / 8);
        let options = BuildOptions { max_memory, ..BuildOptions::from(best()) };
        match CpuBackend::new().build_accelerator(&mesh, &options) {
            Ok(again) => {
                assert_eq!(again.tree(), built.tree());
                assert!(Some(again.summary().peak_bytes) <= max_memory);
            }
            Err(BuildError::OutOfMemory { needed, limit }) => {
                assert!(Some(limit) == max_memory && needed > limit);
                refused += 1;
            }
            Err(other) => panic!("{other}"),
        }
    }
    assert!(refused > 4, "{refused}");
}

/// Every way to a tree gives it.
#[test]
fn all_entries_of_the_backend_build_it() {
    let backend = CpuBackend::new();
    let (one, other) = (scenes::soup(2_000, 0.1, 85), scenes::bad_vertices());
    let options = BuildOptions::from(best());
    let mut accelerator = backend.build_accelerator(&one.mesh(), &options).expect("no limit");
    assert_eq!(*accelerator.tree(), build(&one.mesh(), best()));
    backend.rebuild_accelerator(&mut accelerator, &other.mesh(), &options).expect("no limit");
    assert_eq!(*accelerator.tree(), build(&other.mesh(), best()));
    let summary = *accelerator.summary();
    let (_, fast) = backend.build_tree(&other.mesh(), &BuildOptions::default()).expect("no limit");
    assert_eq!((summary.dropped, summary.snapped), (fast.dropped, fast.snapped));
    assert!(summary.dropped > 0 && summary.peak_bytes > 0);
    assert_eq!((summary.large_levels, summary.small_roots), (0, 0));
}

/// At the costs of the literature the tree is no worse than what textbooks build, with and without
/// clipping. `SPLITPLANE_LONG=1` measures all real scenes; run it with `--release`.
#[test]
fn no_worse_than_the_textbook() {
    let mut all = scenes::awkward();
    let real: &[&str] =
        if long() { &["bunny", "sponza", "kitchen", "robots", "bathroom"] } else { &["horse"] };
    all.extend(real.iter().filter_map(|name| scenes::real(name)));
    for scene in &all {
        let mesh = scene.mesh();
        let sah = |tree: &KdTree| TreeStats::of(&tree.view()).sah_cost;
        let textbook = sah(&greedy::textbook(&mesh, &classic()));
        let ours = sah(&build(&mesh, classic()));
        println!("{:32} textbook {textbook:9.3} best {ours:9.3}", scene.name);
        assert!(ours <= textbook * (1.0 + 1e-12), "{}: {ours} and {textbook}", scene.name);
    }
}

/// The trees of the built-in scenes, by digest.
#[test]
fn trees_of_built_in_scenes() {
    let mut text = String::new();
    for name in ["cornell", "spheres", "stadium", "gallery", "carousel", "city:20000"] {
        let scene = splitplane::scene::Scene::open(format!("builtin:{name}")).expect("built in");
        let mesh = scene.mesh().expect("built in");
        for (costs, config) in [("", best()), (" classic", classic())] {
            let tree = build(&mesh, config);
            validate_mesh(&tree.view(), &mesh).expect("a valid tree");
            let stats = TreeStats::of(&tree.view());
            let _ = writeln!(
                text,
                "{name}{costs}: {}, {} nodes, {} references, depth {}",
                tree.digest(),
                stats.nodes,
                stats.references,
                stats.max_depth
            );
        }
    }
    insta::assert_snapshot!("trees-of-built-in-scenes", text);
    let tree = build(&scenes::soup(12, 0.2, 24).mesh(), classic());
    insta::assert_snapshot!("12-triangles", dump(&tree.view(), usize::MAX));
}
