//! Scenes of many objects against one mesh of everything, and against what transforms make of triangles in `f64`.

use crate::common::{built, coarse, long};
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::scene::{SceneAccelerator, SceneAllHitsOptions};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::all_hits::AllHitsOptions;
use splitplane_core::query::inside::LocateOptions;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::scene::{
    GeometryId, IDENTITY, IgnoredTriangle, Instance, InstanceId, Scene, SceneHit, SceneOptions,
    Transform, WorldBox, translation,
};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;

fn baked(triangles: &[[[f32; 3]; 3]]) -> Box<dyn Accelerator> {
    let mesh = Mesh::soup(triangles).expect("a mesh");
    CpuBackend::new().build(&mesh, &BuildOptions::default()).expect("a tree")
}

fn coarse_rays(count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    let mut point = |reach| random.point(reach).map(|x| (x * 256.0).round() / 256.0);
    (0..count)
        .map(|_| {
            let (from, to) = (point(12.0), point(6.0));
            Ray::segment(from, to).with_limits(0.0, f32::INFINITY)
        })
        .filter(|ray| ray.direction != [0.0; 3])
        .collect()
}

/// Transforms that move by exact amounts, the identity first; some mirrored.
fn exact_transforms() -> Vec<Transform> {
    let mut all = vec![IDENTITY];
    for by in [[4.0, 0.0, 0.0], [0.0, -2.0, 0.5], [-4.0, 4.0, 0.25], [0.0, 0.0, -8.0]] {
        all.push(translation(by));
        let mut mirrored = translation(by.map(|x: f32| x * -0.5));
        mirrored[0][0] = -1.0;
        all.push(mirrored);
    }
    all
}

/// Scene and one mesh, triangle `i` of instance `n` being triangle `n * count + i` of it; mirrored instances wound as
/// their images are.
fn exact_scene() -> (Scene, Vec<[[f32; 3]; 3]>, usize) {
    let triangles = coarse();
    let mut scene = Scene::new();
    let ball = scene.add_mesh(&Mesh::soup(&triangles).unwrap()).unwrap();
    for transform in exact_transforms() {
        scene.add_instance(Instance::new(ball, transform)).unwrap();
    }
    let all = objects::baked(&scene);
    (scene, all, triangles.len())
}

fn as_hit(hit: &SceneHit, count: usize) -> [u32; 4] {
    let triangle = match hit.some() {
        Some(hit) => hit.instance * count as u32 + hit.triangle,
        None => u32::MAX,
    };
    [hit.t.to_bits(), triangle, hit.u.to_bits(), hit.v.to_bits()]
}

#[test]
fn exact_transforms_give_a_baked_meshs_hits_bit_for_bit() {
    let (scene, triangles, count) = exact_scene();
    let (accelerator, mesh) = (built(&scene), baked(&triangles));
    let rays = coarse_rays(20_000, 3);
    let mut found = 0;
    for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
        for culling in [Culling::None, Culling::Back, Culling::Front] {
            let options = SceneOptions { accuracy, culling, ..SceneOptions::default() };
            let mut hits = vec![SceneHit::MISS; rays.len()];
            let report = accelerator.closest_hits(&rays, &mut hits, &options).unwrap();
            assert!(report.entered > 0 && report.placed_by_cpu == 0);
            // Exact answers are found in waves.
            assert_eq!(report.batches > 0, accuracy == Accuracy::Exact);
            let mut expected = vec![Hit::MISS; rays.len()];
            let options = QueryOptions { accuracy, culling, ..QueryOptions::default() };
            mesh.closest_hits(&rays, &mut expected, &options).unwrap();
            for ((ray, hit), expected) in rays.iter().zip(&hits).zip(&expected) {
                let Hit { t, triangle, u, v } = *expected;
                let expected = [t.to_bits(), triangle, u.to_bits(), v.to_bits()];
                assert_eq!(as_hit(hit, count), expected, "{accuracy:?} {culling:?} {ray:?}");
                found += usize::from(hit.is_hit());
            }
        }
    }
    assert!(found > 20_000, "{found}");
}

