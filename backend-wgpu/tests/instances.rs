//! Scenes of many objects on a device: the CPU's hits, bit for bit.

use std::sync::Arc;

use crate::common::own_gpu;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::ray::{Accuracy, Culling, Ray};
use splitplane_core::scene::shape::{OwnShape, ShapeHit, Shapes, Sphere};
use splitplane_core::scene::{
    Instance, InstanceId, OpacityMask, SceneBuildError, SceneHit, SceneOptions, translation,
};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::objects::{self, Kind};
use splitplane_wgpu::WgpuBackend;

/// A set without shapes, by functions.
struct Nothing;

impl OwnShape for Nothing {
    fn primitives(&self) -> u32 {
        0
    }

    fn bounds(&self, _: u32) -> Aabb {
        Aabb::EMPTY
    }

    fn intersect(&self, _: u32, _: &Ray, _: &mut dyn FnMut(ShapeHit)) {}
}

fn answers(
    scene: &dyn SceneAccelerator,
    rays: &[Ray],
    options: &SceneOptions<'_>,
) -> (Vec<[u32; 6]>, Vec<bool>) {
    let mut hits = vec![SceneHit::MISS; rays.len()];
    scene.closest_hits(rays, &mut hits, options).expect("hits");
    let mut any = vec![false; rays.len()];
    scene.any_hits(rays, &mut any, options).expect("hits");
    (bytemuck::cast_slice(&hits).to_vec(), any)
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_device_finds_the_cpus_hits_and_stays_up_to_date() {
    let device = WgpuBackend::new(own_gpu()).expect("a backend");
    let (cpu, build) = (CpuBackend::new(), BuildOptions::default());
    let mut found = 0;
    for kind in [Kind::Ordinary, Kind::IllConditioned, Kind::Coincident] {
        let (mut scene, names) = objects::scene(kind, 40, 71);
        let rays = objects::rays(&scene, 1500, 72);
        let mut own = cpu.build_scene(&scene, &build).expect("a scene");
        let mut there = device.build_scene(&scene, &build).expect("a scene");
        assert_eq!(own.scene().digest(), there.scene().digest());
        for round in 0..2 {
            for (accuracy, culling) in [
                (Accuracy::Watertight, Culling::None),
                (Accuracy::Watertight, Culling::Back),
                (Accuracy::Exact, Culling::None),
            ] {
                let options = SceneOptions { accuracy, culling, ..SceneOptions::default() };
                let expected = answers(&*own, &rays, &options);
                let hits = answers(&*there, &rays, &options);
                for (i, ray) in rays.iter().enumerate() {
                    let what = format!("{kind:?} {round} {accuracy:?} {culling:?} {ray:?}");
                    assert_eq!(hits.0[i], expected.0[i], "{what}");
                    assert_eq!(hits.1[i], expected.1[i], "{what}");
                }
                found += expected.1.iter().filter(|any| **any).count();
            }
            // One moves, one goes.
            scene.move_instance(names[1 + round], translation([0.5, 0.25, -1.0])).unwrap();
            scene.remove_instance(names[10 + round]).unwrap();
            cpu.update_scene(&mut own, &scene, &build).expect("an update");
            let report = device.update_scene(&mut there, &scene, &build).expect("an update");
            assert_eq!((report.geometries_built, report.instances_changed), (0, 2));
            assert_eq!(own.scene().digest(), there.scene().digest());
        }
    }
    assert!(found > 3000, "{found}");

    // Spheres it knows; it calls no functions of the host's.
    let (mut scene, _) = objects::scene(Kind::Ordinary, 10, 74);
    let ball = Sphere { centre: [0.0; 3], radius: 1.5 };
    let balls = scene.add_shapes(Shapes::Spheres(vec![ball])).expect("a geometry");
    scene.add_instance(Instance::new(balls, translation([0.5, 0.0, 0.0]))).expect("an instance");
    let rays = objects::rays(&scene, 500, 75);
    let own = cpu.build_scene(&scene, &build).expect("a scene");
    let mut there = device.build_scene(&scene, &build).expect("a scene");
    let options = SceneOptions::default();
    let expected = answers(&*own, &rays, &options);
    assert_eq!(expected, answers(&*there, &rays, &options));
    assert!(expected.0.iter().filter(|hit| hit[4] == balls.0).count() > 20);
    scene.replace_shapes(balls, Shapes::Own(Arc::new(Nothing))).expect("shapes");
    let refused = device.update_scene(&mut there, &scene, &build);
    let error = SceneBuildError::OwnShapes { geometry: balls.0, backend: "wgpu".to_owned() };
    assert_eq!(refused, Err(error.clone()));
    assert_eq!(device.build_scene(&scene, &build).err(), Some(error));

    // A mask that comes, and goes.
    let (mut scene, names) = objects::scene(Kind::Ordinary, 10, 76);
    let masked = scene.instance(names[0]).expect("an instance").geometry;
    let rays = objects::rays(&scene, 500, 77);
    let mut own = cpu.build_scene(&scene, &build).expect("a scene");
    let mut there = device.build_scene(&scene, &build).expect("a scene");
    let whole = answers(&*own, &rays, &options);
    let triangles = scene.geometry(masked).expect("a geometry").mesh().len();
    let half = OpacityMask::new(triangles, 2, |_, [u, _]| u < 0.4).expect("a mask");
    for mask in [Some(half), None] {
        let is_masked = mask.is_some();
        scene.set_opacity(masked, mask).expect("a mask");
        cpu.update_scene(&mut own, &scene, &build).expect("an update");
        device.update_scene(&mut there, &scene, &build).expect("an update");
        assert_eq!(there.placed_by_cpu(), None);
        let expected = answers(&*own, &rays, &options);
        assert_eq!(expected, answers(&*there, &rays, &options));
        assert_eq!(expected != whole, is_masked);
    }

    // The last bit of one number of one instance is seen in the digest.
    let (scene, names) = objects::scene(Kind::Ordinary, 40, 73);
    let there = device.build_scene(&scene, &build).expect("a scene");
    let (mut other, same) = objects::scene(Kind::Ordinary, 40, 73);
    assert_eq!(names, same);
    let InstanceId(last) = *names.last().expect("an instance");
    let was = *other.instance(InstanceId(last)).expect("an instance");
    let mut becomes = was;
    becomes.transform[0][3] = was.transform[0][3].next_up();
    other.set_instance(InstanceId(last), becomes).expect("an edit");
    let own = cpu.build_scene(&other, &build).expect("a scene");
    assert_ne!(own.scene().digest(), there.scene().digest());
}
