//! Updates of scenes on a device within a limit of memory: room to spare is given up before the scene leaves the device.

use crate::common;
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::{GeometryId, Instance, Scene, SceneHit, SceneOptions, translation};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::{objects, scenes};
use splitplane_wgpu::query::WgpuScene;
use splitplane_wgpu::{Gpu, WgpuBackend};

/// Instances that come in the update: so many that what they take decides, too few for a look at the limit while they are placed.
const COMING: usize = 400;

/// Bytes of the buffer for shapes, of which there are none.
const EMPTY: u64 = 16;

fn add(scene: &mut Scene, triangles: usize, instances: usize, seed: u64) -> GeometryId {
    let mesh = scenes::soup(triangles, 0.2, seed);
    let name = scene.add_mesh(&mesh.mesh()).expect("a geometry");
    for number in 0..instances {
        let place = translation([number as f32 * 0.25, seed as f32, 0.0]);
        scene.add_instance(Instance::new(name, place)).expect("an instance");
    }
    name
}

/// Brings it up to date with geometries that the CPU builds. Whether the limit let it.
fn update(built: &mut WgpuScene, scene: &Scene, max_memory: Option<u64>) -> bool {
    let cpu = CpuBackend::new();
    let options = BuildOptions { max_memory, ..BuildOptions::default() };
    let mut build =
        |mesh: &Mesh<'_>, options: &BuildOptions<'_>| Backend::build(&cpu, mesh, options);
    built.update_by(scene, &options, &mut build).is_ok()
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_scene_that_grows_stays_on_the_device_where_the_limit_has_room_for_it() {
    stays_where_the_limit_has_room(false);
}

/// There the room to spare is that of a geometry that went: it is given up by sending all.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_scene_with_a_hole_stays_on_the_device_where_the_limit_has_room_for_it() {
    stays_where_the_limit_has_room(true);
}

fn stays_where_the_limit_has_room(hole: bool) {
    let device = WgpuBackend::without_selftest(Gpu::clone(&common::gpu()));
    let mut new = Scene::new();
    let names: Vec<_> = (1..6).map(|seed| add(&mut new, 2000, 1, seed)).collect();
    let begin = || {
        let mut built = device.build_wgpu_scene(&Scene::new(), &BuildOptions::default()).unwrap();
        assert!(update(&mut built, &new, None));
        built
    };
    let mut started: Vec<WgpuScene> = (0..41).map(|_| begin()).collect();
    if hole {
        let instance = new.instances().find(|(_, own)| own.geometry == names[2]);
        new.remove_instance(instance.expect("an instance").0).expect("an instance");
        new.remove_geometry(names[2]).expect("a geometry");
        assert!(started.iter_mut().all(|built| update(built, &new, None)));
    }
    assert!(started.iter().all(|built| built.placed_by_cpu().is_none()));
    let mut most = started.pop().expect("a scene");
    let old_on_device = most.bytes_on_device();
    // Without a limit, there is room to spare.
    add(&mut new, 100, COMING, 9);
    assert!(update(&mut most, &new, None));
    let exact: u64 = most.scene().packed_sizes().bytes().iter().sum();
    let (bytes, spare) = (most.scene().bytes(), most.bytes_on_device() - exact);
    assert!(spare > exact / 8, "{exact} {spare}");
    let rays = objects::rays(&new, 500, 3);
    let options = SceneOptions::default();
    let mut expected = vec![SceneHit::MISS; rays.len()];
    let cpu = CpuBackend::new().build_scene(&new, &BuildOptions::default()).expect("a scene");
    cpu.closest_hits(&rays, &mut expected, &options).expect("hits");
    // From what the scene takes at least, to what it takes with room to spare beside the old one. Counted are updates that were refused, scenes on the CPU, and those
    // on the device without all of the room to spare and with it.
    let (from, to) = (bytes + exact - spare, bytes + exact + 2 * spare + old_on_device);
    let mut seen = [0; 4];
    let count = started.len() as u64;
    for (step, built) in (0..).zip(&mut started) {
        let limit = from + step * (to - from) / count;
        if !update(built, &new, Some(limit)) {
            seen[0] += 1;
            continue;
        }
        let on_device = built.bytes_on_device();
        if let Some(reason) = built.placed_by_cpu() {
            seen[1] += 1;
            let needed = bytes + exact + EMPTY;
            assert!(limit < needed, "{limit} is enough for {needed}: {reason}");
            continue;
        }
        assert!(bytes + on_device <= limit, "{bytes} + {on_device} > {limit}");
        seen[if on_device < exact + spare { 2 } else { 3 }] += 1;
        let mut hits = vec![SceneHit::MISS; rays.len()];
        built.closest_hits(&rays, &mut hits, &options).expect("hits");
        let words = |hits: &[SceneHit]| bytemuck::cast_slice::<_, u8>(hits).to_vec();
        assert_eq!(words(&hits), words(&expected), "{limit}");
    }
    assert!(seen[1..].iter().all(|&times| times > 0), "{seen:?}");
}
