//! What functions of the caller's take part in: filters, opacity masks and shapes.

use std::ffi::c_void;
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicU32, Ordering};

use library::Ray;

use super::answers::{arrays, done, mesh_of, open, query_options, rays, records};
use crate::backend::*;
use crate::handle::*;
use crate::lists::*;
use crate::opacity::*;
use crate::options::{NONE, QueryOptions};
use crate::record::*;
use crate::scene::*;
use crate::scene_query::*;
use crate::shapes::*;
use crate::status::Status;

const BLANK: SceneHit = SceneHit { t: 0.0, u: 0.0, v: 0.0, triangle: 9, geometry: 9, instance: 9 };
const UNMOVED: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// A scene of one geometry that is where it is, up to date.
fn scene_of(backend: Backend, add: impl FnOnce(Scene, &mut u32) -> Status) -> (Scene, u32) {
    let (mut scene, mut geometry, mut number) = (Scene { id: 0 }, 9, 9);
    // SAFETY: there is room, here and below.
    unsafe {
        done(splitplane_scene_create(backend, &mut scene));
        done(add(scene, &mut geometry));
        let instance = Instance { transform: UNMOVED, geometry, mask: NONE, id: 0, culling: 0 };
        done(splitplane_scene_add_instance(scene, &instance, &mut number));
        done(splitplane_scene_update(scene, null(), null_mut()));
    }
    (scene, geometry)
}

fn closest(scene: Scene, given: &[Ray], options: *const QueryOptions) -> Vec<SceneHit> {
    let (asked, mut hits) = (records(given), vec![BLANK; given.len()]);
    let first = hits.as_mut_ptr();
    // SAFETY: rays and room are there.
    unsafe { done(splitplane_scene_closest_hits(scene, &asked, options, first, 24, null_mut())) };
    hits
}

/// All crossings, ray by ray.
fn crossings(scene: Scene, given: &[Ray], options: *const QueryOptions) -> Vec<Vec<Crossing>> {
    let (asked, mut lists, mut count, mut total) = (records(given), Lists { id: 0 }, 0, 0);
    let blank =
        Crossing { t: 0.0, triangle: 0, u: 0.0, v: 0.0, geometry: 0, instance: 0, front: 9 };
    // SAFETY: rays and rooms are there.
    unsafe {
        done(splitplane_scene_all_hits(scene, &asked, options, &mut lists, null_mut()));
        done(splitplane_lists_size(lists, &mut count, &mut total));
        let (mut starts, mut all) = (vec![0; count + 1], vec![blank; total]);
        done(splitplane_lists_starts(lists, starts.as_mut_ptr(), count + 1));
        done(splitplane_lists_crossings(lists, all.as_mut_ptr(), 28, total));
        done(splitplane_lists_free(lists));
        starts.windows(2).map(|ends| all[ends[0] as usize..ends[1] as usize].to_vec()).collect()
    }
}

/// Keeps every third triangle, and counts its calls.
unsafe extern "C" fn thirds(user: *mut c_void, hit: *const SceneHit) -> i32 {
    // SAFETY: it is what the options say, and the hit is there.
    let (calls, hit) = unsafe { (&*user.cast::<AtomicU32>(), *hit) };
    calls.fetch_add(1, Ordering::Relaxed);
    if hit.triangle.is_multiple_of(3) { -7 } else { 0 }
}

