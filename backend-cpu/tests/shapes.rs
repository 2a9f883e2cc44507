//! Spheres, capsules and own shapes in scenes, held to arithmetic in `f64`, to closed forms and to all primitives one after the other.

use std::sync::Arc;

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::{Hostile, Strict};
use splitplane_core::backend::scene::{
    SceneAccelerator, SceneAllHitsOptions, SceneClosestPoint, SceneClosestPointOptions,
    SceneWriteError, write_file,
};
use splitplane_core::backend::{Backend, BuildOptions, LoadOptions};
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::inside::LocateOptions;
use splitplane_core::ray::{Culling, Ray};
use splitplane_core::scene::file::SceneFile;
use splitplane_core::scene::shape::{Capsule, OwnShape, ShapeHit, ShapeRay, Shapes, Sphere};
use splitplane_core::scene::{
    IDENTITY, Instance, InstanceId, OpacityMask, Scene, SceneError, SceneHit, SceneOptions, TopRay,
    TopStack, TopTree, WIDEST_STACK, WorldBox, translation,
};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;

/// How far a place on a ray is outside of a capsule, in `f64`.
fn outside(capsule: &Capsule, ray: &Ray, t: f64) -> f64 {
    let p = [0, 1, 2].map(|k| f64::from(ray.origin[k]) + t * f64::from(ray.direction[k]));
    let [a, b] = capsule.ends.map(|end| end.map(f64::from));
    let minus = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|k| a[k] - b[k]);
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
    let (along, from) = (minus(b, a), minus(p, a));
    let part = (dot(along, from) / dot(along, along).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    let away = minus(from, along.map(|x| x * part));
    dot(away, away).sqrt() - f64::from(capsule.radius)
}

/// The least distance of the line from the axis less the radius, by golden section: the distance is convex.
fn nearest(capsule: &Capsule, ray: &Ray) -> f64 {
    let d = ray.direction.map(f64::from);
    let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
    let reach = [0, 1, 2].map(|k| {
        let own = capsule.ends.map(|end| f64::from(end[k]) - f64::from(ray.origin[k]));
        own[0].abs().max(own[1].abs())
    });
    let most = 2.0 * (reach[0] + reach[1] + reach[2]) / length + 1e-300;
    let (mut lo, mut hi) = (-most, most);
    for _ in 0..200 {
        let (one, other) = (lo + 0.381_966 * (hi - lo), lo + 0.618_034 * (hi - lo));
        if outside(capsule, ray, one) < outside(capsule, ray, other) {
            hi = other;
        } else {
            lo = one;
        }
    }
    outside(capsule, ray, 0.5 * (lo + hi))
}

