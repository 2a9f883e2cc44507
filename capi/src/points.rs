//! Trees of points, of 1 to 4 dimensions.

use bytemuck::Pod;
use library::QueryError;
use library::backend::Engine;
use library::points::{
    AnyPointTree, Axes, KeptBytes, NearestOptions, Neighbour as Near, PointOptions,
};

use crate::buffer::{Given, Wanted, check, filled, reserve, write};
use crate::build_settings::Build;
use crate::entry::entry;
use crate::handle::{Backend, Lists, PointTree, free, get, insert};
use crate::lists::Object as ListsObject;
use crate::options::{BuildOptions, QueryOptions, chosen};
use crate::pool;
use crate::progress::watch;
use crate::query_settings::{Query, Uses};
use crate::record::Neighbour;
use crate::status::{Failure, Status};

/// Records that are found at once.
const CHUNK: usize = 1 << 20;
/// What is kept of all within a distance: where a list ends, and its records.
const KEPT: KeptBytes = KeptBytes { list: 8, neighbour: size_of::<Near>() as u64 };

/// What a handle of a point tree names.
pub enum Object {
    /// Numbers.
    One(AnyPointTree<1>),
    /// Points in the plane.
    Two(AnyPointTree<2>),
    /// Points in space.
    Three(AnyPointTree<3>),
    /// Points in space and time.
    Four(AnyPointTree<4>),
}

/// Does the same for the tree of any number of dimensions.
macro_rules! with_tree {
    ($object:expr, $name:ident => $do:expr) => {
        match $object {
            Object::One($name) => $do,
            Object::Two($name) => $do,
            Object::Three($name) => $do,
            Object::Four($name) => $do,
        }
    };
}

/// How axes of a point tree are chosen.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointAxes {
    /// The axis along which the points of a node reach farthest.
    Widest = 0,
    /// By level, one after the other.
    Cycle = 1,
}

/// What a build of points did.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointSummary {
    /// Points given.
    pub points: u32,
    /// Points left out: a coordinate that is not finite.
    pub dropped: u32,
    /// Bytes of the tree and of what searches it.
    pub bytes: u64,
}

/// # Safety
/// As for [`Given::new`].
unsafe fn build<const N: usize>(
    engine: &Engine,
    first: *const f32,
    stride: usize,
    count: usize,
    options: &PointOptions<'_>,
) -> Result<AnyPointTree<N>, Failure>
where
    [f32; N]: Pod,
{
    // SAFETY: as the caller says.
    let given = unsafe { Given::<[f32; N]>::new(first.cast(), stride, count, "points")? };
    let mut copy = Vec::new();
    Ok(engine.points(given.beside(&mut copy)?, options)?)
}

/// Builds a tree of points of 1 to 4 coordinates, `point_stride` bytes apart. It has its own copy. `axes` is a `splitplane_point_axes`; of `options`, which may be NULL, preset, layout and knobs stay
/// the defaults. The backend builds the tree and answers; answers are the same on all.
///
/// Threads: any.
///
/// # Safety
/// So many points are there, `options` says what is there, and `tree` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_point_tree_build(
    backend: Backend,
    points: *const f32,
    point_stride: usize,
    count: usize,
    dimensions: u32,
    axes: u32,
    options: *const BuildOptions,
    tree: *mut PointTree,
) -> Status {
    entry(|| {
        check(tree, "tree")?;
        let opened = get(backend)?;
        // SAFETY: as the caller says.
        let own = unsafe { Build::read(options)? };
        own.for_points()?;
        let known =
            [(PointAxes::Widest as u32, Axes::Widest), (PointAxes::Cycle as u32, Axes::Cycle)];
        let axes = chosen(axes, &known, "choice of axes")?;
        if count > library::core::points::build::MOST_POINTS {
            return Err(Failure::new(Status::Count, format!("{count} points are too many")));
        }
        let max_memory = own.options().max_memory;
        let options = PointOptions { axes, max_memory, watch: watch(&own.caller) };
        let (points, stride, engine) = (Asked(points), point_stride, &opened.engine);
        let object = pool::run(own.threads, || {
            // SAFETY: as the caller says.
            unsafe {
                match dimensions {
                    1 => Ok(Object::One(build(engine, points.first(), stride, count, &options)?)),
                    2 => Ok(Object::Two(build(engine, points.first(), stride, count, &options)?)),
                    3 => Ok(Object::Three(build(engine, points.first(), stride, count, &options)?)),
                    4 => Ok(Object::Four(build(engine, points.first(), stride, count, &options)?)),
                    _ => {
                        let text = format!("a point tree has 1 to 4 dimensions, not {dimensions}");
                        Err(Failure::new(Status::Option, text))
                    }
                }
            }
        })?;
        // SAFETY: there is room.
        unsafe { write(tree, insert(object)?, "tree") }
    })
}

