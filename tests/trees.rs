//! Trees: invariants checked without the builder's code, the same bytes on every thread count and
//! every run, and snapshots.

use crate::common::all_scenes;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::report::BuildSummary;
use splitplane_core::tree::dump::dump;
use splitplane_core::tree::node::NodeKind;
use splitplane_core::tree::stats::TreeStats;
use splitplane_core::tree::validate::validate_mesh;
use splitplane_core::tree::{KdTree, KdTreeView};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::configs::with_builder_of;
use splitplane_test_support::exact::{ExactBackend, is_dropped};
use splitplane_test_support::faulty::{Fault, FaultyBackend};
use splitplane_test_support::oracle::snap;
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use std::fmt::Write;

/// The presets that run the schedule, as they are tuned.
fn presets() -> [BuildConfig; 2] {
    [Preset::Fast, Preset::Balanced].map(Preset::config)
}

fn build(backend: &dyn Backend, scene: &Scene, config: BuildConfig) -> (KdTree, BuildSummary) {
    let accelerator = backend
        .build(&scene.mesh(), &config.into())
        .unwrap_or_else(|error| panic!("{}: {error}", scene.name));
    (accelerator.tree().clone(), *accelerator.summary())
}

/// A leaf with its cell.
struct Leaf {
    cell: Aabb,
    references: Vec<u32>,
}

/// Reads the tree by its documented format, in a way of its own (recursion over subtree ends), and
/// checks the form on the way.
fn leaves_of(tree: &KdTreeView<'_>, name: &str) -> Vec<Leaf> {
    fn subtree(
        tree: &KdTreeView<'_>,
        index: usize,
        cell: Aabb,
        depth: u32,
        leaves: &mut Vec<Leaf>,
        used: &mut usize,
        name: &str,
    ) -> usize {
        assert!(depth <= tree.config.max_depth, "{name}: node {index} is at depth {depth}");
        match tree.nodes[index].kind() {
            NodeKind::Interior { axis, split, right } => {
                let axis = axis.index();
                assert!(
                    cell.lo[axis] < split && split < cell.hi[axis],
                    "{name}: node {index} splits {cell:?} at {split} on axis {axis}"
                );
                let (mut low, mut high) = (cell, cell);
                low.hi[axis] = split;
                high.lo[axis] = split;
                let end = subtree(tree, index + 1, low, depth + 1, leaves, used, name);
                assert_eq!(end, right as usize, "{name}: node {index} is not in preorder");
                subtree(tree, end, high, depth + 1, leaves, used, name)
            }
            NodeKind::Leaf { first, count } => {
                if count > 0 {
                    assert_eq!(first as usize, *used, "{name}: leaf {index} starts elsewhere");
                }
                let end = *used + count as usize;
                leaves.push(Leaf { cell, references: tree.references[*used..end].to_vec() });
                *used = end;
                index + 1
            }
        }
    }
    let (mut leaves, mut used) = (Vec::new(), 0);
    let end = subtree(tree, 0, tree.bounds, 0, &mut leaves, &mut used, name);
    assert_eq!(end, tree.nodes.len(), "{name}: nodes behind the tree");
    assert_eq!(used, tree.references.len(), "{name}: references behind the last leaf");
    leaves
}

fn snapped(mesh: &Mesh<'_>, triangle: usize) -> [[f32; 3]; 3] {
    mesh.triangle(triangle).map(|corner| corner.map(snap))
}

/// Whether some closed leaf cell with the point refers to the triangle.
fn is_found(tree: &KdTreeView<'_>, point: [f64; 3], triangle: u32) -> bool {
    let mut stack = vec![0usize];
    while let Some(index) = stack.pop() {
        match tree.nodes[index].kind() {
            NodeKind::Interior { axis, split, right } => {
                let (x, split) = (point[axis.index()], f64::from(split));
                if x <= split {
                    stack.push(index + 1);
                }
                if x >= split {
                    stack.push(right as usize);
                }
            }
            NodeKind::Leaf { first, count } => {
                let range = first as usize..(first + count) as usize;
                if count > 0 && tree.references[range].contains(&triangle) {
                    return true;
                }
            }
        }
    }
    false
}