/// Hits lie on the surface and misses miss it, to within the bound that is derived; what moves a radius by far less is noticed.
#[test]
fn spans_are_within_their_bound() {
    const U: f64 = 1.0 / (1u64 << 24) as f64;
    let mut random = Random::new(5);
    let (mut hits, mut misses, mut worst, mut planted) = (0, 0, [0.0f64; 2], 0);
    for round in 0..60_000 {
        let size = 10f64.powf(random.between(-3.0, 3.0)) as f32;
        let reach = size * random.pick(&[0.0, 1.0, 30.0]);
        let centre = random.point(reach);
        let is_sphere = round % 2 == 0;
        let reach = size * random.pick(&[0.0, 1e-4, 1.0, 10.0]);
        let along = if is_sphere { [0.0; 3] } else { random.point(reach) };
        let radius = size * 10f64.powf(random.between(-2.0, 1.0)) as f32;
        let ends = [centre, [0, 1, 2].map(|k| centre[k] + along[k])];
        let capsule = Capsule { ends, radius };
        // At a place near the surface: through it, grazing it, from inside, along the axis.
        let outwards = random.direction().map(|x| x as f32 * radius);
        let graze = random.pick(&[0.0, 0.5, 0.999_999, 1.0, 1.000_001, 1.5]);
        let part = random.unit() as f32;
        let to = [0, 1, 2].map(|k| centre[k] + part * along[k] + graze * outwards[k]);
        let mut d = random.direction().map(|x| x as f32);
        match round % 6 {
            0 | 1 => {
                // Along the surface at that place.
                let [x, y, z] = outwards.map(|x| x / radius);
                d = [d[1] * z - d[2] * y, d[2] * x - d[0] * z, d[0] * y - d[1] * x];
            }
            3 if along != [0.0; 3] => d = along,
            _ => {}
        }
        let away = random.pick(&[0.0, 1.0, 100.0]) * size;
        let origin = [0, 1, 2].map(|k| to[k] - away * d[k]);
        let ray = Ray::new(origin, d).with_limits(f32::NEG_INFINITY, f32::INFINITY);
        let Some(ready) = ShapeRay::new::<Strict>(&ray) else { continue };
        let greatest = |v: [f32; 3]| v.iter().fold(0.0f64, |m, x| m.max(f64::from(x.abs())));
        let from = [0, 1, 2].map(|k| origin[k] - centre[k]);
        let whole = 3f64.sqrt() * (greatest(from) + greatest(along)) + f64::from(radius);
        let sphere = Sphere { centre, radius };
        let spans = if is_sphere {
            let hostile = ShapeRay::new::<Hostile>(&ray).unwrap();
            (sphere.span::<Strict>(&ready), sphere.span::<Hostile>(&hostile))
        } else {
            let hostile = ShapeRay::new::<Hostile>(&ray).unwrap();
            (capsule.span::<Strict>(&ready), capsule.span::<Hostile>(&hostile))
        };
        assert_eq!(spans.0, spans.1, "{capsule:?} {ray:?}");
        let kind = usize::from(!is_sphere);
        match spans.0 {
            Some(span) => {
                assert!(span.t[0] <= span.t[1], "{capsule:?} {ray:?} {span:?}");
                for t in span.t {
                    let off = outside(&capsule, &ray, f64::from(t)).abs() / (U * whole);
                    worst[kind] = worst[kind].max(off);
                    let wrong = Capsule { radius: radius * 1.001, ..capsule };
                    let off = outside(&wrong, &ray, f64::from(t)).abs() / (U * whole);
                    planted += usize::from(off > 112.0);
                }
                hits += 1;
            }
            None => {
                let lost = -nearest(&capsule, &ray) / (U * whole);
                worst[kind] = worst[kind].max(lost);
                misses += 1;
            }
        }
    }
    println!("worst, in u of the bound's lengths: {worst:?}; {hits} hits, {misses} misses");
    assert!(hits > 20_000 && misses > 10_000, "{hits} {misses}");
    assert!(worst[0] <= 40.0 && worst[1] <= 112.0, "{worst:?}");
    assert!(planted > 1_000, "{planted}");
}

