//! Queries of trees.

use library::core::query::inside::Located;
use library::{Accelerator, ClosestPoint as Closest, Hit as HitOfMesh, QueryReport, Watch};

use crate::batch::{self, Report};
use crate::buffer::{Given, Wanted, check, check_offer, offer, points, write};
use crate::entry::entry;
use crate::handle::{Lists, Tree, get, insert};
use crate::lists::Object as ListsObject;
use crate::options::QueryOptions;
use crate::pool;
use crate::progress::watch;
use crate::query_settings::{Query, Uses};
use crate::ray::{Rays, View};
use crate::record::{ClosestPoint, Hit};
use crate::status::{Failure, Status};
use crate::tree::{State, look};

/// The winding number of a point that lies on a surface.
pub const BOUNDARY: i32 = i32::MIN;

/// Rays that the calling thread answers by itself, one after the other.
const FEW: usize = 16;

/// Whether a batch is too small to be handed to threads.
fn is_few(count: usize, query: &Query, state: &State) -> bool {
    count <= FEW && query.caller.is_none() && query.threads == 0 && state.opened.is_cpu()
}

/// The closest hit of every ray: the one of least (t, triangle). `hits` has room for one record a ray, `hit_stride` bytes apart: 16 where nothing is between them. `options` and `report` may be
/// NULL. After a failure the records mean nothing.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// `rays` and `options` say what is there, `hits` has the room, and nobody else uses them during the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_closest_hits(
    tree: Tree,
    rays: *const Rays,
    options: *const QueryOptions,
    hits: *mut Hit,
    hit_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(tree)?;
        check_offer(report, "report")?;
        // SAFETY: as the caller says.
        let (query, rays) = unsafe { (Query::read(options, Uses::HITS)?, View::new(rays)?) };
        let first = hits.cast::<HitOfMesh>();
        // SAFETY: as the caller says; the records are the same.
        let mut wanted = unsafe { Wanted::new(first, hit_stride, rays.len(), "hits")? };
        rays.places().try_for_each(|given| wanted.apart_from(given))?;
        let state = look(&object)?;
        let accelerator = &state.accelerator;
        let found = if is_few(rays.len(), &query, &state) {
            for place in 0..rays.len() {
                let hit = accelerator.closest_hit(&rays.at(place), &query.hits(None));
                wanted.set(place, hit.unwrap_or(HitOfMesh::MISS));
            }
            Report::default()
        } else {
            pool::run(query.threads, || {
                batch::rays_of(
                    &rays,
                    &mut wanted,
                    HitOfMesh::MISS,
                    query.caller,
                    |rays, hits, watch| {
                        Ok(accelerator.closest_hits_of(rays, hits, &query.hits(watch))?)
                    },
                )
            })?
        };
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

/// For every ray, whether it hits anything: 1 or 0, `occluded_stride` bytes apart. Otherwise as `splitplane_tree_closest_hits`.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// As for `splitplane_tree_closest_hits`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_any_hits(
    tree: Tree,
    rays: *const Rays,
    options: *const QueryOptions,
    occluded: *mut u8,
    occluded_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(tree)?;
        check_offer(report, "report")?;
        // SAFETY: as the caller says.
        let (query, rays) = unsafe { (Query::read(options, Uses::HITS)?, View::new(rays)?) };
        // SAFETY: as the caller says.
        let mut wanted = unsafe { flags(occluded, occluded_stride, &rays)? };
        let state = look(&object)?;
        let accelerator = &state.accelerator;
        let found = if is_few(rays.len(), &query, &state) {
            for place in 0..rays.len() {
                wanted.set(place, accelerator.any_hit(&rays.at(place), &query.hits(None)));
            }
            Report::default()
        } else {
            pool::run(query.threads, || {
                batch::rays_of(&rays, &mut wanted, false, query.caller, |rays, occluded, watch| {
                    Ok(accelerator.any_hits_of(rays, occluded, &query.hits(watch))?)
                })
            })?
        };
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