/// All invariants of one tree.
fn check_tree(scene: &Scene, tree: &KdTree, summary: &BuildSummary) {
    let mesh = scene.mesh();
    let view = tree.view();
    let name = &scene.name;
    if let Err(violation) = validate_mesh(&view, &mesh) {
        panic!("{name}: {violation}");
    }
    let leaves = leaves_of(&view, name);

    // Counts and bounds.
    let kept: Vec<u32> =
        (0..mesh.len()).filter(|&i| !is_dropped(&snapped(&mesh, i))).map(|i| i as u32).collect();
    assert_eq!(tree.triangles as usize, mesh.len(), "{name}");
    assert_eq!(summary.triangles as usize, mesh.len(), "{name}");
    assert_eq!(summary.dropped as usize, mesh.len() - kept.len(), "{name}: dropped");
    // Of all finite triangles, kept or not; `to_bits` tells -0 from 0.
    let changed = (0..mesh.len()).filter(|&i| {
        let given = mesh.triangle(i);
        given.as_flattened().iter().all(|x| x.is_finite())
            && given.map(|corner| corner.map(f32::to_bits))
                != snapped(&mesh, i).map(|corner| corner.map(f32::to_bits))
    });
    assert_eq!(summary.snapped as usize, changed.count(), "{name}: snapped");
    let bounds = kept.iter().fold(Aabb::EMPTY, |bounds, &i| {
        bounds.union(&Aabb::of_points(&snapped(&mesh, i as usize)))
    });
    assert_eq!(tree.bounds, bounds, "{name}: bounds");

    // References: of kept triangles, once a leaf, within reach of the cell; every triangle somewhere.
    let mut named = vec![false; mesh.len()];
    for leaf in &leaves {
        let mut seen = leaf.references.clone();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), leaf.references.len(), "{name}: a leaf names a triangle twice");
        for &triangle in &leaf.references {
            let corners = snapped(&mesh, triangle as usize);
            assert!(!is_dropped(&corners), "{name}: {triangle} is dropped, yet a leaf names it");
            let common = Aabb::of_points(&corners).intersection(&leaf.cell);
            assert!(!common.is_empty(), "{name}: {triangle} does not reach {:?}", leaf.cell);
            named[triangle as usize] = true;
        }
    }
    for &triangle in &kept {
        assert!(named[triangle as usize], "{name}: no leaf names triangle {triangle}");
    }

    // Points of triangles, corners and points of edges among them, are found where they lie.
    let mut random = Random::new(21);
    let samples = (200_000 / (kept.len() + 1)).clamp(2, 60);
    // A leaf of 20,000 identical triangles is searched for each point: fewer triangles will do.
    let stride = kept.len().div_ceil(2_000).max(1);
    for &triangle in kept.iter().step_by(stride) {
        let corners = snapped(&mesh, triangle as usize).map(|corner| corner.map(f64::from));
        for sample in 0..samples {
            let weights = match sample {
                0..3 => [0, 1, 2].map(|k| f64::from(u8::from(k == sample))),
                3..6 => {
                    let s = random.unit();
                    [0, 1, 2].map(|k| [s, 1.0 - s, 0.0][(k + sample) % 3])
                }
                _ => random.barycentric(),
            };
            let point = [0, 1, 2].map(|axis| {
                let values = corners.map(|corner| corner[axis]);
                let x = (0..3).map(|k| weights[k] * values[k]).sum::<f64>();
                // Rounding must not carry the point out of the triangle's own bounds.
                let low = values.iter().copied().fold(f64::INFINITY, f64::min);
                let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                x.clamp(low, high)
            });
            assert!(
                is_found(&view, point, triangle),
                "{name}: no leaf at {point:?} names triangle {triangle}, {corners:?}"
            );
        }
    }
}

fn every_scene_keeps_the_invariants(backend: &dyn Backend) {
    for scene in all_scenes() {
        for config in presets() {
            let (tree, summary) = build(backend, &scene, config);
            check_tree(&scene, &tree, &summary);
        }
    }
}