/// A pointer that goes to another thread.
#[derive(Clone, Copy)]
struct Asked(*const f32);

// SAFETY: what it points to can be read from any thread.
unsafe impl Sync for Asked {}
// SAFETY: as above.
unsafe impl Send for Asked {}

impl Asked {
    fn first(self) -> *const f32 {
        self.0
    }
}

/// Frees a point tree. 0 is no mistake.
///
/// Threads: any; calls that use it go on.
#[unsafe(no_mangle)]
pub extern "C" fn splitplane_point_tree_free(tree: PointTree) -> Status {
    entry(|| free(tree))
}

/// Numbers about a point tree.
///
/// Threads: any.
///
/// # Safety
/// `summary` has room for them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_point_tree_get_summary(
    tree: PointTree,
    summary: *mut PointSummary,
) -> Status {
    entry(|| {
        check(summary, "summary")?;
        let object = get(tree)?;
        let (report, bytes) = with_tree!(&*object, tree => (tree.tree().report(), tree.bytes()));
        let found = PointSummary { points: report.points, dropped: report.dropped, bytes };
        // SAFETY: there is room.
        unsafe { write(summary, found, "summary") }
    })
}

/// The digest of a point tree.
///
/// Threads: any.
///
/// # Safety
/// `digest` has room.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_point_tree_digest(tree: PointTree, digest: *mut u64) -> Status {
    entry(|| {
        check(digest, "digest")?;
        let object = get(tree)?;
        let found = with_tree!(&*object, tree => tree.tree().digest().0);
        // SAFETY: there is room.
        unsafe { write(digest, found, "digest") }
    })
}

/// The `k` nearest points of every query, of as many coordinates as the tree's: `k` records a query, one query after the other, `neighbour_stride` bytes from record to record (16 where nothing is
/// between them), the least (distance, point) first. Where there are fewer the rest say `SPLITPLANE_NONE`.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// So many queries are there, `options` says what is there, and `neighbours` has room for `count * k` records, which nobody else uses.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_point_tree_nearest(
    tree: PointTree,
    queries: *const f32,
    query_stride: usize,
    count: usize,
    k: usize,
    options: *const QueryOptions,
    neighbours: *mut Neighbour,
    neighbour_stride: usize,
) -> Status {
    entry(|| {
        let object = get(tree)?;
        // SAFETY: as the caller says.
        let query = unsafe { Query::read(options, Uses::POINTS)? };
        let places = count.checked_mul(k).ok_or_else(|| {
            Failure::new(Status::Count, format!("{k} neighbours of {count} points are too many"))
        })?;
        // SAFETY: as the caller says.
        let mut wanted =
            unsafe { Wanted::new(neighbours, neighbour_stride, places, "neighbours")? };
        with_tree!(&*object, tree => {
            // SAFETY: as the caller says.
            let given = unsafe { Given::new(queries.cast(), query_stride, count, "queries")? };
            wanted.apart_from(&given.places)?;
            pool::run(query.threads, || nearest(tree, &given, k, &query, &mut wanted))
        })
    })
}