/// Closed forms, and what is odd about shapes and rays.
#[test]
fn odd_shapes_and_rays_have_known_answers() {
    let t = |sphere: Sphere, ray: Ray| {
        let ready = ShapeRay::new::<Strict>(&ray)?;
        sphere.span::<Strict>(&ready).map(|span| span.t)
    };
    let unit = Sphere { centre: [0.0; 3], radius: 1.0 };
    assert_eq!(t(unit, Ray::new([0.0, 0.0, 3.0], [0.0, 0.0, -1.0])), Some([2.0, 4.0]));
    assert_eq!(t(unit, Ray::new([0.0, 0.0, 3.0], [0.0, 0.0, -2.0])), Some([1.0, 2.0]));
    assert_eq!(t(unit, Ray::new([0.0; 3], [3.0, 0.0, 4.0])), Some([-0.2, 0.2]));
    assert_eq!(t(unit, Ray::new([1.0, 0.0, 3.0], [0.0, 0.0, -1.0])), Some([3.0, 3.0]));
    assert_eq!(t(unit, Ray::new([1.0f32.next_up(), 0.0, 3.0], [0.0, 0.0, -1.0])), None);
    let huge = Sphere { centre: [3e38, 0.0, 0.0], radius: 1e38 };
    let [enter, exit] = t(huge, Ray::new([-3e38, 0.0, 0.0], [3e38, 0.0, 0.0])).unwrap();
    assert!((enter - 5.0 / 3.0).abs() < 1e-5 && (exit - 7.0 / 3.0).abs() < 1e-5);
    let tiny = Sphere { centre: [0.0, 0.0, 1e-36], radius: 1e-37 };
    let [enter, exit] = t(tiny, Ray::new([0.0; 3], [0.0, 0.0, 1e-36])).unwrap();
    assert!((enter - 0.9).abs() < 1e-6 && (exit - 1.1).abs() < 1e-6);

    let capsule = Capsule { ends: [[0.0; 3], [0.0, 0.0, 2.0]], radius: 1.0 };
    let span = |from, to| {
        let ready = ShapeRay::new::<Strict>(&Ray::new(from, to)).unwrap();
        capsule.span::<Strict>(&ready).map(|span| (span.t, span.u))
    };
    assert_eq!(span([3.0, 0.0, 1.0], [-1.0, 0.0, 0.0]), Some(([2.0, 4.0], [0.5, 0.5])));
    assert_eq!(span([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]), Some(([2.0, 6.0], [1.0, 0.0])));
    assert_eq!(span([1.5, 0.0, 5.0], [0.0, 0.0, -1.0]), None);

    // What is left out, and rays that hit nothing.
    let bad = [f32::NAN, f32::INFINITY, 0.0, -1.0, 1e-40];
    let spheres = bad.map(|radius| Sphere { centre: [0.0; 3], radius });
    let mut spheres = spheres.to_vec();
    spheres.push(Sphere { centre: [f32::NAN, 0.0, 0.0], radius: 1.0 });
    let mut scene = Scene::new();
    let shapes = scene.add_shapes(Shapes::Spheres(spheres)).unwrap();
    scene.add_instance(Instance::in_place(shapes)).unwrap();
    let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
    assert_eq!(built.scene().geometry(shapes).unwrap().shapes().unwrap().dropped(), 6);
    let ray = Ray::new([0.0, 0.0, 3.0], [0.0, 0.0, -1.0]);
    assert_eq!(built.closest_hit(&ray, &SceneOptions::default()), None);
    assert!(ShapeRay::new::<Strict>(&Ray::new([0.0; 3], [0.0, -0.0, 1e-40])).is_none());
    assert!(ShapeRay::new::<Strict>(&ray.with_limits(f32::NAN, 1.0)).is_none());
}

/// The spheres of a set, as shapes of the user's own, in `f64`.
struct Balls(Vec<Sphere>);

impl OwnShape for Balls {
    fn primitives(&self) -> u32 {
        self.0.len() as u32
    }

    fn bounds(&self, primitive: u32) -> Aabb {
        let Sphere { centre, radius } = self.0[primitive as usize];
        Aabb { lo: centre.map(|x| x - radius), hi: centre.map(|x| x + radius) }
    }

    fn intersect(&self, primitive: u32, ray: &Ray, show: &mut dyn FnMut(ShapeHit)) {
        let Some(ready) = ShapeRay::new::<Strict>(ray) else { return };
        if let Some(span) = self.0[primitive as usize].span::<Strict>(&ready) {
            // In any order.
            show(ShapeHit { t: span.t[1], u: 0.0, v: 0.0, front: false });
            show(ShapeHit { t: span.t[0], u: 0.0, v: 0.0, front: true });
        }
    }
}

fn spheres(count: usize, random: &mut Random) -> Vec<Sphere> {
    let sphere = |random: &mut Random| Sphere {
        centre: random.point(1.0),
        radius: random.between(0.01, 0.3) as f32,
    };
    (0..count).map(|_| sphere(random)).collect()
}

