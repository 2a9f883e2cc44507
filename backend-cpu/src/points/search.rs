//! Searches: sixteen boxes or points at a time, the nearest box first.
//!
//! Distances and bounds are those of [`splitplane_core::points::distance`], operation by operation; so each search gives the
//! reference's points, bit for bit.
//!
//! Where bounds are equal the child with the lowest index comes first, and one that equals the distance that still counts is passed over where no
//! index in it is low enough: see [`splitplane_core::points::tree::summary`].
//!
//! Several searches go down to their first blocks side by side: each step of one waits for the step before, and none for another search.

use splitplane_core::points::distance::{distance_of, key};
use splitplane_core::points::tree::PointTree;

use super::layout::{LEVELS, Line, PointLayout, WIDTH};
use crate::simd::{Compiled, Simd};

/// What is done with points, by key.
pub(super) trait Visitor {
    /// Whether only the least key counts.
    const ONE: bool = false;
    /// Keys from here on are of no interest.
    fn stop(&self) -> u64;
    /// A key below [`Visitor::stop`].
    fn visit(&mut self, key: u64);

    /// Looks at the points of these lanes, of which none is farther than [`Visitor::stop`] said before.
    ///
    /// # Safety
    /// The processor must have the set, and there must be a distance and an index for each bit.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit_lanes<S: Simd>(
        &mut self,
        distances: *const f32,
        points: *const u32,
        near: u32,
    ) {
        let mut near = near;
        while near != 0 {
            let lane = near.trailing_zeros() as usize;
            near &= near - 1;
            // SAFETY: the caller's contract.
            let key = unsafe { key(*distances.add(lane), *points.add(lane)) };
            if key < self.stop() {
                self.visit(key);
            }
        }
    }
}

/// A wide node whose children are being followed.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    squared: Line,
    /// The children that are left, a bit each.
    left: u32,
    node: usize,
}

/// One of each level. What is left there of one search is nothing to the next.
pub(super) type Frames = [Frame; LEVELS];

/// Space for them.
pub(super) const NO_FRAMES: Frames =
    [Frame { squared: Line([0.0; WIDTH]), left: 0, node: 0 }; LEVELS];

/// What is searched: the layout of a tree, and the tree.
#[derive(Clone, Copy)]
pub(super) struct Searched<'a, const N: usize> {
    pub layout: &'a PointLayout<N>,
    pub tree: &'a PointTree<N>,
}

impl<const N: usize> Searched<'_, N> {
    /// Of the children of a wide node whose bounds are all `squared`, the one with the lowest index, if that may be below `stop`; it is
    /// then no longer left. No child that is left has a lower bound.
    #[cold]
    #[inline(never)]
    fn first_of_tied(
        &self,
        frame: &mut Frame,
        level: usize,
        mut tied: u32,
        squared: f32,
        stop: u64,
    ) -> Option<usize> {
        let (mut best, mut least) = (WIDTH, u32::MAX);
        while tied != 0 {
            let lane = tied.trailing_zeros() as usize;
            tied &= tied - 1;
            let block = (frame.node * WIDTH + lane) << (4 * level);
            let own = self.tree.least_index(block, 4 * level as u32);
            if best == WIDTH || own < least {
                (best, least) = (lane, own);
            }
        }
        if key(squared, least) >= stop {
            // All others have a greater key.
            frame.left = 0;
            return None;
        }
        frame.left &= !(1 << best);
        Some(best)
    }
}

/// Shows points to a visitor until none is left that may be of interest.
pub(super) struct Search<'a, const N: usize, V> {
    pub searched: Searched<'a, N>,
    /// In the tree's unit.
    pub query: [f32; N],
    pub visitor: &'a mut V,
    pub frames: &'a mut Frames,
}

impl<const N: usize, V: Visitor> Compiled for Search<'_, N, V> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let Search { searched, query, visitor, frames } = self;
        let levels = searched.layout.levels.len();
        if levels == 0 || visitor.stop() == 0 {
            return;
        }
        let top = levels - 1;
        // SAFETY: the caller's contract.
        unsafe {
            let next = enter::<S, N, V>(searched, &query, visitor, top, 0, &mut frames[top]);
            go_on::<S, N, V>(searched, &query, visitor, frames, top, next);
        }
    }
}

/// Searches side by side.
pub(super) const GROUP: usize = 8;

/// As many searches as there are queries, visitors and frames, at most [`GROUP`].
pub(super) struct GroupSearch<'a, const N: usize, V> {
    pub searched: Searched<'a, N>,
    /// In the tree's unit.
    pub queries: &'a [[f32; N]],
    pub visitors: &'a mut [V],
    pub frames: &'a mut [Frames; GROUP],
}