/// Room for one byte a ray, all 0.
///
/// # Safety
/// The room is there, and nobody else uses it.
pub(crate) unsafe fn flags<'a>(
    first: *mut u8,
    stride: usize,
    rays: &View<'_>,
) -> Result<Wanted<'a, bool>, Failure> {
    // SAFETY: as the caller says.
    let mut wanted = unsafe { Wanted::new(first.cast::<bool>(), stride, rays.len(), "occluded")? };
    rays.places().try_for_each(|given| wanted.apart_from(given))?;
    wanted.fill(false);
    Ok(wanted)
}

/// All crossings of every ray with surfaces, in order along it, exact: a list of `splitplane_crossing` for each ray. Read them by `splitplane_lists_size`, `splitplane_lists_starts` and
/// `splitplane_lists_crossings`, then free them. `max_memory` of the options limits what they take.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// `rays` and `options` say what is there, and `lists` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_all_hits(
    tree: Tree,
    rays: *const Rays,
    options: *const QueryOptions,
    lists: *mut Lists,
    report: *mut Report,
) -> Status {
    entry(|| {
        check(lists, "lists")?;
        check_offer(report, "report")?;
        let object = get(tree)?;
        // SAFETY: as the caller says.
        let (query, rays) = unsafe { (Query::read(options, Uses::ALL_HITS)?, View::new(rays)?) };
        let state = look(&object)?;
        let accelerator = &state.accelerator;
        let all = pool::run(query.threads, || {
            let options = query.all_hits(watch(&query.caller));
            rays.all(|rays| Ok(accelerator.all_hits(rays, &options)?))
        })?;
        let mut found = Report::default();
        found.add(&all.report);
        let handle = insert(ListsObject::Tree(all))?;
        // SAFETY: as the caller says.
        unsafe { write(lists, handle, "lists").and_then(|()| offer(report, found, "report")) }
    })
}

/// How many crossings every ray has with surfaces, `count_stride` bytes apart.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// As for `splitplane_tree_closest_hits`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_count_hits(
    tree: Tree,
    rays: *const Rays,
    options: *const QueryOptions,
    counts: *mut u64,
    count_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(tree)?;
        check_offer(report, "report")?;
        // SAFETY: as the caller says.
        let (query, rays) = unsafe { (Query::read(options, Uses::ALL_HITS)?, View::new(rays)?) };
        // SAFETY: as the caller says.
        let mut wanted = unsafe { Wanted::new(counts, count_stride, rays.len(), "counts")? };
        rays.places().try_for_each(|given| wanted.apart_from(given))?;
        let state = look(&object)?;
        let accelerator = &state.accelerator;
        let found = pool::run(query.threads, || {
            batch::rays(&rays, &mut wanted, 0u64, query.caller, |rays, counts, watch| {
                let all = accelerator.all_hits(rays, &query.all_hits(watch))?;
                for (count, ends) in counts.iter_mut().zip(all.starts.windows(2)) {
                    *count = (ends[1] - ends[0]) as u64;
                }
                Ok(all.report)
            })
        })?;
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

/// How often the surface winds around every point, `winding_stride` bytes apart: 0 outside, `SPLITPLANE_BOUNDARY` on a triangle. A closed surface whose corners run counter-clockwise as seen from
/// outside winds once around the points in it. Decided exactly; for surfaces that are not closed it means little.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// `points` and `options` say what is there, `windings` has the room, and nobody else uses them during the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_locate(
    tree: Tree,
    points: *const f32,
    point_stride: usize,
    count: usize,
    options: *const QueryOptions,
    windings: *mut i32,
    winding_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(tree)?;
        check_offer(report, "report")?;
        // SAFETY: as the caller says.
        let (query, given) = unsafe {
            (Query::read(options, Uses::LOCATE)?, self::points(points, point_stride, count)?)
        };
        // SAFETY: as the caller says.
        let mut wanted = unsafe { Wanted::new(windings, winding_stride, count, "windings")? };
        wanted.apart_from(&given.places)?;
        let state = look(&object)?;
        let accelerator = &state.accelerator;
        let found = pool::run(query.threads, || {
            located(&given, &mut wanted, &query, |points, watch| {
                Ok(accelerator.locate(points, &query.locate(watch))?)
            })
        })?;
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