/// Configurations at the edges of their ranges.
fn every_configuration_keeps_the_invariants(backend: &dyn Backend) {
    let default = BuildConfig::default();
    let configs = [
        BuildConfig { max_depth: 1, ..default },
        BuildConfig { max_depth: 96, ..default }.with_stages(|stages| stages.empty_cutoff = 1),
        default.with_stages(|stages| stages.empty_cutoff = 255),
        BuildConfig { max_depth: 96, ..default }.with_stages(|stages| stages.small_node_limit = 1),
        BuildConfig { traversal_cost: 1, intersection_cost: 10, block_width: 1, ..default },
        BuildConfig { traversal_cost: 1367 - 128, intersection_cost: 1, block_width: 1, ..default },
        BuildConfig { references_per_triangle: 1, ..default }
            .with_stages(|stages| stages.nodes_per_triangle = 1),
        BuildConfig { clip: false, ..default },
    ];
    let balanced = Preset::Balanced.config();
    let of_balanced = configs.map(|config| with_builder_of(Preset::Balanced, config));
    let bins = [2, 7, 64].map(|bins| balanced.with_bins(bins));
    let configs: Vec<BuildConfig> = configs.into_iter().chain(of_balanced).chain(bins).collect();
    let scenes = [
        scenes::none(),
        scenes::one(),
        scenes::soup(700, 0.2, 22),
        scenes::identical(500),
        scenes::fan(600),
        scenes::needles(400),
        scenes::coplanar(1, 200),
        scenes::grid_boxes(4),
        scenes::ratio(),
        scenes::seams(true),
        scenes::spike(),
    ];
    for scene in &scenes {
        for &config in &configs {
            let (tree, summary) = build(backend, scene, config);
            assert_eq!(tree.config, config);
            check_tree(scene, &tree, &summary);
        }
    }
}

/// References stay below the configured cap, whatever the scene: what bounds memory.
fn the_caps_hold(backend: &dyn Backend) {
    for scene in scenes::awkward() {
        for (config, per_triangle) in presets().iter().flat_map(|c| [(c, 1), (c, 8)]) {
            let config = BuildConfig { references_per_triangle: per_triangle, ..*config }
                .with_stages(|stages| stages.nodes_per_triangle = per_triangle);
            let (tree, summary) = build(backend, &scene, config);
            // A small root adds at most 1,023 references and 511 nodes to what the cap allows.
            let roots = u64::from(summary.small_roots);
            let cap = u64::from(config.reference_cap(tree.triangles)) + 1023 * roots;
            assert!(tree.references.len() as u64 <= cap, "{}", scene.name);
            let cap = u64::from(config.node_cap(tree.triangles)) + 511 * roots;
            assert!(tree.nodes.len() as u64 <= cap.max(1), "{}", scene.name);
        }
    }
}

/// One digest, and one tree, on 1, 2, 3 and 8 threads, and when buffers are used again.
fn the_tree_is_the_same_every_time(backend: &dyn Backend) {
    let pools = [1, 2, 3, 8].map(|threads| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool")
    });
    let mut first = Vec::new();
    let all = all_scenes();
    let by_preset = presets();
    let cases = || all.iter().flat_map(|scene| by_preset.map(|config| (scene, config)));
    for (scene, config) in cases() {
        let (tree, _) = build(backend, scene, config);
        for pool in &pools {
            let (again, _) = pool.install(|| build(backend, scene, config));
            let threads = pool.current_num_threads();
            assert_eq!(again.digest(), tree.digest(), "{} on {threads} threads", scene.name);
            assert_eq!(again, tree, "{} on {threads} threads", scene.name);
        }
        first.push(tree);
    }
    // Backwards, so that every scene follows another one than before.
    for ((scene, config), tree) in cases().zip(&first).collect::<Vec<_>>().into_iter().rev() {
        let (again, _) = build(backend, scene, config);
        assert_eq!(again, *tree, "{} after another scene", scene.name);
    }
}