/// Meshes, spheres, capsules and own shapes, in instances of a kind.
fn mixed(kind: Kind, seed: u64, own: bool) -> Scene {
    let (mut scene, _) = objects::scene(kind, 20, seed);
    let mut random = Random::new(seed);
    let balls = spheres(60, &mut random);
    let capsules = (0..60).map(|_| Capsule {
        ends: [random.point(1.0), random.point(1.0)],
        radius: random.between(0.01, 0.2) as f32,
    });
    let mut sets = vec![Shapes::Capsules(capsules.collect()), Shapes::Spheres(balls.clone())];
    if own {
        sets.push(Shapes::Own(Arc::new(Balls(balls))));
    }
    for set in sets {
        let geometry = scene.add_shapes(set).unwrap();
        let mut placed = 0;
        while placed < 12 {
            let mut instance = Instance::new(geometry, objects::transform(kind, &mut random));
            if random.below(3) == 0 {
                instance.culling = random.pick(&[Culling::Back, Culling::Front]);
            }
            placed += usize::from(scene.add_instance(instance).is_ok());
        }
    }
    scene
}

fn bits(hits: &[SceneHit]) -> &[[u32; 6]] {
    bytemuck::cast_slice(hits)
}

/// Every path finds what all instances give one after the other; own spheres are spheres; all hits begin with the closest.
#[test]
fn every_path_finds_the_same_shapes() {
    let backend = CpuBackend::new();
    let (mut found, mut on_shapes) = (0, 0);
    for kind in Kind::ALL {
        let scene = mixed(kind, 31, true);
        let built = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
        let rays = objects::rays(&scene, 800, 32);
        let odd = |hit: &SceneHit| (hit.triangle ^ hit.instance) & 1 == 0;
        for filtered in [false, true] {
            for culling in [Culling::None, Culling::Back, Culling::Front] {
                let options = &SceneOptions {
                    culling,
                    filter: if filtered { Some(&odd) } else { None },
                    ..SceneOptions::default()
                };
                let expected: Vec<SceneHit> =
                    rays.iter().map(|ray| built.scene().answer_by_all(ray, options)).collect();
                let mut hits = vec![SceneHit::MISS; rays.len()];
                built.closest_hits(&rays, &mut hits, options).unwrap();
                assert_eq!(bits(&hits), bits(&expected), "{kind:?} {filtered} {culling:?}");
                let mut any = vec![false; rays.len()];
                built.any_hits(&rays, &mut any, options).unwrap();
                let all_options = SceneAllHitsOptions { query: *options, max_memory: None };
                let all = built.all_hits(&rays, &all_options).unwrap();
                for (i, hit) in expected.iter().enumerate() {
                    assert_eq!(any[i], hit.is_hit(), "{kind:?} {:?}", rays[i]);
                    assert_eq!(built.closest_hit(&rays[i], options), hit.some());
                    assert_eq!(built.any_hit(&rays[i], options), any[i]);
                    let instance = scene.instance(InstanceId(hit.instance)).ok();
                    let shapes = instance.is_some_and(|instance| {
                        scene.geometry(instance.geometry).unwrap().shapes().is_some()
                    });
                    if shapes {
                        let same = all.of(i).iter().any(|one| one.hit == *hit);
                        assert!(same, "{kind:?} {:?} {hit:?}", rays[i]);
                        on_shapes += 1;
                    }
                }
                found += expected.iter().filter(|hit| hit.is_hit()).count();
            }
        }
    }
    assert!(found > 5_000 && on_shapes > 1_500, "{found} {on_shapes}");
}

