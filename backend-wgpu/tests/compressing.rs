//! Compressed nodes that the device makes: the kernels in step with their serial reference, byte for byte, whatever the batches; faults
//! in each of them are seen at its first dispatch; the finished nodes are those of the CPU, and rays through them have the
//! CPU's hits.

use std::sync::Arc;

use crate::common::{self, own_gpu, poison, queries, source_of};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::build::compress::{Reference, compress, most_nodes};
use splitplane_core::build::lockstep::{Lockstep, LockstepError};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::kernel::CompressKernel;
use splitplane_core::query::compressed::CompressedNodes;
use splitplane_core::ray::{Hit, QueryOptions};
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{DeviceTree, Queries, WgpuBackend};

struct Case {
    name: String,
    cpu: CpuAccelerator,
    triangles: Vec<Triangle>,
    device: DeviceTree,
}

impl Case {
    fn new(scene: &Scene, config: BuildConfig) -> Case {
        let mesh = scene.mesh();
        let cpu = CpuBackend::new()
            .build_accelerator(&mesh, &BuildOptions::from(config))
            .expect("a tree");
        let triangles: Vec<Triangle> =
            (0..mesh.len()).map(|i| prepare(&mesh.triangle(i)).corners).collect();
        let device =
            DeviceTree::upload(&queries(), &cpu.tree().view(), &triangles).expect("an upload");
        Case { name: scene.name.clone(), cpu, triangles, device }
    }

    /// The first difference between the kernels on a device and their reference, and what the reference made.
    fn in_step(&self, queries: &Queries, batch: u32) -> (Option<String>, CompressedNodes) {
        self.in_room(queries, batch, u32::MAX)
    }

    /// The same with room for no more than so many nodes.
    fn in_room(
        &self,
        queries: &Queries,
        batch: u32,
        room: u32,
    ) -> (Option<String>, CompressedNodes) {
        let done = queries.with_compress_executor(&self.device, batch, room, |device, inputs| {
            let tree = self.cpu.tree().view();
            let reference = Reference::new(tree, &self.triangles[..], inputs);
            let mut lockstep = Lockstep::new(reference, device);
            let difference = match compress(&mut lockstep) {
                Ok(()) => None,
                Err(LockstepError::Differs(difference)) => Some(difference.to_string()),
                Err(LockstepError::First(never)) => match never {},
                Err(LockstepError::Second(error)) => panic!("{error}"),
            };
            (difference, lockstep.into_inner().0.into_nodes())
        });
        done.expect("a device that holds the tree")
    }

    fn greedy(&self) -> CompressedNodes {
        let (tree, scale) = (self.cpu.tree().view(), self.cpu.scene_scale());
        CompressedNodes::greedy(&tree, &self.triangles[..], scale).expect("few references")
    }
}

/// Scenes whose trees compressed nodes are made of.
fn cases() -> impl Iterator<Item = Case> {
    let scenes = scenes::awkward();
    let presets = [Preset::Fast, Preset::Narrow, Preset::Balanced, Preset::Best];
    let in_turn = move |(i, scene): (usize, Scene)| Case::new(&scene, presets[i % 4].config());
    scenes.into_iter().enumerate().map(in_turn).filter(|case| !case.device.scene_scale().wide)
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn kernels_are_in_step_with_their_reference() {
    let (mut nodes, mut seen) = (0, 0);
    for case in cases() {
        let greedy = case.greedy();
        let tree = case.cpu.tree();
        let most = most_nodes(tree.nodes.len() as u32, tree.references.len() as u32);
        assert!(greedy.nodes.len() as u32 <= most, "{}", case.name);
        // In batches of a few parts, and of a whole level.
        for batch in [5 + greedy.nodes.len() as u32 / 8, u32::MAX] {
            let (difference, made) = case.in_step(&queries(), batch);
            assert_eq!(difference, None, "{}", case.name);
            assert!(made == greedy, "{}: nodes depend on batches", case.name);
        }
        (nodes, seen) = (nodes + greedy.nodes.len(), seen + 1);
    }
    assert!(nodes > 2_000 && seen > 20, "{nodes} nodes of {seen} scenes");
}

/// A queue that is outgrown ends the work in the same round; and where the device makes nodes by itself, it is done again with more room.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn queues_may_be_outgrown() {
    let case = Case::new(&scenes::soup(700, 0.3, 8), Preset::Fast.config());
    let all = case.greedy().nodes.len();
    for room in [1, all as u32 / 2, all as u32 - 1, all as u32] {
        let (difference, made) = case.in_room(&queries(), 10, room);
        assert_eq!(difference, None, "{room}");
        assert_eq!(made.nodes.len() == all, room == all as u32, "{room}");
    }
    // One long leaf, of which more nodes are made than a tree of its size usually has.
    let case = Case::new(&scenes::identical(20_000), Preset::Fast.config());
    let (tree, nodes) = (case.cpu.tree(), case.greedy().nodes.len());
    assert!(nodes > tree.nodes.len() / 6 + tree.references.len() / 64 + 64);
    let own = Queries::new(Arc::new(own_gpu()));
    let mut device = DeviceTree::upload(&own, &tree.view(), &case.triangles).expect("an upload");
    let (before, bytes) = (own.gpu().traffic(), device.bytes());
    device.compress_on_device(&own).expect("compressed nodes");
    assert!((own.gpu().traffic() - before).readbacks >= 2);
    assert!(device.bytes() - bytes >= 80 * nodes as u64);
}