/// Equal geometry gives an equal tree, whether it comes by index or as a soup.
fn indexed_and_soup_agree(backend: &dyn Backend) {
    for scene in [scenes::sphere(20, [0.5; 3], 1.0), scenes::grid_boxes(3), scenes::bad_vertices()]
    {
        let soup = scene.joined(&scenes::none(), "as soup");
        for config in presets() {
            let (indexed, _) = build(backend, &scene, config);
            let (separate, _) = build(backend, &soup, config);
            assert_eq!(indexed.digest(), separate.digest(), "{}", scene.name);
        }
    }
}

/// A limit on memory ends in its own error, at any limit below what the build takes.
fn memory_limits_end_in_an_error(backend: &dyn Backend) {
    for config in presets() {
        check_memory_limits(backend, config);
    }
}

fn check_memory_limits(backend: &dyn Backend, config: BuildConfig) {
    let scene = scenes::soup(3_000, 0.1, 23);
    let (tree, summary) = build(backend, &scene, config);
    assert!(summary.peak_bytes > 0);
    let mut refused = 0;
    for eighth in 0..=9 {
        let max_memory = Some(summary.peak_bytes * eighth / 8);
        let options = BuildOptions { config, max_memory, ..BuildOptions::default() };
        match backend.build(&scene.mesh(), &options) {
            Ok(built) => {
                assert_eq!(*built.tree(), tree, "a limit that does not bind changes the tree");
                assert!(Some(built.summary().peak_bytes) <= max_memory);
            }
            Err(BuildError::OutOfMemory { needed, limit }) => {
                assert_eq!(Some(limit), max_memory);
                assert!(needed > limit);
                refused += 1;
            }
            Err(other) => panic!("{other}"),
        }
    }
    assert!(refused > 0, "a build in no memory at all succeeds");
}

/// A bad configuration is refused before anything is built.
fn bad_configurations_are_refused(backend: &dyn Backend) {
    let config = BuildConfig { block_width: 0, ..Default::default() };
    let refused = backend.build(&scenes::one().mesh(), &config.into());
    assert!(matches!(refused, Err(BuildError::Config(_))));
}

/// Trees of tiny scenes in full; larger ones as measures, digest and first nodes.
#[test]
fn snapshots_of_tiny_trees() {
    for scene in [
        scenes::none(),
        scenes::one(),
        scenes::soup(12, 0.2, 24).named("12 triangles"),
        scenes::identical(5).named("5 identical triangles"),
        scenes::grid_boxes(1).named("one box"),
        scenes::stairs(3).named("3 stairs"),
    ] {
        let (tree, _) = build(&CpuBackend::new(), &scene, BuildConfig::default());
        insta::assert_snapshot!(slug(&scene.name), dump(&tree.view(), usize::MAX));
    }
    // Cheap steps and dear tests: more than one node even for a few triangles.
    let fine = BuildConfig { intersection_cost: 10, block_width: 1, ..Default::default() };
    for scene in [scenes::soup(12, 0.2, 24), scenes::stairs(3)] {
        let (tree, _) = build(&CpuBackend::new(), &scene, fine);
        assert!(tree.nodes.len() > 5, "{}: not a tree to look at", scene.name);
        let name = format!("{}-by-single-tests", slug(&scene.name));
        insta::assert_snapshot!(name, dump(&tree.view(), usize::MAX));
    }
}

#[test]
fn snapshots_of_larger_trees() {
    for scene in scenes::awkward().iter().filter(|scene| scene.mesh().len() > 12) {
        let (tree, summary) = build(&CpuBackend::new(), scene, BuildConfig::default());
        let stats = TreeStats::of(&tree.view());
        // Not the memory of the build: it may depend on the machine.
        let mut text = format!(
            "dropped {} snapped {} levels {} small roots {}\nleaves by depth",
            summary.dropped, summary.snapped, summary.large_levels, summary.small_roots
        );
        for (depth, count) in stats.leaves_by_depth.iter().enumerate().filter(|(_, n)| **n > 0) {
            let _ = write!(text, " {depth}:{count}");
        }
        text.push_str("\nleaves by size class");
        for (class, count) in stats.leaf_sizes.iter().enumerate().filter(|(_, n)| **n > 0) {
            let _ = write!(text, " {class}:{count}");
        }
        let _ = write!(text, "\n{}", dump(&tree.view(), 12));
        insta::assert_snapshot!(slug(&scene.name), text);
    }
}

