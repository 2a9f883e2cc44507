//! Nearest points and points within a radius: the reference.
//!
//! A walk goes down to the side of each plane on which the query lies, and comes back to the other side where that may hold
//! a point that counts: see [`distance`](crate::points::distance).

use crate::arithmetic::Strict;
use crate::error::{QueryError, check_bytes, refused};
use crate::points::collect::Collector;
use crate::points::distance::{
    NOTHING, Unit, distance_of, distance_squared, key, part, sum_of_squares,
};
use crate::points::tree::summary::Mark;
use crate::points::tree::{BLOCK, PointTree};
use crate::watch::Watch;
use alloc::vec::Vec;
use core::fmt;

/// A point that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// The square of the distance, in the caller's unit; infinity where there is none, and where it is beyond all bounds.
    pub distance_squared: f64,
    /// Index among the caller's points; `u32::MAX` where there is none.
    pub point: u32,
}

impl Neighbour {
    /// The record where there is no further point.
    pub const NONE: Neighbour = Neighbour { distance_squared: f64::INFINITY, point: u32::MAX };

    /// The record of a key.
    pub fn of(unit: Unit, key: u64) -> Neighbour {
        Neighbour { distance_squared: unit.unscaled(distance_of(key)), point: key as u32 }
    }

    /// True where there is one.
    pub fn is_some(&self) -> bool {
        self.point != u32::MAX
    }
}

/// Settings of a search.
#[derive(Clone, Copy)]
pub struct NearestOptions<'a> {
    /// How many points are asked for.
    pub k: usize,
    /// Points farther away do not count, in the caller's unit; one at just this distance does. Squares are compared, as they
    /// are computed. Nothing is within a NaN or a negative distance.
    pub max_distance: f32,
    /// Points for which this is false count as not there. It may be asked more than once or not at all, by any thread, and must
    /// always give the same answer for the same index.
    pub filter: Option<&'a (dyn Fn(u32) -> bool + Sync)>,
    /// The most bytes that a search may hold, answers that the caller has room for aside; `None` for no limit.
    pub max_memory: Option<u64>,
    /// Receives the number of queries that are done, and may cancel the batch.
    pub watch: Option<&'a dyn Watch>,
}

impl Default for NearestOptions<'_> {
    fn default() -> Self {
        NearestOptions {
            k: 1,
            max_distance: f32::INFINITY,
            filter: None,
            max_memory: None,
            watch: None,
        }
    }
}

impl fmt::Debug for NearestOptions<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("NearestOptions")
            .field("k", &self.k)
            .field("max_distance", &self.max_distance)
            .field("filter", &self.filter.map(|_| "a filter"))
            .field("max_memory", &self.max_memory)
            .field("watch", &self.watch)
            .finish()
    }
}

/// Keys from here on do not count; 0 where nothing can be found.
pub fn first_stop<const N: usize>(unit: Unit, query: [f32; N], max_distance: f32) -> u64 {
    if max_distance.is_nan() || max_distance < 0.0 || !query.iter().all(|x| x.is_finite()) {
        return 0;
    }
    let reach = unit.scaled::<Strict>(max_distance);
    // All indices are below the greatest.
    key(part::<Strict>(reach), u32::MAX)
}

/// The k nearest points of a query, least (distance, index) first; fewer where there are fewer. A query with a
/// coordinate that is not finite has none.
///
/// # Errors
/// More memory than allowed, or than the system has.
pub fn nearest<const N: usize>(
    tree: &PointTree<N>,
    query: [f32; N],
    options: &NearestOptions<'_>,
) -> Result<Vec<Neighbour>, QueryError> {
    let k = options.k.min(tree.len());
    let needed = Collector::bytes(k) + (k * size_of::<Neighbour>()) as u64;
    check_bytes(needed, options.max_memory)?;
    let mut collector = Collector::new(k, tree.len()).map_err(|_| refused(needed))?;
    collector.begin(first_stop(tree.unit, query, options.max_distance));
    let filter = |point| options.filter.is_none_or(|filter| filter(point));
    walk(tree, query, collector.stop(), |key| {
        if key < collector.stop() && filter(key as u32) {
            collector.add(key);
        }
        collector.stop()
    });
    let keys = collector.finish();
    let mut found = Vec::new();
    found.try_reserve_exact(keys.len()).map_err(|_| refused(needed))?;
    found.extend(keys.iter().map(|&key| Neighbour::of(tree.unit, key)));
    Ok(found)
}