/// Whatever the memory of workgroups holds at first.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn memory_of_workgroups_may_hold_anything() {
    let case = Case::new(&scenes::soup(700, 0.3, 8), Preset::Fast.config());
    for kernel in CompressKernel::ALL {
        for word in poison::WORDS {
            let Some(source) = poison::poisoned(&source_of(kernel.name()), word) else { continue };
            let queries = Queries::new(common::gpu());
            queries.replace_compress_kernel(kernel, Some(source));
            assert_eq!(case.in_step(&queries, 40).0, None, "{kernel:?}");
        }
    }
}

/// Each fault is seen in the kernel that has it.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_named() {
    use CompressKernel as K;
    let faults = [
        (K::OpenParts, "if !low_is_empty && !is_empty_leaf(words.y >> 2u)", "if !low_is_empty"),
        (K::OpenParts, "area > most_area", "area >= most_area"),
        (K::OpenParts, "area > most_area", "area < most_area"),
        (K::OpenParts, "place < part.count % count", "place <= part.count % count"),
        (K::OpenParts, "snapped_product(e.z, e.x)", "snapped_product(e.z, e.y)"),
        (K::OpenParts, "least3(all.hi, leaf.hi)", "all.hi"),
        (K::OpenParts, "let lost = is_empty(within);", "let lost = !is_empty(within);"),
        (K::OpenParts, "counts.y += child.count", "counts.y += 1u"),
        (K::PlaceChildren, "inclusive_scan(lane, own) - own", "inclusive_scan(lane, own)"),
        (K::PlaceChildren, "min(compress.batch_room, after.x - made)", "after.x - made"),
        (K::PlaceChildren, "counters[4] = after.y", "counters[4] = after.x"),
        (K::EmitNodes, "bits < 0x80000000u", "bits >= 0x80000000u"),
        (K::EmitNodes, "power_of_two(power + 1)", "power_of_two(power)"),
        (K::EmitNodes, "- 32;", "- 12;"),
        (K::EmitNodes, "exponent(extent) - 8", "exponent(extent) - 6"),
        (K::EmitNodes, "select(1u, 2u, f32(whole) < outer)", "1u"),
        (K::EmitNodes, "select(whole - 1u, 0u, whole == 0u)", "whole"),
        (K::EmitNodes, "leaf_references[part.first + at]", "leaf_references[part.first]"),
        (K::EmitNodes, "(inner << REFERENCE_BITS)", "(count << REFERENCE_BITS)"),
        (K::EmitNodes, "parts[place.x + inner] = part", "parts[place.x] = part"),
    ];
    let mut cases = vec![
        Case::new(&scenes::soup(700, 0.3, 8), Preset::Fast.config()),
        Case::new(&scenes::grid_boxes(4), Preset::Balanced.config()),
        Case::new(&scenes::identical(300), Preset::Fast.config()),
        Case::new(&scenes::sphere(16, [1e3, -2e3, 5e2], 1.0), Preset::Narrow.config()),
    ];
    cases.extend(cases_with_lost_leaves());
    let mut unseen = Vec::new();
    for (kernel, from, to) in faults {
        let source = source_of(kernel.name());
        assert!(source.contains(from), "{from}: the text is not there");
        let queries = Queries::new(common::gpu());
        queries.replace_compress_kernel(kernel, Some(source.replacen(from, to, 1)));
        let found = cases.iter().find_map(|case| case.in_step(&queries, 9).0);
        match found {
            Some(difference) if difference.contains(&format!("{kernel:?}")) => {}
            found => unseen.push((kernel, from, found)),
        }
    }
    assert!(unseen.is_empty(), "{unseen:#?}");
}

/// Triangles on planes of the tree.
fn cases_with_lost_leaves() -> Vec<Case> {
    [scenes::seams(true), scenes::coplanar(1, 100)]
        .map(|scene| Case::new(&scene, Preset::Fast.config()))
        .into()
}

/// Rays through nodes that the device has made have the hits of the tree; so they have after a rebuild.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn hits_are_those_of_the_tree() {
    let backend = WgpuBackend::new(own_gpu()).expect("a backend");
    let scene = scenes::soup(3_000, 0.4, 12);
    let rays = aim::rays(&scene.mesh(), Kind::Random, 2_000, 13);
    let options = QueryOptions::default();
    let traced = |accelerator: &dyn Accelerator| {
        let mut hits = vec![Hit::MISS; rays.len()];
        accelerator.closest_hits(&rays, &mut hits, &options).expect("hits");
        hits.iter().map(|hit| bytemuck::cast::<_, [u32; 4]>(*hit)).collect::<Vec<_>>()
    };
    let build = BuildOptions::default();
    let mut own = backend.build_accelerator(&scene.mesh(), &build).expect("a tree");
    let cpu = CpuBackend::new().build(&scene.mesh(), &build).expect("a tree");
    let expected = traced(&*cpu);
    assert!(!own.device_tree().is_compressed() && traced(&own) == expected);
    let before = backend.gpu().traffic();
    own.compress_on_device().expect("compressed nodes");
    let traffic = backend.gpu().traffic() - before;
    // Counters, and nothing of the tree.
    assert!(traffic.bytes_down <= 32 * traffic.readbacks && traffic.readbacks <= 3, "{traffic:?}");
    assert!(own.device_tree().is_compressed() && traced(&own) == expected);
    let moved = scenes::soup(3_100, 0.3, 15);
    backend.rebuild_accelerator(&mut own, &moved.mesh(), &build).expect("a tree");
    assert!(own.device_tree().is_compressed());
    let cpu = CpuBackend::new().build(&moved.mesh(), &build).expect("a tree");
    assert_eq!(traced(&own), traced(&*cpu));
}