/// Trees of the preset `balanced`, a line a scene; where a scene has large nodes they differ from those
/// of `fast`.
#[test]
fn snapshot_of_balanced_trees() {
    let (mut text, mut different) = (String::new(), 0);
    for scene in scenes::awkward() {
        let [fast, balanced] = presets().map(|config| build(&CpuBackend::new(), &scene, config));
        let (tree, summary) = balanced;
        check_tree(&scene, &tree, &summary);
        let small = scene.mesh().len() <= 64;
        assert!(!small || tree.nodes == fast.0.nodes, "{}: no level splits it", scene.name);
        different += u32::from(tree.nodes != fast.0.nodes);
        let (name, digest) = (slug(&scene.name), tree.digest());
        let (levels, roots) = (summary.large_levels, summary.small_roots);
        let (nodes, references) = (tree.nodes.len(), tree.references.len());
        let _ = writeln!(
            text,
            "{name} digest {digest} levels {levels} small roots {roots} nodes {nodes} references \
             {references}"
        );
    }
    assert!(different > 10, "only {different} scenes have other trees");
    insta::assert_snapshot!("balanced", text);
}

fn slug(name: &str) -> String {
    name.chars().filter(|c| *c != ',').map(|c| if c == ' ' { '-' } else { c }).collect()
}

macro_rules! on_every_backend {
    ($($check:ident),* $(,)?) => {
        mod cpu {
            use super::*;
            $(#[test] fn $check() { super::$check(&CpuBackend::new()); })*
        }
    };
}

on_every_backend! {
    every_scene_keeps_the_invariants,
    every_configuration_keeps_the_invariants,
    the_caps_hold,
    the_tree_is_the_same_every_time,
    indexed_and_soup_agree,
    memory_limits_end_in_an_error,
    bad_configurations_are_refused,
}

/// The checks pass on a backend that is right and fail on faults.
mod planted {
    use super::*;

    fn fails(fault: Fault, check: fn(&dyn Backend)) -> bool {
        let backend = FaultyBackend::new(ExactBackend, fault);
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| check(&backend))).is_err()
    }

    #[test]
    fn the_exact_backend_passes() {
        every_configuration_keeps_the_invariants(&ExactBackend);
        indexed_and_soup_agree(&ExactBackend);
    }

    #[test]
    fn faults_are_noticed() {
        assert!(fails(Fault::LosesReference, every_scene_keeps_the_invariants));
        assert!(fails(Fault::CountsNothing, every_scene_keeps_the_invariants));
        assert!(fails(Fault::Unstable, the_tree_is_the_same_every_time));
        assert!(fails(Fault::Unstable, indexed_and_soup_agree));
    }

    /// A reference moved from its leaf to the next one: counts agree, the point test must see it.
    #[test]
    fn a_misplaced_reference_is_noticed() {
        let scene = scenes::soup(200, 0.1, 25);
        let config = BuildConfig { intersection_cost: 10, block_width: 1, ..Default::default() };
        let (mut tree, summary) = build(&CpuBackend::new(), &scene, config);
        check_tree(&scene, &tree, &summary);
        let last = tree.references.len() - 1;
        tree.references.swap(0, last);
        let broken = std::panic::AssertUnwindSafe(|| check_tree(&scene, &tree, &summary));
        assert!(std::panic::catch_unwind(broken).is_err());
        // The sampling test on its own, without the library's validation.
        let mesh = scene.mesh();
        let mut random = Random::new(26);
        let lost = (0..mesh.len()).any(|triangle| {
            let corners = snapped(&mesh, triangle).map(|corner| corner.map(f64::from));
            (0..20).any(|_| {
                let w = random.barycentric();
                let point = [0, 1, 2].map(|i| (0..3).map(|k| w[k] * corners[k][i]).sum());
                !is_found(&tree.view(), point, triangle as u32)
            })
        });
        assert!(lost);
    }
}
