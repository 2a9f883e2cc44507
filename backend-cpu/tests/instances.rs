//! Scenes of many objects: every path finds the hits that all instances give, one after the other.

use crate::common::{built_by, long, scene_bits};
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::ray::{Accuracy, Culling, Ray};
use splitplane_core::scene::{
    InstanceId, Scene, SceneHit, SceneOptions, TopRay, TopStack, TopTree, WIDEST_STACK, WorldBox,
};
use splitplane_cpu::InstructionSet;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;

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
                    let accelerator = &*built_by(set, &scene);
                    let expected =
                        expected.get_or_insert_with(|| by_all(accelerator, &rays, options));
                    let hits = traced(accelerator, &rays, options);
                    for ((ray, hit), expected) in rays.iter().zip(&hits).zip(&*expected) {
                        assert_eq!(
                            scene_bits(&[*hit]),
                            scene_bits(&[*expected]),
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

/// Rays through the corners of each instance's triangles that reach farthest along an axis, in the plane that the instance's box has there, or nearly.
fn grazing(scene: &Scene, accelerator: &dyn SceneAccelerator, random: &mut Random) -> Vec<Ray> {
    let mut rays = Vec::new();
    for (_, placement) in accelerator.scene().placements() {
        let Ok(mesh) = scene.geometry(placement.instance.geometry) else { continue };
        let arrays = mesh.mesh();
        let transform = &placement.instance.transform;
        let corners: Vec<[f64; 3]> = (0..arrays.len())
            .flat_map(|triangle| arrays.triangle(triangle))
            .map(|corner| objects::in_world(transform, corner.map(f64::from)))
            .collect();
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let by =
                    |a: &&[f64; 3], b: &&[f64; 3]| (sign * a[axis]).total_cmp(&(sign * b[axis]));
                let Some(farthest) = corners.iter().max_by(by) else { continue };
                let mut direction = random.direction();
                direction[axis] = 0.0;
                let length = random.between(0.5, 20.0);
                let origin = [0, 1, 2].map(|k| (farthest[k] - length * direction[k]) as f32);
                let mut direction = direction.map(|x| x as f32);
                if random.below(2) == 0 {
                    direction[axis] = random.between(-1e-6, 1e-6) as f32;
                }
                rays.push(Ray::new(origin, direction));
            }
        }
    }
    rays
}

/// Rays in the planes of boxes, which are those of what the geometry's cells hold, through turned, thin, huge and nearly singular instances: batches find what all instances
/// give, on every instruction set, and no hit is outside of a box.
#[test]
fn rays_in_the_planes_of_boxes_find_what_all_instances_give() {
    let (mut found, mut random) = (0, Random::new(31));
    for kind in Kind::ALL {
        let (scene, _) = objects::scene(kind, 70, 32);
        let of_any_set = &*built_by(InstructionSet::detect(), &scene);
        let mut rays: Vec<Ray> =
            (0..4).flat_map(|_| grazing(&scene, of_any_set, &mut random)).collect();
        // Some go the same way as their neighbours, and are followed together.
        for chunk in rays.chunks_exact_mut(32).step_by(2) {
            let first = chunk[0];
            for (number, ray) in chunk.iter_mut().enumerate().filter(|(number, _)| number % 3 != 0)
            {
                *ray = first;
                ray.origin[number % 2] = ray.origin[number % 2].next_up();
            }
        }
        let options = &SceneOptions::default();
        let expected = by_all(of_any_set, &rays, options);
        assert_eq!(lost(&rays, &expected, of_any_set.scene().top_tree()), 0, "{kind:?}");
        found += expected.iter().filter(|hit| hit.is_hit()).count();
        for set in InstructionSet::available() {
            let accelerator = &*built_by(set, &scene);
            assert_eq!(
                scene_bits(&traced(accelerator, &rays, options)),
                scene_bits(&expected),
                "{kind:?}"
            );
            let mut any = vec![false; rays.len()];
            accelerator.any_hits(&rays, &mut any, options).expect("hits");
            for (any, expected) in any.iter().zip(&expected) {
                assert_eq!(*any, expected.is_hit(), "{kind:?} {set:?}");
            }
        }
    }
    assert!(found > 1000, "{found}");
}

/// The planted fault: boxes that are smaller by a thousandth lose hits of such rays.
#[test]
fn smaller_boxes_lose_rays_in_their_planes() {
    let (scene, _) = objects::scene(Kind::Ordinary, 70, 32);
    let accelerator = &*built_by(InstructionSet::detect(), &scene);
    let rays = grazing(&scene, accelerator, &mut Random::new(33));
    let hits = by_all(accelerator, &rays, &SceneOptions::default());
    let boxes: Vec<(u32, WorldBox)> = accelerator
        .scene()
        .placements()
        .filter_map(|(InstanceId(name), placement)| Some((name, placement.world_box?)))
        .map(|(name, mut own)| {
            for axis in 0..3 {
                let step = 1e-3 * (own.bounds.hi[axis] - own.bounds.lo[axis]);
                own.bounds.lo[axis] += step;
                own.bounds.hi[axis] -= step;
            }
            (name, own)
        })
        .collect();
    let smaller = TopTree::build(scene.instance_names(), boxes.into_iter()).expect("a tree");
    assert_eq!(lost(&rays, &hits, accelerator.scene().top_tree()), 0);
    let lost = lost(&rays, &hits, &smaller);
    assert!(lost > 8, "{lost}");
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
        let accelerator = &*built_by(InstructionSet::detect(), &scene);
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