/// The tree over shapes passes over nothing: against every primitive on its own.
#[test]
fn the_tree_over_shapes_loses_no_hit() {
    let mut random = Random::new(8);
    let balls = spheres(500, &mut random);
    let mut scene = Scene::new();
    let geometry = scene.add_shapes(Shapes::Spheres(balls.clone())).unwrap();
    scene.add_instance(Instance::in_place(geometry)).unwrap();
    let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
    // The planted fault: boxes a hundredth too small.
    let set = Shapes::Spheres(balls.clone());
    let tight: Vec<(u32, WorldBox)> = (0..500)
        .map(|name| {
            let Aabb { mut lo, mut hi } = set.bounds(name).unwrap();
            for axis in 0..3 {
                let less = 0.01 * (hi[axis] - lo[axis]);
                (lo[axis], hi[axis]) = (lo[axis] + less, hi[axis] - less);
            }
            (name, WorldBox { bounds: Aabb { lo, hi }, reach: 0.0 })
        })
        .collect();
    let tight = TopTree::build(500, tight.into_iter()).unwrap();
    let (mut found, mut lost) = (0, 0);
    for _ in 0..4_000 {
        let away = random.pick(&[0.5, 5.0, 5e4]);
        let (mut to, mut d) = (random.point(1.0), random.direction().map(|x| x as f32));
        if random.below(2) == 0 {
            // Along a face of a sphere's box where it touches the sphere, next to it on either side.
            let (ball, axis) = (random.pick(&balls), random.below(3));
            to = ball.centre;
            to[axis] += ball.radius * (1.0 + random.signed() * 1e-3);
            d[axis] = 0.0;
        }
        let ray = Ray::new([0, 1, 2].map(|k| to[k] - away * d[k]), d);
        let ready = ShapeRay::new::<Strict>(&ray).unwrap();
        let mut best = (f32::INFINITY, u32::MAX);
        for (name, ball) in balls.iter().enumerate() {
            for t in ball.span::<Strict>(&ready).iter().flat_map(|span| span.t) {
                if t >= 0.0 && (t, name as u32) < best {
                    best = (t, name as u32);
                }
            }
        }
        let hit = built.closest_hit(&ray, &SceneOptions::default());
        assert_eq!(hit.map_or(best, |hit| (hit.t, hit.triangle)), best, "{ray:?}");
        assert_eq!(hit.is_some(), best.1 != u32::MAX);
        found += usize::from(hit.is_some());
        let mut stack = [TopStack::default(); WIDEST_STACK];
        let (top_ray, mut top) = (TopRay::new(&ray).unwrap(), tight.begin(&mut stack));
        let entered = core::iter::from_fn(|| tight.next(&top_ray, best.0, &mut stack, &mut top));
        lost += usize::from(hit.is_some() && !entered.into_iter().any(|name| name == best.1));
    }
    assert!(found > 2_000, "{found}");
    assert!(lost > 0, "the fault is not noticed");
}

/// Points are where closed forms say, and their closest points too.
#[test]
fn points_among_shapes() {
    let mut random = Random::new(9);
    let balls = spheres(40, &mut random);
    let mut scene = Scene::new();
    let geometry = scene.add_shapes(Shapes::Spheres(balls.clone())).unwrap();
    let transform =
        objects::product(&translation([3.0, 0.0, 0.0]), &objects::rotation(&mut random));
    let placed = scene.add_instance(Instance::new(geometry, transform)).unwrap();
    let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
    let points: Vec<[f32; 3]> = (0..2000)
        .map(|_| {
            let [x, y, z] = random.point(1.2);
            [x + 3.0, y, z]
        })
        .collect();
    let located = built.locate(&points, &LocateOptions::default()).unwrap();
    let mut closest = vec![SceneClosestPoint::NONE; points.len()];
    let options = SceneClosestPointOptions::default();
    built.closest_points(&points, &mut closest, &options).unwrap();
    let mut inside = 0;
    for ((point, winding), closest) in points.iter().zip(located.windings).zip(&closest) {
        let beyond = balls.iter().map(|ball| {
            let centre = objects::in_world(&transform, ball.centre.map(f64::from));
            let away = (0..3).map(|k| (f64::from(point[k]) - centre[k]).powi(2)).sum::<f64>();
            away.sqrt() - f64::from(ball.radius)
        });
        let beyond: Vec<f64> = beyond.collect();
        let around = beyond.iter().filter(|beyond| **beyond < 0.0).count();
        if beyond.iter().all(|beyond| beyond.abs() > 1e-5) {
            assert_eq!(winding, Some(around as i32));
        }
        inside += around;
        let (nearest, least) = beyond
            .iter()
            .map(|beyond| beyond.abs())
            .enumerate()
            .fold((0, f64::INFINITY), |best, own| if own.1 < best.1 { own } else { best });
        assert!((closest.distance_squared.sqrt() - least).abs() < 1e-6, "{closest:?} {least}");
        if closest.triangle as usize != nearest {
            assert!((beyond[closest.triangle as usize].abs() - least).abs() < 1e-6);
        }
        let to = (0..3).map(|k| f64::from(point[k] - closest.point[k]).powi(2)).sum::<f64>();
        assert!((to.sqrt() - least).abs() < 1e-5);
    }
    assert!(inside > 60, "{inside}");

    // An uneven transform, and shapes of one's own, have no answer.
    scene.move_instance(placed, objects::scaling([1.0, 1.0, 1.5])).unwrap();
    let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
    let refused = built.closest_points(&points, &mut closest, &options);
    assert_eq!(refused, Err(QueryError::UnevenShapes { instance: placed.0 }));
    let masked = SceneClosestPointOptions { mask: 0, ..options };
    assert!(built.closest_points(&points, &mut closest, &masked).is_ok());
    scene.move_instance(placed, IDENTITY).unwrap();
    scene.replace_shapes(geometry, Shapes::Own(Arc::new(Balls(balls)))).unwrap();
    let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
    let refused = built.closest_points(&points, &mut closest, &options);
    assert!(matches!(refused, Err(QueryError::Unsupported { .. })));
    let inside = [[0.0; 3]; 1];
    assert!(matches!(
        built.locate(&inside, &LocateOptions::default()),
        Err(QueryError::Unsupported { .. })
    ));
}