fn nearest<const N: usize>(
    tree: &AnyPointTree<N>,
    given: &Given<'_, [f32; N]>,
    k: usize,
    query: &Query,
    wanted: &mut Wanted<'_, Neighbour>,
) -> Result<(), Failure>
where
    [f32; N]: Pod,
{
    let total = given.len();
    if k == 0 || total == 0 {
        return Ok(());
    }
    let chunk = (CHUNK / k).clamp(1, total);
    let held = (chunk.saturating_mul(k).saturating_mul(size_of::<Near>())) as u64;
    if let Some(limit) = query.max_memory.filter(|&limit| held > limit) {
        return Err(QueryError::OutOfMemory { needed: held, limit }.into());
    }
    let max_memory = query.max_memory.map(|limit| limit - held);
    let mut found = filled(chunk * k, Near::NONE)?;
    let keeps = |point| query.point_filter.is_none_or(|filter| filter.keeps(point));
    let filter = query.point_filter.map(|_| -> &(dyn Fn(u32) -> bool + Sync) { &keeps });
    let mut asked = Vec::new();
    for first in (0..total).step_by(chunk) {
        let here = first..total.min(first + chunk);
        asked.clear();
        reserve(&mut asked, here.len())?;
        asked.extend(here.clone().map(|place| given.at(place)));
        let part = query.caller.map(|caller| caller.part(first, total));
        let max_distance = query.max_distance;
        let options = NearestOptions { k, max_distance, filter, max_memory, watch: watch(&part) };
        let found = &mut found[..here.len() * k];
        tree.nearest(&asked, found, &options)?;
        for (place, own) in found.iter().enumerate() {
            wanted.set(first * k + place, Neighbour::of(own));
        }
    }
    Ok(())
}

/// All points within `max_distance` of the options of every query: a list of `splitplane_neighbour` for each, the least (distance, point) first. Read them by `splitplane_lists_size`,
/// `splitplane_lists_starts` and `splitplane_lists_neighbours`, then free them. `max_memory` limits what they take.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// So many queries are there, `options` says what is there, and `lists` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_point_tree_within(
    tree: PointTree,
    queries: *const f32,
    query_stride: usize,
    count: usize,
    options: *const QueryOptions,
    lists: *mut Lists,
) -> Status {
    entry(|| {
        check(lists, "lists")?;
        let object = get(tree)?;
        // SAFETY: as the caller says.
        let query = unsafe { Query::read(options, Uses::POINTS)? };
        let answer = with_tree!(&*object, tree => {
            // SAFETY: as the caller says.
            let given = unsafe { Given::new(queries.cast(), query_stride, count, "queries")? };
            pool::run(query.threads, || within(tree, &given, &query))
        })?;
        // SAFETY: there is room.
        unsafe { write(lists, insert(answer)?, "lists") }
    })
}

fn within<const N: usize>(
    tree: &AnyPointTree<N>,
    given: &Given<'_, [f32; N]>,
    query: &Query,
) -> Result<ListsObject, Failure>
where
    [f32; N]: Pod,
{
    let (mut starts, mut found) = (Vec::new(), Vec::<Near>::new());
    reserve(&mut starts, given.len().saturating_add(1))?;
    starts.push(0);
    // Queries with something between them are copied, and that counts.
    let copied = match given.packed() {
        Some(_) => 0,
        None => (given.len() * size_of::<[f32; N]>()) as u64,
    };
    let (max_distance, caller) = (query.max_distance, watch(&query.caller));
    let max_memory = match query.max_memory {
        Some(limit) if copied > limit => {
            return Err(QueryError::OutOfMemory { needed: copied, limit }.into());
        }
        limit => limit.map(|limit| limit - copied),
    };
    let mut copy = Vec::new();
    let queries = given.beside(&mut copy)?;
    let keeps = |point| query.point_filter.is_none_or(|filter| filter.keeps(point));
    let filter = query.point_filter.map(|_| -> &(dyn Fn(u32) -> bool + Sync) { &keeps });
    let options = NearestOptions { k: 0, max_distance, filter, max_memory, watch: caller };
    tree.for_each_within(queries, &options, KEPT, |some| -> Result<(), Failure> {
        let needed = size_of_val(&found[..]) + size_of_val(some);
        found.try_reserve(some.len()).map_err(|_| Failure::memory(needed))?;
        found.extend_from_slice(some);
        starts.push(found.len());
        Ok(())
    })?;
    Ok(ListsObject::Points { starts, found })
}
