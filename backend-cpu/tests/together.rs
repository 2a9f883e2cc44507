//! Rays that go the same way through scenes, as those of a camera or towards a light: they are answered together, and as they are alone.

use crate::common::{built_by, scene_bits};
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::ray::{Accuracy, Culling, Ray};
use splitplane_core::scene::{Scene, SceneHit, SceneOptions};
use splitplane_cpu::InstructionSet;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;

/// Bundles of 32 rays through a scene, each towards an instance: from one point, or side by side, some with limits; every fifth bundle has a ray that
/// nothing can be said of, or one that goes elsewhere.
fn bundles(scene: &Scene, count: usize, seed: u64) -> Vec<Ray> {
    let single = built_by(InstructionSet::detect(), scene);
    let boxes: Vec<_> =
        single.scene().placements().filter_map(|(_, own)| Some(own.world_box?.bounds)).collect();
    let mut random = Random::new(seed);
    let mut rays = Vec::new();
    for bundle in 0..count {
        let bounds = random.pick(&boxes);
        let middle = [0, 1, 2].map(|k| 0.5 * bounds.lo[k] + 0.5 * bounds.hi[k]);
        let half = [0, 1, 2].map(|k| bounds.hi[k] - middle[k]);
        let size = half.iter().fold(0.0f32, |most, x| most.max(*x));
        let away = [(); 3].map(|()| random.between(-1.0, 1.0) as f32);
        let far = size * random.pick(&[0.5, 2.0, 4.0, 20.0]);
        let eye = [0, 1, 2].map(|k| middle[k] + far * away[k]);
        let side_by_side = bundle % 3 == 0;
        for lane in 0..32 {
            let off = [(); 3].map(|()| random.between(-0.5, 0.5) as f32 * size);
            let to = [0, 1, 2].map(|k| middle[k] + off[k]);
            let mut origin = eye;
            if side_by_side {
                origin = [0, 1, 2].map(|k| eye[k] + off[k]);
            }
            let mut ray = Ray::new(origin, [0, 1, 2].map(|k| to[k] - origin[k]));
            if bundle % 4 == 1 {
                ray = ray.with_limits(0.25, random.between(0.5, 1.5) as f32);
            }
            if bundle % 5 == 4 && lane == 17 {
                ray = random.pick(&[
                    Ray::new(origin, [0.0; 3]),
                    Ray::new([f32::NAN; 3], [1.0; 3]),
                    Ray::new(origin, [0, 1, 2].map(|k| origin[k] - to[k])),
                    ray.with_limits(2.0, 1.0),
                    Ray::new(origin, [1e-42, 1e30, -1e30]),
                ]);
            }
            rays.push(ray);
        }
    }
    rays
}

/// Closest and any hits of all rays against all instances, one after the other, on every instruction set.
fn compare(scene: &Scene, rays: &[Ray], what: &str) -> usize {
    let mut found = 0;
    for culling in [Culling::None, Culling::Back] {
        let accuracy = Accuracy::Watertight;
        let options = &SceneOptions { accuracy, culling, mask: 0x55, ..SceneOptions::default() };
        for set in InstructionSet::available() {
            let accelerator = &*built_by(set, scene);
            let expected: Vec<SceneHit> =
                rays.iter().map(|ray| accelerator.scene().answer_by_all(ray, options)).collect();
            let mut hits = vec![SceneHit::MISS; rays.len()];
            accelerator.closest_hits(rays, &mut hits, options).expect("hits");
            let mut any = vec![false; rays.len()];
            accelerator.any_hits(rays, &mut any, options).expect("answers");
            for (place, (hit, expected)) in hits.iter().zip(&expected).enumerate() {
                let ray = &rays[place];
                assert_eq!(
                    scene_bits(&[*hit]),
                    scene_bits(&[*expected]),
                    "{what} {set:?} {place} {ray:?}: {hit:?} {expected:?}"
                );
                assert_eq!(any[place], expected.is_hit(), "{what} {set:?} {place} {ray:?}");
                found += usize::from(hit.is_hit());
            }
        }
    }
    found
}

#[test]
fn rays_that_go_the_same_way_hit_what_they_hit_alone() {
    let mut found = 0;
    for (seed, kind) in Kind::ALL.into_iter().enumerate() {
        let (scene, _) = objects::scene(kind, 60, 31 + seed as u64);
        let rays = bundles(&scene, 40, 71 + seed as u64);
        found += compare(&scene, &rays, &format!("{kind:?}"));
    }
    assert!(found > 3_000, "{found}");
}
