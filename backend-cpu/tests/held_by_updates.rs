//! What an update says it holds, against what the allocator says.

use std::collections::VecDeque;

use crate::counting::{allocated, alone, growth, pool};
use splitplane_core::backend::scene::{BuiltScene, bytes_of};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::{GeometryId, Instance, OpacityMask, Scene, translation};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::scenes;

/// What no scene counts: lists of what changes, and the records of geometries.
const SMALL: u64 = 8 << 10;

/// Bytes that an update to this scene says it holds beyond those of the scene before, once all that can fail is done, and those that the allocator counts. To
/// these are added the trees, which are built before, and opacity masks, which the description has.
fn told_and_counted(built: &mut BuiltScene, scene: &Scene, masks: usize) -> (u64, u64) {
    let (cpu, options) = (CpuBackend::new(), BuildOptions::default());
    let unbuilt = built.unbuilt(scene).expect("names");
    let build = |(_, mesh): (_, &std::sync::Arc<splitplane_core::scene::GeometryMesh>)| {
        cpu.build(&mesh.mesh(), &options).expect("a tree")
    };
    let mut trees: VecDeque<_> = unbuilt.map(build).collect();
    let there = trees.iter().map(|tree| bytes_of(&**tree)).sum::<u64>() + masks as u64;
    let (mut told, mut counted, was) = (0, 0, built.bytes());
    let mut next = |_: &Mesh<'_>, _: &BuildOptions<'_>| Ok(trees.pop_front().expect("a tree"));
    allocated(|| {
        let updated = built.update_after(scene, &options, &mut next, &mut |becoming| {
            (told, counted) = (becoming.held - was, growth());
            Ok(())
        });
        updated.expect("an update");
    });
    (told, counted.cast_unsigned() + there)
}

/// A mesh with so many instances.
fn add(scene: &mut Scene, triangles: usize, instances: usize) -> GeometryId {
    let name = scene.add_mesh(&scenes::soup(triangles, 0.1, 3).mesh()).unwrap();
    for number in 0..instances {
        let place = translation([number as f32, triangles as f32, 0.0]);
        scene.add_instance(Instance::new(name, place)).unwrap();
    }
    name
}

#[test]
fn updates_hold_what_they_say() {
    let _alone = alone();
    pool(1).install(all_kinds_of_updates);
}

fn all_kinds_of_updates() {
    let mut scene = Scene::new();
    let (still, moves) = (add(&mut scene, 300, 3_000), add(&mut scene, 500, 3_000));
    let mut built = BuiltScene::default();
    // What a thread allocates once is there before anything is counted.
    told_and_counted(&mut BuiltScene::default(), &scene, 0);
    let mut check = |what: &str, scene: &Scene, masks: usize, least: u64| {
        let (told, counted) = told_and_counted(&mut built, scene, masks);
        assert!(told <= counted && counted <= told + SMALL, "{what}: {told} {counted}");
        assert!(told >= least, "{what}: {told}");
    };
    check("all is new", &scene, 0, 2 << 20);
    check("nothing changes", &scene, 0, 0);
    let names: Vec<_> = scene.instances().map(|(name, _)| name).collect();
    for (number, &name) in names.iter().enumerate().step_by(2) {
        scene.move_instance(name, translation([number as f32, 0.0, 5.0])).unwrap();
    }
    check("placements", &scene, 0, 3_000 * 100);
    let mask = OpacityMask::new(300, 5, |triangle, _| triangle % 2 == 0).unwrap();
    let bytes = size_of_val(mask.words());
    scene.set_opacity(still, Some(mask)).unwrap();
    check("a mask", &scene, bytes, 30_000);
    scene.replace_mesh(moves, &scenes::soup(4_000, 0.1, 9).mesh()).unwrap();
    check("a mesh", &scene, 0, 100_000);
    scene.remove_instance(names[17]).unwrap();
    check("the tree over instances", &scene, 0, 100_000);
    add(&mut scene, 700, 5_000);
    check("more of everything", &scene, 0, 2 << 20);
}