/// Updates, files and refusals.
#[test]
fn shapes_are_updated_saved_and_loaded() {
    let backend = CpuBackend::new();
    let options = BuildOptions::default();
    let mut scene = mixed(Kind::Ordinary, 51, false);
    let meshes: Vec<_> = scene
        .geometries()
        .filter(|(_, own)| own.shapes().is_none() && !own.mesh().is_empty())
        .map(|(name, own)| (name, own.mesh().len()))
        .collect();
    for (name, triangles) in meshes {
        let mask = OpacityMask::new(triangles, 2, |triangle, [u, v]| {
            triangle % 3 != 0 || (u - v).abs() > 0.2
        });
        scene.set_opacity(name, Some(mask.unwrap())).unwrap();
    }
    let mut built = backend.build_scene(&scene, &options).unwrap();
    let file = write_file(built.scene()).unwrap();
    let parsed = SceneFile::parse(&file).unwrap();
    assert_eq!(parsed.digest(), built.scene().digest());
    let (mut loaded_scene, loaded) = backend.load_scene(&parsed, &LoadOptions::default()).unwrap();
    assert_eq!(loaded.scene().digest(), built.scene().digest());
    assert_eq!(write_file(loaded.scene()).unwrap(), file);
    let rays = objects::rays(&scene, 2_000, 52);
    let hits = |built: &dyn SceneAccelerator| {
        let mut hits = vec![SceneHit::MISS; rays.len()];
        built.closest_hits(&rays, &mut hits, &SceneOptions::default()).unwrap();
        hits
    };
    assert_eq!(bits(&hits(&*built)), bits(&hits(&*loaded)));

    // A word of a mask or of a shape is part of the name of the scene.
    let shapes = scene.geometries().find(|(_, own)| own.shapes().is_some()).unwrap().0;
    let before = built.scene().digest();
    let ball = Sphere { centre: [0.0; 3], radius: 0.5 };
    scene.replace_shapes(shapes, Shapes::Spheres(vec![ball])).unwrap();
    let report = backend.update_scene(&mut *built, &scene, &options).unwrap();
    assert_eq!(report.geometries_built, 1);
    assert_ne!(built.scene().digest(), before);
    let fresh = backend.build_scene(&scene, &options).unwrap();
    assert_eq!(built.scene().digest(), fresh.scene().digest());
    assert_eq!(bits(&hits(&*built)), bits(&hits(&*fresh)));

    // Refusals.
    let mesh = objects::meshes(1)[0].clone();
    let other = loaded_scene.replace_mesh(shapes, &mesh.mesh());
    assert!(matches!(other, Err(SceneError::OtherKind { .. })), "{other:?}");
    let mask = OpacityMask::new(1, 0, |_, _| true).unwrap();
    let refused = scene.set_opacity(shapes, Some(mask));
    assert!(matches!(refused, Err(SceneError::OpacityTriangles { triangles: 0, .. })));
    scene.replace_shapes(shapes, Shapes::Own(Arc::new(Balls(vec![ball])))).unwrap();
    backend.update_scene(&mut *built, &scene, &options).unwrap();
    let refused = write_file(built.scene()).unwrap_err();
    assert_eq!(refused, SceneWriteError::OwnShapes { geometry: shapes.0 });
}