#[test]
fn hits_that_a_filter_rejects_are_not_there() {
    let (positions, indices) = arrays();
    let (backend, given) = (open(), rays(1500));
    let mesh = mesh_of(&positions, &indices);
    // SAFETY: the mesh is there.
    let (scene, _) = scene_of(backend, |scene, room| unsafe {
        splitplane_scene_add_geometry(scene, &mesh, room)
    });
    let calls = AtomicU32::new(0);
    let mut options = query_options();
    options.filter = Some(thirds);
    options.filter_user = (&raw const calls).cast_mut().cast();
    options.accuracy = 2;
    let (plain, hits) = (crossings(scene, &given, null()), closest(scene, &given, &options));
    assert!(calls.load(Ordering::Relaxed) > 0);
    options.accuracy = 0;
    let filtered = crossings(scene, &given, &options);
    let (asked, mut occluded, mut counts) = (records(&given), vec![9_u8; 1500], vec![9_u64; 1500]);
    // SAFETY: rays and rooms are there.
    unsafe {
        let (flags, numbers) = (occluded.as_mut_ptr(), counts.as_mut_ptr());
        options.accuracy = 2;
        done(splitplane_scene_any_hits(scene, &asked, &options, flags, 1, null_mut()));
        options.accuracy = 0;
        done(splitplane_scene_count_hits(scene, &asked, &options, numbers, 8, null_mut()));
    }
    let mut rejected = 0;
    for (ray, plain) in plain.iter().enumerate() {
        let kept: Vec<&Crossing> = plain.iter().filter(|own| own.triangle % 3 == 0).collect();
        rejected += plain.len() - kept.len();
        let first = kept.first().map(|own| (own.triangle, own.t.to_bits()));
        let hit = hits[ray];
        assert_eq!((hit.triangle != NONE).then_some((hit.triangle, hit.t.to_bits())), first);
        assert_eq!(filtered[ray].iter().collect::<Vec<_>>(), kept);
        assert_eq!((occluded[ray], counts[ray]), (u8::from(!kept.is_empty()), kept.len() as u64));
    }
    assert!(rejected > 1000, "{rejected}");
    // Trees and distances have no filters.
    let mut point = SceneClosestPoint {
        distance_squared: 0.0,
        point: [0.0; 3],
        triangle: 0,
        u: 0.0,
        v: 0.0,
        geometry: 0,
        instance: 0,
    };
    let from = [0.5_f32; 3];
    // SAFETY: point and room are there.
    let refused = unsafe {
        splitplane_scene_closest_points(
            scene,
            from.as_ptr(),
            12,
            1,
            &options,
            &mut point,
            40,
            null_mut(),
        )
    };
    assert_eq!(refused, Status::Option);
    done(splitplane_scene_free(scene));
    done(splitplane_backend_free(backend));
}

/// Lets rays pass where u + v is more than a half.
unsafe extern "C" fn near(user: *mut c_void, triangle: u32, u: f32, v: f32) -> i32 {
    // SAFETY: it is what the call was given.
    unsafe { *user.cast::<u32>() += 1 };
    i32::from(triangle == 0 && u + v < 0.5)
}

#[test]
fn rays_pass_what_an_opacity_mask_leaves_out() {
    // Two triangles, one behind the other.
    let positions: Vec<[f32; 3]> =
        [0.0, -1.0].iter().flat_map(|&z| [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]]).collect();
    let (backend, indices) = (open(), [[0, 1, 2], [3, 4, 5]]);
    let mesh = mesh_of(&positions, &indices);
    // SAFETY: arrays and rooms are there, here and below.
    let (scene, geometry) = scene_of(backend, |scene, room| unsafe {
        splitplane_scene_add_geometry(scene, &mesh, room)
    });
    let given: Vec<Ray> = (0..400)
        .map(|i| [(i % 20) as f32 * 0.05 + 0.012, (i / 20) as f32 * 0.05 + 0.017])
        .filter(|[x, y]| x + y < 0.98)
        .map(|[x, y]| Ray::new([x, y, 5.0], [0.0, 0.0, -1.0]))
        .collect();
    assert!(closest(scene, &given, null()).iter().all(|hit| hit.triangle == 0 && hit.t == 5.0));
    let (mut calls, mut level, mut needed) = (0_u32, 9, 9);
    // SAFETY: as above.
    unsafe {
        let ask = splitplane_scene_get_opacity;
        done(ask(scene, geometry, &mut level, null_mut(), 0, &mut needed));
        assert_eq!((level, needed), (0, 0));
        let user = (&raw mut calls).cast();
        done(splitplane_scene_make_opacity(scene, geometry, 1, Some(near), user));
        assert_eq!(calls, 8, "four cells a triangle");
        done(splitplane_scene_update(scene, null(), null_mut()));
        done(ask(scene, geometry, &mut level, null_mut(), 0, &mut needed));
        assert_eq!((level, needed), (1, 1));
    }
    // Of triangle 0 only the cell at its first corner is left: where u + v is less than a half, both being less than that.
    let expect = |hits: &[SceneHit]| {
        for (ray, hit) in given.iter().zip(hits) {
            let [x, y, _] = ray.origin;
            let expected = if x + y < 0.5 { (0, 5.0) } else { (NONE, f32::INFINITY) };
            assert_eq!((hit.triangle, hit.t), expected, "{x} {y}");
        }
    };
    expect(&closest(scene, &given, null()));
    let mut word = 0;
    // SAFETY: as above.
    unsafe {
        done(splitplane_scene_get_opacity(scene, geometry, &mut level, &mut word, 1, null_mut()));
        assert_eq!(word, 1, "the first cell of the first triangle");
        done(splitplane_scene_clear_opacity(scene, geometry));
        done(splitplane_scene_update(scene, null(), null_mut()));
        assert!(closest(scene, &given, null()).iter().all(|hit| hit.triangle == 0));
        done(splitplane_scene_set_opacity(scene, geometry, 1, &word, 1));
        done(splitplane_scene_update(scene, null(), null_mut()));
        expect(&closest(scene, &given, null()));
        let mut less = splitplane_scene_set_opacity(scene, geometry, 4, &word, 1);
        assert_eq!(less, Status::Count);
        word = 1 << 20;
        less = splitplane_scene_set_opacity(scene, geometry, 1, &word, 1);
        assert_eq!(less, Status::Count, "a bit after the last cell");
        assert_eq!(splitplane_scene_set_opacity(scene, geometry, 13, &word, 1), Status::Option);
    }
    done(splitplane_scene_free(scene));
    done(splitplane_backend_free(backend));
}

