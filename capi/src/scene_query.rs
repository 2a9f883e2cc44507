//! Queries of scenes.

use library::objects::{SceneClosestPoint as Closest, SceneHit as HitOfScene};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::batch::{self, Report};
use crate::buffer::{Wanted, check, check_offer, offer, points, write};
use crate::entry::entry;
use crate::handle::{Lists, Scene, get, insert};
use crate::lists::Object as ListsObject;
use crate::options::QueryOptions;
use crate::pool;
use crate::progress::watch;
use crate::query_settings::{Query, Uses};
use crate::ray::{Rays, View};
use crate::record::{SceneClosestPoint, SceneHit};
use crate::scene::current;
use crate::status::Status;
use crate::tree_query::{flags, located};

/// The closest hit of every ray: the one of least (t, instance, triangle). `hits` has room for one record a ray, `hit_stride` bytes apart: 24 where nothing is between them. `options` and `report`
/// may be NULL. After a failure the records mean nothing.
///
/// Threads: any; one scene may answer many calls at a time.
///
/// # Safety
/// `rays` and `options` say what is there, `hits` has the room, and nobody else uses them during the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_closest_hits(
    scene: Scene,
    rays: *const Rays,
    options: *const QueryOptions,
    hits: *mut SceneHit,
    hit_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(scene)?;
        check_offer(report, "report")?;
        let uses = Uses::SCENE_HITS;
        // SAFETY: as the caller says.
        let (query, rays) = unsafe { (Query::read(options, uses)?, View::new(rays)?) };
        let first = hits.cast::<HitOfScene>();
        // SAFETY: as the caller says; the records are the same.
        let mut wanted = unsafe { Wanted::new(first, hit_stride, rays.len(), "hits")? };
        rays.places().try_for_each(|given| wanted.apart_from(given))?;
        let state = current(&object)?;
        let built = &state.built;
        let placed = AtomicU64::new(0);
        let found = pool::run(query.threads, || {
            batch::rays(&rays, &mut wanted, HitOfScene::MISS, query.caller, |rays, hits, watch| {
                let found = built.closest_hits(rays, hits, &query.scene_hits(watch))?;
                placed.fetch_add(found.placed_by_cpu, Ordering::Relaxed);
                Ok(found.geometries)
            })
        })?;
        let found = Report { placed_by_cpu: placed.into_inner(), ..found };
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

/// For every ray, whether it hits anything: 1 or 0, `occluded_stride` bytes apart. Otherwise as `splitplane_scene_closest_hits`.
///
/// Threads: any; one scene may answer many calls at a time.
///
/// # Safety
/// As for `splitplane_scene_closest_hits`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_any_hits(
    scene: Scene,
    rays: *const Rays,
    options: *const QueryOptions,
    occluded: *mut u8,
    occluded_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(scene)?;
        check_offer(report, "report")?;
        let uses = Uses::SCENE_HITS;
        // SAFETY: as the caller says.
        let (query, rays) = unsafe { (Query::read(options, uses)?, View::new(rays)?) };
        // SAFETY: as the caller says.
        let mut wanted = unsafe { flags(occluded, occluded_stride, &rays)? };
        let state = current(&object)?;
        let built = &state.built;
        let placed = AtomicU64::new(0);
        let found = pool::run(query.threads, || {
            batch::rays(&rays, &mut wanted, false, query.caller, |rays, occluded, watch| {
                let found = built.any_hits(rays, occluded, &query.scene_hits(watch))?;
                placed.fetch_add(found.placed_by_cpu, Ordering::Relaxed);
                Ok(found.geometries)
            })
        })?;
        let found = Report { placed_by_cpu: placed.into_inner(), ..found };
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

