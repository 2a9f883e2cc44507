//! Scenes of many objects: every path finds the hits that all instances give, one after the other.

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::ray::{Accuracy, Culling, Ray};
use splitplane_core::scene::{
    InstanceId, Scene, SceneHit, SceneOptions, TopRay, TopStack, TopTree, WIDEST_STACK, WorldBox,
};
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::objects::{self, Kind};

fn built(set: InstructionSet, scene: &Scene) -> Box<dyn SceneAccelerator> {
    let backend = CpuBackend::with_instruction_set(set);
    backend.build_scene(scene, &BuildOptions::default()).expect("a scene")
}

/// Whether there is time for many rays.
fn long() -> bool {
    std::env::var_os("SPLITPLANE_LONG").is_some()
}

/// Each hit as its bits.
fn bits(hits: &[SceneHit]) -> Vec<[u32; 6]> {
    bytemuck::cast_slice(hits).to_vec()
}

/// What the instances give, one after the other.
fn by_all(
    accelerator: &dyn SceneAccelerator,
    rays: &[Ray],
    options: &SceneOptions<'_>,
) -> Vec<SceneHit> {
    rays.iter().map(|ray| accelerator.scene().answer_by_all(ray, options)).collect()
}

fn traced(
    accelerator: &dyn SceneAccelerator,
    rays: &[Ray],
    options: &SceneOptions<'_>,
) -> Vec<SceneHit> {
    let mut hits = vec![SceneHit::MISS; rays.len()];
    accelerator.closest_hits(rays, &mut hits, options).expect("hits");
    hits
}

/// Batches, single rays and any hits against all instances, on every instruction set.
#[test]
fn every_path_finds_what_all_instances_give() {
    let mut found = 0;
    for kind in Kind::ALL {
        let (scene, _) = objects::scene(kind, 70, 11);
        let rays = objects::rays(&scene, if long() { 20_000 } else { 500 }, 12);
        for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
            for culling in [Culling::None, Culling::Back, Culling::Front] {
                let options =
                    &SceneOptions { accuracy, culling, mask: 0x55, ..SceneOptions::default() };
                let mut expected: Option<Vec<SceneHit>> = None;
                for set in InstructionSet::available() {
                    let accelerator = &*built(set, &scene);
                    let expected =
                        expected.get_or_insert_with(|| by_all(accelerator, &rays, options));
                    let hits = traced(accelerator, &rays, options);
                    for ((ray, hit), expected) in rays.iter().zip(&hits).zip(&*expected) {
                        assert_eq!(
                            bits(&[*hit]),
                            bits(&[*expected]),
                            "{kind:?} {accuracy:?} {set:?} {ray:?}: {hit:?} {expected:?}"
                        );
                    }
                    let mut any = vec![false; rays.len()];
                    accelerator.any_hits(&rays, &mut any, options).expect("hits");
                    for ((ray, any), expected) in rays.iter().zip(any).zip(&*expected) {
                        assert_eq!(any, expected.is_hit(), "{kind:?} {accuracy:?} {set:?} {ray:?}");
                        assert_eq!(accelerator.closest_hit(ray, options), expected.some());
                        assert_eq!(accelerator.any_hit(ray, options), any);
                    }
                }
                found += expected.iter().flatten().filter(|hit| hit.is_hit()).count();
            }
        }
    }
    assert!(found > 6_000, "{found}");
}

/// How many hits a tree over boxes does not lead to.
fn lost(rays: &[Ray], hits: &[SceneHit], tree: &TopTree) -> usize {
    let mut lost = 0;
    assert_eq!(rays.len(), hits.len());
    for (ray, hit) in rays.iter().zip(hits).filter(|(_, hit)| hit.is_hit()) {
        let mut stack = [TopStack::default(); WIDEST_STACK];
        let (top_ray, mut top) = (TopRay::new(ray).expect("a ray"), tree.begin(&mut stack));
        let found = core::iter::from_fn(|| tree.next(&top_ray, hit.t, &mut stack, &mut top))
            .any(|instance| instance == hit.instance);
        lost += usize::from(!found);
    }
    lost
}

/// The planted fault: boxes of what the transform makes of the geometry's, without any slack.
#[test]
fn boxes_without_slack_lose_hits() {
    let (mut with, mut without) = (0, 0);
    for kind in [Kind::Ordinary, Kind::IllConditioned, Kind::Far] {
        let (scene, _) = objects::scene(kind, 70, 21);
        let rays = objects::rays(&scene, 8_000, 22);
        let accelerator = &*built(InstructionSet::detect(), &scene);
        let hits = by_all(accelerator, &rays, &SceneOptions::default());
        let boxes: Vec<(u32, WorldBox)> = accelerator
            .scene()
            .placements()
            .filter(|(_, placement)| placement.world_box.is_some())
            .map(|(InstanceId(name), placement)| {
                let (transform, own) = (&placement.instance.transform, placement.bounds);
                let ends = [own.lo, own.hi];
                let mut tight = Aabb::EMPTY;
                for corner in 0..8 {
                    let at = [0, 1, 2].map(|k| f64::from(ends[corner >> k & 1][k]));
                    let at = objects::in_world(transform, at).map(|x| x as f32);
                    tight = tight.union(&Aabb { lo: at, hi: at });
                }
                (name, WorldBox { bounds: tight, reach: 0.0 })
            })
            .collect();
        let tight = TopTree::build(scene.instance_names(), boxes.into_iter()).expect("a tree");
        with += lost(&rays, &hits, accelerator.scene().top_tree());
        without += lost(&rays, &hits, &tight);
    }
    assert_eq!(with, 0);
    assert!(without > 8, "{without}");
}
