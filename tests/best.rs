//! Preset `best`: the tree is the one that a builder finds which counts every reference for every plane;
//! clipped bounds hold what they must; costs fall where they must.

use proptest::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, Backend, BuildError, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::dump::dump;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::stats::TreeStats;
use splitplane_core::tree::KdTree;
use splitplane_core::triangle::Triangle;
use splitplane_core::validate::validate_mesh;
use splitplane_cpu::best::clip::clip;
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::greedy;
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use std::fmt::Write;

fn best() -> BuildConfig {
    BuildConfig::preset(Preset::Best)
}

/// The costs of Wald and Havran, 15 and 20, in lowest terms.
fn classic() -> BuildConfig {
    BuildConfig { traversal_cost: 3, intersection_cost: 4, block_width: 1, ..best() }
}

/// Configurations that reach every rule.
fn configs() -> Vec<BuildConfig> {
    let plain = BuildConfig { empty_bonus: 0, bad_splits: 0, ..classic() };
    vec![
        best(),
        BuildConfig { clip: false, ..best() },
        BuildConfig { empty_bonus: 0, bad_splits: 0, ..best() },
        classic(),
        plain,
        BuildConfig { clip: false, ..plain },
        BuildConfig { empty_bonus: 51, ..plain },
        BuildConfig { bad_splits: 3, ..plain },
        BuildConfig { bad_splits: 8, block_width: 3, ..plain },
        BuildConfig { bad_splits: 3, empty_bonus: 255, max_depth: 5, clip: false, ..plain },
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

/// At most so many triangles of a scene: the reference counts every reference for every plane.
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

/// Enough triangles for many bins and several tasks.
#[test]
fn larger_nodes_are_split_where_a_search_over_all_splits_them() {
    for scene in
        [scenes::soup(3_000, 0.02, 81), scenes::sphere(26, [0.5; 3], 1.0), scenes::grid_boxes(6)]
    {
        check_greedy(&scene.name, &scene.mesh(), BuildConfig { empty_bonus: 51, ..best() });
    }
}