#[test]
fn all_crossings_and_windings_are_a_baked_meshs() {
    let (scene, triangles, count) = exact_scene();
    let (accelerator, mesh) = (built(&scene), baked(&triangles));
    let rays = coarse_rays(3000, 4);
    let all = accelerator.all_hits(&rays, &SceneAllHitsOptions::default()).unwrap();
    let expected = mesh.all_hits(&rays, &AllHitsOptions::default()).unwrap();
    for ray in 0..rays.len() {
        let own: Vec<_> = all.of(ray).iter().map(|c| (as_hit(&c.hit, count), c.front)).collect();
        let hit = |hit: &Hit| [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()];
        let mut baked: Vec<_> = expected.of(ray).iter().map(|c| (hit(&c.hit), c.front)).collect();
        // The mesh orders equal rounded distances by exact ones.
        baked.sort_by(|a, b| {
            f32::from_bits(a.0[0]).total_cmp(&f32::from_bits(b.0[0])).then(a.0[1].cmp(&b.0[1]))
        });
        assert_eq!(own, baked, "{:?}", rays[ray]);
    }
    assert!(all.crossings.len() > 1000);
    let mut random = Random::new(5);
    let points: Vec<[f32; 3]> =
        (0..4000).map(|_| random.point(6.0).map(|x| (x * 64.0).round() / 64.0)).collect();
    let own = accelerator.locate(&points, &LocateOptions::default()).unwrap();
    let expected = mesh.locate(&points, &LocateOptions::default()).unwrap();
    assert_eq!(own.windings, expected.windings);
    let inside = own.windings.iter().filter(|winding| !matches!(winding, Some(0))).count();
    assert!(inside > 30, "{inside}");
    // A limit that binds is an error.
    let limited = SceneAllHitsOptions { max_memory: Some(30_000), ..Default::default() };
    assert!(accelerator.all_hits(&rays, &limited).is_err());
}

fn distance_to(p: [f64; 3], triangle: &[[f64; 3]; 3]) -> f64 {
    let minus = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let [a, b, c] = *triangle;
    let (ab, ac, ap) = (minus(b, a), minus(c, a), minus(p, a));
    let (aa, bb, cc) = (dot(ab, ab), dot(ab, ac), dot(ac, ac));
    let (d, e) = (dot(ap, ab), dot(ap, ac));
    let det = aa * cc - bb * bb;
    let to = |q: [f64; 3]| dot(minus(p, q), minus(p, q)).sqrt();
    let mut least = f64::INFINITY;
    if det > 0.0 {
        let (v, w) = ((cc * d - bb * e) / det, (aa * e - bb * d) / det);
        if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
            least = to([0, 1, 2].map(|k| a[k] + v * ab[k] + w * ac[k]));
        }
    }
    for (from, other) in [(a, b), (b, c), (c, a)] {
        let edge = minus(other, from);
        let length = dot(edge, edge);
        let along =
            if length > 0.0 { (dot(minus(p, from), edge) / length).clamp(0.0, 1.0) } else { 0.0 };
        least = least.min(to([0, 1, 2].map(|k| from[k] + along * edge[k])));
    }
    least
}