/// Winding numbers of points.
pub(crate) fn located(
    given: &Given<'_, [f32; 3]>,
    wanted: &mut Wanted<'_, i32>,
    query: &Query,
    ask: impl Fn(&[[f32; 3]], Option<&dyn Watch>) -> Result<Located, Failure> + Sync,
) -> Result<Report, Failure> {
    batch::points(given, wanted, 0, query.caller, |points, windings, watch| {
        let located = ask(points, watch)?;
        for (own, winding) in windings.iter_mut().zip(&located.windings) {
            *own = winding.unwrap_or(BOUNDARY);
        }
        Ok(located.report)
    })
}

/// The point of the mesh that is closest to every point, `closest_stride` bytes apart: 32 where nothing is between them. Of equal distances the least triangle. `max_distance` of the options
/// makes the search faster.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// As for `splitplane_tree_locate`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_closest_points(
    tree: Tree,
    points: *const f32,
    point_stride: usize,
    count: usize,
    options: *const QueryOptions,
    closest: *mut ClosestPoint,
    closest_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(tree)?;
        check_offer(report, "report")?;
        // SAFETY: as the caller says.
        let (query, given) = unsafe {
            (
                Query::read(options, Uses::CLOSEST_POINTS)?,
                self::points(points, point_stride, count)?,
            )
        };
        let first = closest.cast::<Closest>();
        // SAFETY: as the caller says; the records are the same.
        let mut wanted = unsafe { Wanted::new(first, closest_stride, count, "closest")? };
        wanted.apart_from(&given.places)?;
        let state = look(&object)?;
        let accelerator = &state.accelerator;
        let found = pool::run(query.threads, || {
            batch::points(
                &given,
                &mut wanted,
                Closest::NONE,
                query.caller,
                |points, found, watch| {
                    Ok(accelerator.closest_points(points, found, &query.closest(watch))?)
                },
            )
        })?;
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

/// The distance of every point from the surface, `distance_stride` bytes apart: negative inside, where the winding number is not 0, and 0 on it. Infinity where the mesh has no triangles.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// As for `splitplane_tree_locate`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_signed_distances(
    tree: Tree,
    points: *const f32,
    point_stride: usize,
    count: usize,
    options: *const QueryOptions,
    distances: *mut f64,
    distance_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        let object = get(tree)?;
        check_offer(report, "report")?;
        // SAFETY: as the caller says.
        let (query, given) = unsafe {
            (Query::read(options, Uses::SIGNED)?, self::points(points, point_stride, count)?)
        };
        // SAFETY: as the caller says.
        let mut wanted = unsafe { Wanted::new(distances, distance_stride, count, "distances")? };
        wanted.apart_from(&given.places)?;
        let state = look(&object)?;
        let accelerator = &*state.accelerator;
        let found = pool::run(query.threads, || {
            batch::points(&given, &mut wanted, 0.0, query.caller, |points, signed, watch| {
                signed_distances(accelerator, points, signed, &query, watch)
            })
        })?;
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

fn signed_distances(
    accelerator: &dyn Accelerator,
    points: &[[f32; 3]],
    signed: &mut [f64],
    query: &Query,
    watch: Option<&dyn Watch>,
) -> Result<QueryReport, Failure> {
    let mut closest = crate::buffer::filled(points.len(), Closest::NONE)?;
    let mut report = accelerator.closest_points(points, &mut closest, &query.closest(None))?;
    let located = accelerator.locate(points, &query.locate(watch))?;
    for ((signed, closest), winding) in signed.iter_mut().zip(closest).zip(&located.windings) {
        let distance = closest.distance_squared.sqrt();
        *signed = match winding {
            None => 0.0,
            Some(0) => distance,
            Some(_) => -distance,
        };
    }
    report.append(located.report, 0)?;
    Ok(report)
}