/// A mask does what an equal filter does, on every path; setting one builds nothing.
#[test]
fn opacity_masks_are_filters() {
    let backend = CpuBackend::new();
    let options = BuildOptions::default();
    let (mut scene, _) = objects::scene(Kind::Ordinary, 40, 61);
    let mut built = backend.build_scene(&scene, &options).unwrap();
    let geometries: Vec<_> =
        scene.geometries().map(|(name, own)| (name, own.mesh().len())).collect();
    let masks: Vec<OpacityMask> = geometries
        .iter()
        .map(|&(_, triangles)| {
            let is_opaque = |triangle, [u, _]: [f32; 2]| triangle % 2 == 0 && u > 0.3;
            OpacityMask::new(triangles, 3, is_opaque).unwrap()
        })
        .collect();
    let rays = objects::rays(&scene, 4_000, 62);
    let filter =
        |hit: &SceneHit| masks[hit.geometry as usize].is_opaque(hit.triangle, hit.u, hit.v);
    let filtered = SceneOptions { filter: Some(&filter), ..SceneOptions::default() };
    let (mut expected, mut plain) =
        (vec![SceneHit::MISS; rays.len()], vec![SceneHit::MISS; rays.len()]);
    let report = built.closest_hits(&rays, &mut expected, &filtered).unwrap();
    built.closest_hits(&rays, &mut plain, &SceneOptions::default()).unwrap();
    assert!(report.rejected > 500 && bits(&plain) != bits(&expected));
    for (&(name, _), mask) in geometries.iter().zip(&masks) {
        scene.set_opacity(name, Some(mask.clone())).unwrap();
    }
    let report = backend.update_scene(&mut *built, &scene, &options).unwrap();
    assert_eq!((report.geometries_built, report.instances_changed), (0, 0));
    let (mut hits, mut any) = (vec![SceneHit::MISS; rays.len()], vec![false; rays.len()]);
    built.closest_hits(&rays, &mut hits, &SceneOptions::default()).unwrap();
    built.any_hits(&rays, &mut any, &SceneOptions::default()).unwrap();
    assert_eq!(bits(&hits), bits(&expected));
    for (i, ray) in rays.iter().enumerate() {
        assert_eq!(any[i], expected[i].is_hit());
        assert_eq!(built.closest_hit(ray, &SceneOptions::default()), expected[i].some());
        assert_eq!(built.any_hit(ray, &SceneOptions::default()), any[i]);
    }
}

/// A stack of a thousand sheets, all but the last of which are rejected: each is shown to the filter a few times, not a thousand.
#[test]
fn a_rejected_hit_costs_one_test() {
    use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
    const SHEETS: u32 = 1000;
    let sheet = |z: u32| [[-1.0, -1.0, z as f32], [1.0, -1.0, z as f32], [0.0, 1.0, z as f32]];
    let corners: Vec<[[f32; 3]; 3]> = (0..SHEETS).map(sheet).collect();
    let mut scene = Scene::new();
    let geometry = scene.add_mesh(&Mesh::soup(&corners).unwrap()).unwrap();
    scene.add_instance(Instance::in_place(geometry)).unwrap();
    let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
    let asked = AtomicU64::new(0);
    let last = |hit: &SceneHit| {
        asked.fetch_add(1, Relaxed);
        hit.triangle == SHEETS - 1
    };
    let options = SceneOptions { filter: Some(&last), ..SceneOptions::default() };
    let ray = Ray::new([0.0, 0.0, -1.0], [0.0, 0.0, 1.0]);
    let hit = built.closest_hit(&ray, &options).unwrap();
    assert_eq!((hit.triangle, hit.t), (SHEETS - 1, SHEETS as f32));
    let asked = asked.load(Relaxed);
    assert!(asked < 4 * u64::from(SHEETS), "{asked}");
}