/// Every hit is as near to what the transform makes of its triangle, in `f64`, as the instance's box is wide by.
#[test]
fn hits_are_within_the_derived_bound() {
    let (mut found, mut rays_in_all) = (0, 0);
    let mut greatest = 0.0f64;
    for (round, kind) in
        [Kind::Ordinary, Kind::IllConditioned, Kind::Far, Kind::Scales, Kind::Coincident]
            .into_iter()
            .enumerate()
    {
        let (scene, _) = objects::scene(kind, 60, 40 + round as u64);
        let rays =
            objects::rays(&scene, if long() { 2_000_000 } else { 20_000 }, 50 + round as u64);
        rays_in_all += rays.len();
        let accelerator = built(&scene);
        let mut hits = vec![SceneHit::MISS; rays.len()];
        accelerator.closest_hits(&rays, &mut hits, &SceneOptions::default()).unwrap();
        for (ray, hit) in rays.iter().zip(&hits).filter(|(_, hit)| hit.is_hit()) {
            let placement = accelerator.scene().placement(InstanceId(hit.instance)).unwrap();
            let transform = &placement.instance.transform;
            let mesh = scene.geometry(GeometryId(hit.geometry)).unwrap();
            let corners = mesh.mesh().triangle(hit.triangle as usize);
            let triangle = corners.map(|p| objects::in_world(transform, p.map(f64::from)));
            let at = [0, 1, 2]
                .map(|k| f64::from(ray.origin[k]) + f64::from(hit.t) * f64::from(ray.direction[k]));
            // The box of the turned box is wider than that by the bound.
            let world_box =
                WorldBox::new(transform, &placement.space, &placement.bounds, None).unwrap();
            let mut tight = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
            for corner in 0..8 {
                let own = [placement.bounds.lo, placement.bounds.hi];
                let p = [0, 1, 2].map(|k| f64::from(own[corner >> k & 1][k]));
                for (k, x) in objects::in_world(transform, p).into_iter().enumerate() {
                    tight[0][k] = tight[0][k].min(x);
                    tight[1][k] = tight[1][k].max(x);
                }
            }
            let Aabb { lo, hi } = world_box.bounds;
            let out = (0..3)
                .map(|k| (tight[0][k] - f64::from(lo[k])).max(f64::from(hi[k]) - tight[1][k]))
                .fold(0.0, f64::max);
            let from = ray.origin.iter().fold(0.0, |m: f64, &x| m.max(f64::from(x).abs()));
            let length = ray.direction.iter().map(|&d| f64::from(d).powi(2)).sum::<f64>().sqrt();
            let along = f64::from(hit.t).abs() * length / 8192.0;
            // On each of three axes.
            let bound = 3f64.sqrt() * (out + f64::from(world_box.reach) * from) + along;
            let distance = distance_to(at, &triangle);
            assert!(distance <= bound, "{kind:?}: {distance} {bound} {ray:?} {hit:?}");
            greatest = greatest.max(distance / bound);
            found += 1;
        }
    }
    assert!(rays_in_all >= 100_000 && found > 20_000, "{found}");
    // The bound is not vain.
    assert!(greatest > 0.01, "{greatest}");
}

/// Ordinary transforms: nearly every ray sees what it sees of a mesh of everything.
#[test]
fn ordinary_scenes_look_like_a_baked_mesh() {
    let (scene, _) = objects::scene(Kind::Ordinary, 60, 31);
    let everywhere: Vec<InstanceId> = scene.instances().map(|(name, _)| name).collect();
    let mut scene = scene;
    for name in everywhere {
        let instance = *scene.instance(name).unwrap();
        let plain = Instance { mask: u32::MAX, culling: Culling::None, ..instance };
        scene.set_instance(name, plain).unwrap();
    }
    let rays = coarse_rays(100_000, 32);
    let (accelerator, mesh) = (built(&scene), baked(&objects::baked(&scene)));
    let mut hits = vec![SceneHit::MISS; rays.len()];
    accelerator.closest_hits(&rays, &mut hits, &SceneOptions::default()).unwrap();
    let mut expected = vec![Hit::MISS; rays.len()];
    mesh.closest_hits(&rays, &mut expected, &QueryOptions::default()).unwrap();
    let same = |(hit, expected): &(&SceneHit, &Hit)| {
        hit.is_hit() == expected.is_hit()
            && (!hit.is_hit() || (hit.t - expected.t).abs() <= 1e-3 * expected.t.abs() + 1e-5)
    };
    let differ = hits.iter().zip(&expected).filter(|pair| !same(pair)).count();
    // Rays along silhouettes.
    let found = hits.iter().filter(|hit| hit.is_hit()).count();
    assert!(found > 30_000, "{found}");
    assert!(differ < 50, "{differ} of {}", rays.len());
}