/// All crossings of every ray with surfaces, in order of (t, instance, triangle): a list for each ray, as of `splitplane_tree_all_hits`.
///
/// Threads: any; one scene may answer many calls at a time.
///
/// # Safety
/// `rays` and `options` say what is there, and `lists` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_all_hits(
    scene: Scene,
    rays: *const Rays,
    options: *const QueryOptions,
    lists: *mut Lists,
    report: *mut Report,
) -> Status {
    entry(|| {
        check(lists, "lists")?;
        check_offer(report, "report")?;
        let object = get(scene)?;
        let uses = Uses::SCENE_ALL_HITS;
        // SAFETY: as the caller says.
        let (query, rays) = unsafe { (Query::read(options, uses)?, View::new(rays)?) };
        let state = current(&object)?;
        let built = &state.built;
        let all = pool::run(query.threads, || {
            let options = query.scene_all_hits(watch(&query.caller));
            rays.all(|rays| built.all_hits(rays, &options))
        })?;
        let mut found = Report::default();
        found.add(&all.report);
        let handle = insert(ListsObject::Scene(all))?;
        // SAFETY: as the caller says.
        unsafe { write(lists, handle, "lists").and_then(|()| offer(report, found, "report")) }
    })
}

/// How many crossings every ray has with surfaces, `count_stride` bytes apart. `max_memory` of the options limits those of one ray.
///
/// Threads: any; one scene may answer many calls at a time.
///
/// # Safety
/// As for `splitplane_scene_closest_hits`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_count_hits(
    scene: Scene,
    rays: *const Rays,
    options: *const QueryOptions,
    counts: *mut u64,
    count_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(scene)?;
        check_offer(report, "report")?;
        let uses = Uses::SCENE_ALL_HITS;
        // SAFETY: as the caller says.
        let (query, rays) = unsafe { (Query::read(options, uses)?, View::new(rays)?) };
        // SAFETY: as the caller says.
        let mut wanted = unsafe { Wanted::new(counts, count_stride, rays.len(), "counts")? };
        rays.places().try_for_each(|given| wanted.apart_from(given))?;
        let state = current(&object)?;
        let built = &state.built;
        let found = pool::run(query.threads, || {
            batch::rays(&rays, &mut wanted, 0u64, query.caller, |rays, counts, watch| {
                built.count_hits(rays, counts, &query.scene_all_hits(watch))
            })
        })?;
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

/// How often the surfaces of all instances wind around every point, as `splitplane_tree_locate` says it.
///
/// Threads: any; one scene may answer many calls at a time.
///
/// # Safety
/// As for `splitplane_tree_locate`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_locate(
    scene: Scene,
    points: *const f32,
    point_stride: usize,
    count: usize,
    options: *const QueryOptions,
    windings: *mut i32,
    winding_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(scene)?;
        check_offer(report, "report")?;
        // SAFETY: as the caller says.
        let (query, given) = unsafe {
            (Query::read(options, Uses::LOCATE)?, self::points(points, point_stride, count)?)
        };
        // SAFETY: as the caller says.
        let mut wanted = unsafe { Wanted::new(windings, winding_stride, count, "windings")? };
        wanted.apart_from(&given.places)?;
        let state = current(&object)?;
        let built = &state.built;
        let found = pool::run(query.threads, || {
            located(&given, &mut wanted, &query, |points, watch| {
                built.locate(points, &query.locate(watch))
            })
        })?;
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

/// The point of the scene that is closest to every point, `closest_stride` bytes apart: 40 where nothing is between them. Of equal distances the least (instance, triangle).
///
/// Threads: any; one scene may answer many calls at a time.
///
/// # Safety
/// As for `splitplane_tree_locate`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_closest_points(
    scene: Scene,
    points: *const f32,
    point_stride: usize,
    count: usize,
    options: *const QueryOptions,
    closest: *mut SceneClosestPoint,
    closest_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(scene)?;
        check_offer(report, "report")?;
        let uses = Uses::SCENE_CLOSEST_POINTS;
        // SAFETY: as the caller says.
        let (query, given) =
            unsafe { (Query::read(options, uses)?, self::points(points, point_stride, count)?) };
        let first = closest.cast::<Closest>();
        // SAFETY: as the caller says; the records are the same.
        let mut wanted = unsafe { Wanted::new(first, closest_stride, count, "closest")? };
        wanted.apart_from(&given.places)?;
        let state = current(&object)?;
        let built = &state.built;
        let found = pool::run(query.threads, || {
            batch::points(
                &given,
                &mut wanted,
                Closest::NONE,
                query.caller,
                |points, found, watch| {
                    built.closest_points(points, found, &query.scene_closest(watch))
                },
            )
        })?;
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}
