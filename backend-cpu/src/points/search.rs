//! A search: sixteen boxes or points at a time, the nearest box first.
//!
//! Distances and bounds are those of [`splitplane_core::points::distance`], operation by operation; so each search gives the
//! reference's points, bit for bit.

use splitplane_core::points::distance::{distance_of, key};

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

/// Shows points to a visitor until none is left that may be of interest.
pub(super) struct Search<'a, const N: usize, V> {
    pub layout: &'a PointLayout<N>,
    /// In the tree's unit.
    pub query: [f32; N],
    pub visitor: &'a mut V,
    pub frames: &'a mut Frames,
}

impl<const N: usize, V: Visitor> Compiled for Search<'_, N, V> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        // SAFETY: the caller's contract.
        unsafe { search::<S, N, V>(self.layout, &self.query, self.visitor, self.frames) }
    }
}

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn search<S: Simd, const N: usize, V: Visitor>(
    layout: &PointLayout<N>,
    query: &[f32; N],
    visitor: &mut V,
    frames: &mut Frames,
) {
    let levels = layout.levels.as_slice();
    if levels.is_empty() || visitor.stop() == 0 {
        return;
    }
    let top = levels.len() - 1;
    let mut level = top;
    // SAFETY: the caller's contract.
    let mut next =
        unsafe { enter::<S, N, V>(layout, query, visitor, level, 0, &mut frames[level]) };
    loop {
        let Some(lane) = next else {
            if level == top {
                return;
            }
            level += 1;
            // SAFETY: the caller's contract.
            next = unsafe { nearest_left::<S>(&mut frames[level], distance_of(visitor.stop())) };
            continue;
        };
        let child = frames[level].node * WIDTH + lane;
        // SAFETY: the caller's contract.
        next = unsafe {
            if level > 0 {
                level -= 1;
                enter::<S, N, V>(layout, query, visitor, level, child, &mut frames[level])
            } else {
                visit::<S, N, V>(layout, query, visitor, child);
                nearest_left::<S>(&mut frames[level], distance_of(visitor.stop()))
            }
        };
    }
}

/// The nearest child that is left, if it is near enough; it is then no longer left.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn nearest_left<S: Simd>(frame: &mut Frame, stop: f32) -> Option<usize> {
    if frame.left == 0 {
        return None;
    }
    // SAFETY: the caller's contract; a line has sixteen numbers.
    unsafe {
        let mut lane = 0;
        if S::N == WIDTH {
            let squared = S::load(frame.squared.0.as_ptr());
            frame.left &= S::bits(S::le(squared, S::splat(stop)));
            if frame.left == 0 {
                return None;
            }
            lane = least_of::<S>(frame.left, squared);
        } else {
            let (mut left, mut best) = (frame.left, f32::INFINITY);
            let mut found = false;
            while left != 0 {
                let here = left.trailing_zeros() as usize;
                left &= left - 1;
                let squared = frame.squared.0[here];
                if squared > stop {
                    frame.left &= !(1 << here);
                } else if squared < best || !found {
                    (lane, best, found) = (here, squared, true);
                }
            }
            if !found {
                return None;
            }
        }
        frame.left &= !(1 << lane);
        Some(lane)
    }
}

/// The first of these lanes that has the least number of theirs.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn least_of<S: Simd>(of: u32, squared: S::Floats) -> usize {
    // SAFETY: the caller's contract.
    let least = unsafe { S::least(of, squared) } & of;
    // Where all are infinite none may be the least.
    (if least == 0 { of } else { least }).trailing_zeros() as usize
}

/// Measures the children of a wide node; the nearest one, if it is near enough, is then no longer left.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn enter<S: Simd, const N: usize, V: Visitor>(
    layout: &PointLayout<N>,
    query: &[f32; N],
    visitor: &V,
    level: usize,
    node: usize,
    frame: &mut Frame,
) -> Option<usize> {
    let children = match level {
        0 => layout.coordinates.len(),
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
                if left == 0 {
                    frame.left = 0;
                    return None;
                }
                let lane = least_of::<S>(left, sum);
                frame.left = left & !(1 << lane);
                return Some(lane);
            }
        }
    }
    frame.left = left & (0xffff >> (WIDTH - there));
    // SAFETY: the caller's contract.
    unsafe { nearest_left::<S>(frame, distance_of(visitor.stop())) }
}

/// Shows the points of a block.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn visit<S: Simd, const N: usize, V: Visitor>(
    layout: &PointLayout<N>,
    query: &[f32; N],
    visitor: &mut V,
    block: usize,
) {
    let (coordinates, indices) = (&layout.coordinates[block], &layout.indices[block]);
    let there = 0xffff >> (WIDTH - (layout.points - block * WIDTH).min(WIDTH));
    let mut row = Line([0.0; WIDTH]);
    for first in (0..WIDTH).step_by(S::N) {
        // SAFETY: the caller's contract; a line has sixteen numbers, and a vector no more.
        let mut near = unsafe {
            let mut sum = S::splat(0.0);
            for axis in 0..N {
                let p = S::load(coordinates[axis].0.as_ptr().add(first));
                let part = part::<S>(S::sub(S::splat(query[axis]), p));
                sum = if axis == 0 { part } else { S::add(sum, part) };
            }
            S::store(row.0.as_mut_ptr().add(first), sum);
            // A place without a point has no distance that means anything.
            let near = S::bits(S::le(sum, S::splat(distance_of(visitor.stop())))) & there >> first;
            if V::ONE && near & near.wrapping_sub(1) != 0 {
                // Where all are at infinity none is the least.
                let least = S::least(near, sum) & near;
                if least == 0 { near } else { least }
            } else {
                near
            }
        };
        while near != 0 {
            let place = first + near.trailing_zeros() as usize;
            near &= near - 1;
            let key = key(row.0[place], indices[place]);
            if key < visitor.stop() {
                visitor.visit(key);
            }
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