impl<const N: usize, V: Visitor> Compiled for GroupSearch<'_, N, V> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let GroupSearch { searched, queries, visitors, frames } = self;
        let levels = searched.layout.levels.len();
        if levels == 0 {
            return;
        }
        // Where each is: its level, and the child there that comes next.
        let mut places = [(levels, Some(0)); GROUP];
        for level in (0..levels).rev() {
            let all = queries.iter().zip(visitors.iter()).zip(frames.iter_mut()).zip(&mut places);
            for (((query, visitor), frames), place) in all {
                let (above, Some(lane)) = *place else { continue };
                if above == levels && visitor.stop() == 0 {
                    *place = (levels, None);
                    continue;
                }
                let node = if above == levels { 0 } else { frames[above].node * WIDTH + lane };
                let frame = &mut frames[level];
                // SAFETY: the caller's contract.
                let next =
                    unsafe { enter::<S, N, V>(searched, query, visitor, level, node, frame) };
                *place = (level, next);
            }
        }
        let all = queries.iter().zip(visitors.iter_mut()).zip(frames.iter_mut()).zip(&mut places);
        for (((query, visitor), frames), place) in all {
            if let (0, Some(lane)) = *place {
                let block = frames[0].node * WIDTH + lane;
                // SAFETY: the caller's contract.
                unsafe {
                    visit::<S, N, V>(searched, query, visitor, block);
                    let next = nearest_left::<S, N>(searched, &mut frames[0], 0, visitor.stop());
                    *place = (0, next);
                }
            }
        }
        let all = queries.iter().zip(visitors).zip(frames).zip(places);
        for (((query, visitor), frames), (level, next)) in all {
            if level < levels {
                // SAFETY: the caller's contract.
                unsafe { go_on::<S, N, V>(searched, query, visitor, frames, level, next) };
            }
        }
    }
}

/// Searches from a child of a level on, if one is next there.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn go_on<S: Simd, const N: usize, V: Visitor>(
    searched: Searched<'_, N>,
    query: &[f32; N],
    visitor: &mut V,
    frames: &mut Frames,
    mut level: usize,
    mut next: Option<usize>,
) {
    let top = searched.layout.levels.len() - 1;
    loop {
        let Some(lane) = next else {
            if level == top {
                return;
            }
            level += 1;
            // SAFETY: the caller's contract.
            next = unsafe {
                nearest_left::<S, N>(searched, &mut frames[level], level, visitor.stop())
            };
            continue;
        };
        let child = frames[level].node * WIDTH + lane;
        // SAFETY: the caller's contract.
        next = unsafe {
            if level > 0 {
                level -= 1;
                let frame = &mut frames[level];
                enter::<S, N, V>(searched, query, visitor, level, child, frame)
            } else {
                visit::<S, N, V>(searched, query, visitor, child);
                nearest_left::<S, N>(searched, &mut frames[level], level, visitor.stop())
            }
        };
    }
}

/// The nearest child that is left, if it may hold a key below `stop`; it is then no longer left.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn nearest_left<S: Simd, const N: usize>(
    searched: Searched<'_, N>,
    frame: &mut Frame,
    level: usize,
    stop: u64,
) -> Option<usize> {
    if frame.left == 0 {
        return None;
    }
    let farthest = distance_of(stop);
    // SAFETY: the caller's contract; a line has sixteen numbers.
    unsafe {
        if S::N == WIDTH {
            let squared = S::load(frame.squared.0.as_ptr());
            frame.left &= S::bits(S::le(squared, S::splat(farthest)));
            if frame.left == 0 {
                return None;
            }
            let tied = least_of::<S>(frame.left, squared);
            return first_of::<N>(searched, frame, level, tied, stop);
        }
        let nothing = S::splat(f32::INFINITY);
        let (mut least, mut near) = (nothing, 0);
        for first in (0..WIDTH).step_by(S::N) {
            let squared = S::load(frame.squared.0.as_ptr().add(first));
            let here = S::and(S::mask(frame.left >> first), S::le(squared, S::splat(farthest)));
            near |= S::bits(here) << first;
            least = S::min(least, S::select(here, squared, nothing));
        }
        frame.left = near;
        if near == 0 {
            return None;
        }
        let (at, mut nearest) = (S::splat(S::lowest(least)), 0);
        for first in (0..WIDTH).step_by(S::N) {
            let squared = S::load(frame.squared.0.as_ptr().add(first));
            nearest |= S::bits(S::le(squared, at)) << first;
        }
        // None of those that are left is less.
        first_of::<N>(searched, frame, level, nearest & near, stop)
    }
}