/// All points within [`NearestOptions::max_distance`] of a query, least (distance, index) first. The filter counts, k does not.
///
/// # Errors
/// More memory than allowed, or than the system has.
pub fn within<const N: usize>(
    tree: &PointTree<N>,
    query: [f32; N],
    options: &NearestOptions<'_>,
) -> Result<Vec<Neighbour>, QueryError> {
    let mut keys: Vec<u64> = Vec::new();
    let mut failed = None;
    let stop = first_stop(tree.unit, query, options.max_distance);
    let each = (size_of::<u64>() + size_of::<Neighbour>()) as u64;
    walk(tree, query, stop, |key| {
        if key < stop && options.filter.is_none_or(|filter| filter(key as u32)) {
            let needed = (keys.len() as u64 + 1) * each;
            let room = check_bytes(needed, options.max_memory);
            let room = room.and_then(|()| keys.try_reserve(1).map_err(|_| refused(needed)));
            match room {
                Ok(()) => keys.push(key),
                Err(error) => failed = Some(error),
            }
        }
        if failed.is_some() { 0 } else { stop }
    });
    if let Some(error) = failed {
        return Err(error);
    }
    keys.sort_unstable();
    let mut found = Vec::new();
    found.try_reserve_exact(keys.len()).map_err(|_| refused(keys.len() as u64 * each))?;
    found.extend(keys.iter().map(|&key| Neighbour::of(tree.unit, key)));
    Ok(found)
}

/// A subtree that waits.
#[derive(Clone, Copy)]
struct Waiting<const N: usize> {
    height: u32,
    block: usize,
    /// How far its space is from the query along each axis, at least.
    gaps: [f32; N],
}

/// Most subtrees that wait: one a level, and the one at hand.
const WAITING: usize = 32;

/// Gives `visit` the keys of points, until no key below `stop` can be left; `visit` returns where that is now.
///
/// Of points at one distance, those with lower indices come early, so a search for few of them does not visit the others: see
/// [`summary`](crate::points::tree::summary).
pub fn walk<const N: usize>(
    tree: &PointTree<N>,
    query: [f32; N],
    mut stop: u64,
    mut visit: impl FnMut(u64) -> u64,
) {
    if tree.is_empty() || stop == 0 {
        return;
    }
    let query = tree.in_units(query);
    let blocks = tree.nodes.len() + 1;
    let [lower, upper] = tree.bounds();
    let mut gaps = [0.0; N];
    for axis in 0..N {
        gaps[axis] = (lower[axis] - query[axis]).max(query[axis] - upper[axis]).max(0.0);
    }
    let root = Waiting { height: tree.height(), block: 0, gaps };
    let (mut stack, mut top) = ([root; WAITING], 1);
    'subtrees: while top > 0 {
        top -= 1;
        let Waiting { mut height, mut block, mut gaps } = stack[top];
        let mut bound = sum_of_squares::<Strict, N>(gaps);
        if key(bound, tree.least_index(block, height)) >= stop.min(NOTHING) {
            continue;
        }
        while height > 0 {
            height -= 1;
            let right = block + (1 << height);
            if right >= blocks {
                continue;
            }
            let node = tree.nodes[right - 1];
            let mark = tree.summary.marks.get(right - 1).copied().unwrap_or(Mark(0));
            if mark.is_one_place() {
                for axis in 0..N {
                    gaps[axis] = (query[axis] - tree.points[block * BLOCK][axis]).abs();
                }
                bound = sum_of_squares::<Strict, N>(gaps);
                if key(bound, mark.least()) >= stop.min(NOTHING) {
                    continue 'subtrees;
                }
            }
            let axis = node.axis as usize;
            let mut far = gaps;
            let is_left = query[axis] < node.plane;
            let gap = if is_left { node.plane - query[axis] } else { query[axis] - node.plane };
            far[axis] = gap.max(gaps[axis]);
            let (left_gaps, right_gaps) = if is_left { (gaps, far) } else { (far, gaps) };
            let is_tie = sum_of_squares::<Strict, N>(far) == bound;
            let left_first = match is_tie {
                true => tree.least_index(block, height) <= tree.least_index(right, height),
                false => is_left,
            };
            let left = Waiting { height, block, gaps: left_gaps };
            let right = Waiting { height, block: right, gaps: right_gaps };
            let (first, second) = if left_first { (left, right) } else { (right, left) };
            stack[top] = second;
            top += 1;
            Waiting { block, gaps, .. } = first;
        }
        let first = block * BLOCK;
        let last = tree.points.len().min(first + BLOCK);
        for place in first..last {
            let squared = distance_squared::<Strict, N>(query, tree.points[place]);
            stop = visit(key(squared, tree.indices[place]));
        }
    }
}