/// Balls of radius 1 about (3 primitive, 0, 0).
struct Balls {
    calls: AtomicU32,
    released: AtomicU32,
}

/// Where a line is in such a ball, in f64.
fn in_ball(primitive: u32, ray: [f32; 8]) -> Option<[f64; 2]> {
    let [x, y, z, _, dx, dy, dz, _] = ray.map(f64::from);
    let from = [x - 3.0 * f64::from(primitive), y, z];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let d = [dx, dy, dz];
    let (a, b, c) = (dot(d, d), dot(from, d), dot(from, from) - 1.0);
    let root = b * b - a * c;
    (root >= 0.0).then(|| [(-b - root.sqrt()) / a, (-b + root.sqrt()) / a])
}

unsafe extern "C" fn ball(
    user: *mut c_void,
    primitive: u32,
    ray: *const f32,
    show: ShowHitFunction,
    to: *mut c_void,
) {
    // SAFETY: both are what they are said to be.
    let (balls, ray) = unsafe { (&*user.cast::<Balls>(), *ray.cast::<[f32; 8]>()) };
    balls.calls.fetch_add(1, Ordering::Relaxed);
    let Some(show) = show else { return };
    for (t, front) in in_ball(primitive, ray).into_iter().flatten().zip([1, 0]) {
        let hit = ShapeHit { t: t as f32, u: 0.25, v: primitive as f32, front };
        // SAFETY: it takes such a hit.
        unsafe { show(to, &hit) };
    }
    // SAFETY: nothing is shown by NULL.
    unsafe { show(to, null()) };
}

unsafe extern "C" fn release(user: *mut c_void) {
    // SAFETY: it is what the shapes said.
    unsafe { &*user.cast::<Balls>() }.released.fetch_add(1, Ordering::Relaxed);
}

fn balls_of(kind: ShapeKind, numbers: &[f32], each: usize) -> Shapes {
    Shapes {
        kind: kind as u32,
        reserved: 0,
        numbers: numbers.as_ptr(),
        stride: 4 * each,
        count: numbers.len() / each,
        intersect: None,
        user: null_mut(),
        release: None,
    }
}