/// A filter by triangle against meshes without those triangles; masks and ignored triangles against scenes without them.
#[test]
fn filters_masks_and_ignored_triangles_count_as_not_there() {
    let seed = 61;
    let (scene, names) = objects::scene(Kind::Ordinary, 50, seed);
    let accelerator = built(&scene);
    let rays = objects::rays(&scene, 4000, 62);
    let (mut without, other) = objects::scene(Kind::Ordinary, 50, seed);
    assert_eq!(names, other);
    let meshes: Vec<_> = without.geometries().map(|(name, mesh)| (name, mesh.clone())).collect();
    for (name, mesh) in meshes {
        let mesh = mesh.mesh();
        let kept = |i: usize| if i.is_multiple_of(3) { [[0.0; 3]; 3] } else { mesh.triangle(i) };
        let triangles: Vec<_> = (0..mesh.len()).map(kept).collect();
        without.replace_mesh(name, &Mesh::soup(&triangles).unwrap()).unwrap();
    }
    let without = built(&without);
    let keeps = |hit: &SceneHit| !hit.triangle.is_multiple_of(3);
    for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
        let options = SceneOptions { accuracy, filter: Some(&keeps), ..SceneOptions::default() };
        let plain = SceneOptions { filter: None, ..options };
        let mut differ = 0;
        let (mut hits, mut expected) = (vec![SceneHit::MISS; 4000], vec![SceneHit::MISS; 4000]);
        let report = accelerator.closest_hits(&rays, &mut hits, &options).unwrap();
        without.closest_hits(&rays, &mut expected, &plain).unwrap();
        for ((ray, hit), expected) in rays.iter().zip(&hits).zip(&expected) {
            // Meshes without some triangles have other bounds, to which far rays are moved: exactly the same only where
            // that does not matter.
            let near = (hit.t - expected.t).abs() <= 1e-4 * hit.t.abs() + 1e-4;
            let same = (hit.instance, hit.triangle) == (expected.instance, expected.triangle);
            assert!(hit == expected || accuracy != Accuracy::Exact, "{ray:?} {hit:?} {expected:?}");
            differ += usize::from(!(hit == expected || same && near));
        }
        assert!(differ < 20, "{differ}");
        assert!(report.rejected > 500, "{}", report.rejected);
        let mut any = vec![false; rays.len()];
        accelerator.any_hits(&rays, &mut any, &options).unwrap();
        for ((ray, any), hit) in rays.iter().zip(any).zip(&hits) {
            assert_eq!(any, hit.is_hit());
            assert_eq!(accelerator.closest_hit(ray, &options), hit.some());
            assert_eq!(accelerator.any_hit(ray, &options), any);
        }
    }

    // The first triangle that is hit, ignored: as if a filter rejected it.
    let mut ignored = 0;
    for ray in &rays[..300] {
        let Some(first) = accelerator.closest_hit(ray, &SceneOptions::default()) else { continue };
        let instance = InstanceId(first.instance);
        let ignore = Some(IgnoredTriangle { instance, triangle: first.triangle });
        let options = SceneOptions { ignore, ..SceneOptions::default() };
        let keeps =
            |hit: &SceneHit| (hit.instance, hit.triangle) != (first.instance, first.triangle);
        let filtered = SceneOptions { filter: Some(&keeps), ..SceneOptions::default() };
        let mut hit = [SceneHit::MISS];
        accelerator.closest_hits(&[*ray], &mut hit, &options).unwrap();
        assert_eq!(hit[0].some(), accelerator.closest_hit(ray, &filtered));
        ignored += 1;
    }
    assert!(ignored > 100, "{ignored}");

    // Instances that a mask leaves out are as if they were not there.
    let (mut few, names) = objects::scene(Kind::Ordinary, 50, seed);
    let mut masked = objects::scene(Kind::Ordinary, 50, seed).0;
    for (at, name) in names.into_iter().enumerate() {
        let plain = Instance { mask: 1 << (at % 2), ..*few.instance(name).unwrap() };
        masked.set_instance(name, plain).unwrap();
        if at % 2 == 0 {
            few.remove_instance(name).unwrap();
        } else {
            few.set_instance(name, plain).unwrap();
        }
    }
    let (few, masked) = (built(&few), built(&masked));
    let (mut hits, mut expected) = (vec![SceneHit::MISS; 4000], vec![SceneHit::MISS; 4000]);
    let options = SceneOptions { mask: 2, ..SceneOptions::default() };
    masked.closest_hits(&rays, &mut hits, &options).unwrap();
    few.closest_hits(&rays, &mut expected, &SceneOptions::default()).unwrap();
    assert_eq!(hits, expected);
}