/// The first to follow of children that are left, whose bounds are equal and the least.
#[inline(always)]
fn first_of<const N: usize>(
    searched: Searched<'_, N>,
    frame: &mut Frame,
    level: usize,
    tied: u32,
    stop: u64,
) -> Option<usize> {
    let lane = tied.trailing_zeros() as usize;
    let squared = frame.squared.0[lane % WIDTH];
    if tied & (tied - 1) != 0 || squared == distance_of(stop) {
        return searched.first_of_tied(frame, level, tied, squared, stop);
    }
    frame.left &= !(1 << lane);
    Some(lane)
}

/// The lanes of these that have the least number of theirs.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn least_of<S: Simd>(of: u32, squared: S::Floats) -> u32 {
    // SAFETY: the caller's contract.
    let least = unsafe { S::least(of, squared) } & of;
    // Where all are infinite none may be the least.
    if least == 0 { of } else { least }
}

/// Measures the children of a wide node; the nearest one, if it is near enough, is then no longer left.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn enter<S: Simd, const N: usize, V: Visitor>(
    searched: Searched<'_, N>,
    query: &[f32; N],
    visitor: &V,
    level: usize,
    node: usize,
    frame: &mut Frame,
) -> Option<usize> {
    let layout = searched.layout;
    let children = match level {
        0 => layout.blocks,
        _ => layout.levels[level - 1].len(),
    };
    let there = (children - node * WIDTH).min(WIDTH);
    let boxes = &layout.levels[level][node];
    frame.node = node;
    let mut left = 0;
    for first in (0..WIDTH).step_by(S::N) {
        // SAFETY: the caller's contract; a line has sixteen numbers, and a vector no more.
        unsafe {
            let zero = S::splat(0.0);
            let mut sum = zero;
            for axis in 0..N {
                let [lower, upper] = &boxes[axis];
                let q = S::splat(query[axis]);
                let below = S::sub(S::load(lower.0.as_ptr().add(first)), q);
                let above = S::sub(q, S::load(upper.0.as_ptr().add(first)));
                let part = part::<S>(S::max(S::max(below, above), zero));
                sum = if axis == 0 { part } else { S::add(sum, part) };
            }
            S::store(frame.squared.0.as_mut_ptr().add(first), sum);
            left |= S::bits(S::le(sum, S::splat(distance_of(visitor.stop())))) << first;
            if S::N == WIDTH {
                // As `nearest_left`, without waiting for the store.
                left &= 0xffff >> (WIDTH - there);
                frame.left = left;
                if left == 0 {
                    return None;
                }
                let tied = least_of::<S>(left, sum);
                return first_of::<N>(searched, frame, level, tied, visitor.stop());
            }
        }
    }
    frame.left = left & (0xffff >> (WIDTH - there));
    // SAFETY: the caller's contract.
    unsafe { nearest_left::<S, N>(searched, frame, level, visitor.stop()) }
}

/// Shows the points of a block.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn visit<S: Simd, const N: usize, V: Visitor>(
    searched: Searched<'_, N>,
    query: &[f32; N],
    visitor: &mut V,
    block: usize,
) {
    let layout = searched.layout;
    let indices = &searched.tree.indices()[block * WIDTH..];
    let there = 0xffff >> (WIDTH - indices.len().min(WIDTH));
    let mut row = Line([0.0; WIDTH]);
    for first in (0..WIDTH).step_by(S::N) {
        // SAFETY: the caller's contract; a line has sixteen numbers, and a vector no more. Bits are of lanes with an index.
        unsafe {
            let mut sum = S::splat(0.0);
            for axis in 0..N {
                let line = &layout.lines[axis * layout.blocks + block];
                let p = S::load(line.0.as_ptr().add(first));
                let part = part::<S>(S::sub(S::splat(query[axis]), p));
                sum = if axis == 0 { part } else { S::add(sum, part) };
            }
            S::store(row.0.as_mut_ptr().add(first), sum);
            // A place without a point has no distance that means anything.
            let near = S::bits(S::le(sum, S::splat(distance_of(visitor.stop())))) & there >> first;
            let near = if V::ONE && near & near.wrapping_sub(1) != 0 {
                // Where all are at infinity none is the least.
                let least = S::least(near, sum) & near;
                if least == 0 { near } else { least }
            } else {
                near
            };
            // Beyond the last index nothing is read.
            let points = indices.as_ptr().wrapping_add(first);
            visitor.visit_lanes::<S>(row.0.as_ptr().add(first), points, near);
        }
    }
}

/// The square, snapped.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn part<S: Simd>(difference: S::Floats) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe {
        let square = S::mul(difference, difference);
        S::keep(S::le(S::splat(f32::MIN_POSITIVE), square), square)
    }
}