#[test]
fn shapes_are_hit_where_closed_forms_say() {
    let backend = open();
    let balls = Balls { calls: AtomicU32::new(0), released: AtomicU32::new(0) };
    let user: *mut c_void = (&raw const balls).cast_mut().cast();
    let boxes: Vec<f32> = (0..4)
        .flat_map(|i| [3.0 * i as f32 - 1.0, -1.0, -1.0, 3.0 * i as f32 + 1.0, 1.0, 1.0])
        .collect();
    let spheres: Vec<f32> = (0..4).flat_map(|i| [3.0 * i as f32, 0.0, 0.0, 1.0]).collect();
    // Both ends are one point: a ball.
    let capsules: Vec<f32> =
        (0..4).flat_map(|i| [3.0 * i as f32, 0.0, 0.0, 3.0 * i as f32, 0.0, 0.0, 1.0]).collect();
    let own = Shapes {
        intersect: Some(ball),
        user,
        release: Some(release),
        ..balls_of(ShapeKind::Own, &boxes, 6)
    };
    let given: Vec<Ray> = rays(2000)
        .into_iter()
        .map(|ray| Ray { origin: [ray.origin[0] * 6.0, ray.origin[1] * 3.0, -4.0], ..ray })
        .map(|ray| Ray { t_min: 0.0, t_max: f32::INFINITY, ..ray })
        .collect();
    let mut found = 0;
    for shapes in [
        own,
        balls_of(ShapeKind::Spheres, &spheres, 4),
        balls_of(ShapeKind::Capsules, &capsules, 7),
    ] {
        // SAFETY: shapes, functions and rooms are there, here and below.
        let (scene, geometry) = scene_of(backend, |scene, room| unsafe {
            splitplane_scene_add_shapes(scene, &shapes, room)
        });
        for (ray, hit) in given.iter().zip(closest(scene, &given, null())) {
            let words: [f32; 8] = bytemuck::cast(*ray);
            let expected = (0..4)
                .filter_map(|primitive| {
                    let first = in_ball(primitive, words)?.into_iter().find(|&t| t >= 0.0)?;
                    Some((first, primitive))
                })
                .min_by(|a, b| a.0.total_cmp(&b.0));
            match expected {
                Some((t, primitive)) if hit.triangle != NONE => {
                    assert!((f64::from(hit.t) - t).abs() < 1e-3 * t.max(1.0), "{} {t}", hit.t);
                    assert_eq!(hit.triangle, primitive);
                    if shapes.kind == ShapeKind::Own as u32 {
                        assert_eq!((hit.u, hit.v), (0.25, primitive as f32));
                    }
                    found += 1;
                }
                // A line that touches a ball is decided by roundings.
                Some((t, primitive)) => {
                    let [enter, leave] = in_ball(primitive, words).unwrap();
                    assert!(leave - enter < 1e-2, "{t} is missed");
                }
                None => assert_eq!(hit.triangle, NONE),
            }
        }
        let lines = crossings(scene, &given, null());
        assert!(lines.iter().flatten().any(|own| own.front == 1));
        assert!(lines.iter().flatten().any(|own| own.front == 0));
        // SAFETY: as above.
        unsafe {
            let mesh = mesh_of(&[], &[]);
            let other = splitplane_scene_replace_geometry(scene, geometry, &mesh);
            assert_eq!(other, Status::Scene, "shapes are no mesh");
            let less = balls_of(ShapeKind::Spheres, &spheres[..4], 4);
            done(splitplane_scene_replace_shapes(scene, geometry, &less));
            done(splitplane_scene_update(scene, null(), null_mut()));
        }
        let few = closest(scene, &given, null());
        assert!(few.iter().all(|hit| hit.triangle == 0 || hit.triangle == NONE));
        done(splitplane_scene_free(scene));
    }
    assert!(found > 300, "{found}");
    assert!(balls.calls.load(Ordering::Relaxed) > 0);
    assert_eq!(balls.released.load(Ordering::Relaxed), 1, "once, though it was replaced and freed");
    // A call that fails leaves them to the caller.
    let (mut scene, mut room) = (Scene { id: 0 }, 0);
    // SAFETY: as above.
    unsafe {
        let dead = splitplane_scene_add_shapes(scene, &own, &mut room);
        assert_eq!(dead, Status::Handle);
        done(splitplane_scene_create(backend, &mut scene));
        let unknown = splitplane_scene_replace_shapes(scene, 7, &own);
        assert_eq!(unknown, Status::UnknownId);
    }
    assert_eq!(balls.released.load(Ordering::Relaxed), 1);
    // A scene that has shapes of the caller's has no file.
    let mut needed = 0;
    // SAFETY: as above.
    unsafe {
        done(splitplane_scene_add_shapes(scene, &own, &mut room));
        done(splitplane_scene_update(scene, null(), null_mut()));
        let file = splitplane_scene_write(scene, null_mut(), 0, &mut needed);
        assert_eq!(file, Status::Unsupported);
    }
    done(splitplane_scene_free(scene));
    assert_eq!(balls.released.load(Ordering::Relaxed), 2);
    done(splitplane_backend_free(backend));
}
