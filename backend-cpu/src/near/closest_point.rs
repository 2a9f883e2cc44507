//! Closest points, through the wide nodes of rays.
//!
//! A step is a wide node, whose boxes are measured all at once, or a block, whose triangles are: first their boxes, then, where one is near enough,
//! a [bound](super::triangle_bound) that is nearly their distance. All that is in `f32`, and passes over only what is certainly too far; what is left
//! is computed as the reference does ([`splitplane_core::query::closest_point`]), in `f64`. So the answers are the reference's, bit for bit.
//!
//! *Units.* Coordinates are multiplied by a power of two that brings R, the greatest distance of the point to a side of the scene's box, to
//! between 1 and 2; so squares neither overflow nor, where it matters, underflow.
//!
//! *The error of a measured distance.* u is 2^-24. A coordinate loses nothing by the power of two, but for 2^-150 where it becomes subnormal.
//! A difference rounds once, a square doubles that and rounds again, a sum of three rounds twice: 5 u of the squared distance. [`MEASURED`] is
//! 16 u. What underflow takes is less than 2^-148 of a distance, far below the square of the reference's slack, which is at least 2^-94 here.

use std::collections::TryReserveError;

use splitplane_core::arithmetic::{exponent, power_of_two, snap};
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions, Search};
use splitplane_core::triangle::Triangle;

use crate::layout::tree_layout::TreeLayout;
use crate::layout::wide_node::{
    CacheLine, DONE, bounds_offset, children_offset, is_leaf, leaf_number, lines_of_node,
};
use crate::memory::lengthen;
use crate::near::triangle_bound;
use crate::simd::{Compiled, MOST_LANES, Simd};
use crate::trace::leaves::{IndexedLeaves, Leaves, PackedLeaves};
use crate::trace::triangle_block::{TriangleBlock, WrittenBlock};

/// By this much more than the reference's limit a squared distance may be measured: 16 u.
const MEASURED: f64 = 9.536_743_164_062_5e-7; // 2^-20

/// Points that are searched from by one thread. The layout must be made for the width of the set.
pub(crate) struct ClosestPoints<'a> {
    pub layout: &'a TreeLayout,
    pub points: &'a [[f32; 3]],
    pub closest: &'a mut [ClosestPoint],
    pub options: &'a ClosestPointOptions<'a>,
}

/// A child that waits to be visited, and its measured squared distance.
#[derive(Clone, Copy)]
struct Waiting {
    squared: f32,
    child: u32,
}

impl Compiled for ClosestPoints<'_> {
    /// An error where there is no memory for a stack.
    type Output = Result<(), TryReserveError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<(), TryReserveError> {
        let ClosestPoints { layout, points, closest, options } = self;
        let mut stack = Vec::new();
        lengthen(&mut stack, layout.wide.stack(), Waiting { squared: 0.0, child: DONE })?;
        // SAFETY: the caller's contract.
        unsafe {
            match IndexedLeaves::of(layout) {
                None => {
                    let leaves = PackedLeaves::new(layout);
                    search_all::<S, _>(layout, leaves, points, closest, options, &mut stack);
                }
                Some(leaves) => {
                    search_all::<S, IndexedLeaves<'_>>(
                        layout, leaves, points, closest, options, &mut stack,
                    );
                }
            }
        }
        Ok(())
    }
}

/// # Safety
/// As for [`Compiled::run`]; the stack must have as many entries as the nodes need.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn search_all<S: Simd, L: Leaves>(
    layout: &TreeLayout,
    leaves: L,
    points: &[[f32; 3]],
    closest: &mut [ClosestPoint],
    options: &ClosestPointOptions<'_>,
    stack: &mut [Waiting],
) {
    let (bounds, lines) = (&layout.tree.bounds, layout.wide.lines());
    // The last answer's triangle is a good guess for the next point where points are neighbours.
    let mut guess = None;
    let mut room = L::room();
    for (&point, closest) in points.iter().zip(closest) {
        *closest = ClosestPoint::NONE;
        let Some(search) = Search::new(point, bounds, options) else { continue };
        let point = point.map(snap);
        let mut reach = 0.0f32;
        for axis in 0..3 {
            // May be infinite.
            reach = reach.max(bounds.hi[axis] - point[axis]).max(point[axis] - bounds.lo[axis]);
        }
        let unit = if reach == 0.0 { 1.0 } else { power_of_two(-exponent(reach)) };
        let mut search = Measured {
            search,
            unit,
            point: point.map(|x| x * unit),
            stop: 0.0,
            triangle_stop: 0.0,
        };
        search.measure();
        if let Some((triangle, corners)) = &guess {
            search.test(corners, *triangle, &mut None);
        }
        // SAFETY: the caller's contract.
        unsafe { search.run::<S, L>(lines, leaves, &mut room, stack, &mut guess) };
        *closest = search.search.best();
    }
}

/// A search, and what vectors need of it.
struct Measured {
    search: Search,
    /// Coordinates are measured in this unit.
    unit: f32,
    /// The point in that unit.
    point: [f32; 3],
    /// A measured squared distance that is greater is certainly too far.
    stop: f32,
    /// A bound of a triangle's squared distance that is greater is certainly too far.
    triangle_stop: f32,
}

/// [`Measured::visit_block`] of a block with corners written out, in a function of its own, as for rays
/// ([`test_either`](crate::trace::block_test::test_either)).
struct VisitWritten<'a, 'b> {
    measured: &'a mut Measured,
    block: WrittenBlock<'b>,
    guess: &'a mut Option<(u32, Triangle)>,
}

impl Compiled for VisitWritten<'_, '_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let VisitWritten { measured, block, guess } = self;
        // SAFETY: the caller's contract.
        unsafe { measured.visit_block::<S, _>(&block, guess) }
    }
}

impl Measured {
    /// Computes `stop` and `triangle_stop` anew.
    #[inline]
    fn measure(&mut self) {
        let unit = f64::from(self.unit);
        let stop = self.search.stop() * (unit * unit);
        self.stop = (stop * (1.0 + MEASURED)) as f32;
        self.triangle_stop = triangle_bound::widened(stop);
    }

    /// Tests a triangle; the closest one so far becomes the guess.
    #[inline]
    fn test(&mut self, corners: &Triangle, triangle: u32, guess: &mut Option<(u32, Triangle)>) {
        if self.search.test(corners, triangle) {
            *guess = Some((triangle, *corners));
            self.measure();
        }
    }

    /// The squared distances to boxes.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn squared<S: Simd>(&self, lower: [S::Floats; 3], upper: [S::Floats; 3]) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe {
            let (unit, zero) = (S::splat(self.unit), S::splat(0.0));
            let mut sum = zero;
            for axis in 0..3 {
                let at = S::splat(self.point[axis]);
                let below = S::sub(S::mul(lower[axis], unit), at);
                let above = S::sub(at, S::mul(upper[axis], unit));
                let outside = S::max(S::max(below, above), zero);
                sum = S::add(sum, S::mul(outside, outside));
            }
            sum
        }
    }

    /// Searches the whole tree.
    ///
    /// # Safety
    /// As for [`search_all`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd, L: Leaves>(
        &mut self,
        lines: &[CacheLine],
        leaves: L,
        room: &mut L::Room,
        stack: &mut [Waiting],
        guess: &mut Option<(u32, Triangle)>,
    ) {
        if lines.is_empty() {
            return;
        }
        let (mut child, mut top) = (0, 0);
        loop {
            // SAFETY: children are those of a node; the stack has the space.
            unsafe {
                if is_leaf(child) {
                    self.visit::<S, L>(leaves, leaf_number(child), room, guess);
                } else {
                    top = self.spread::<S>(lines, child, stack, top);
                }
            }
            child = loop {
                if top == 0 {
                    return;
                }
                top -= 1;
                let Waiting { squared, child } = stack[top];
                if squared <= self.stop {
                    break child;
                }
            };
        }
    }

    /// Puts the children of a node that are near enough on the stack, the nearest last. Returns how many entries there are.
    ///
    /// # Safety
    /// The processor must have the set; the node must be one of the lines.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn spread<S: Simd>(
        &self,
        lines: &[CacheLine],
        node: u32,
        stack: &mut [Waiting],
        mut top: usize,
    ) -> usize {
        let mut row = [0.0f32; MOST_LANES];
        // SAFETY: the caller's contract.
        let (mut near, children) = unsafe {
            let node = lines.as_ptr().add(node as usize * lines_of_node(S::N)).cast::<u8>();
            let side = |axis, upper| S::load(node.add(bounds_offset(S::N, axis, upper)).cast());
            let (lower, upper) = (
                [side(0, false), side(1, false), side(2, false)],
                [side(0, true), side(1, true), side(2, true)],
            );
            let squared = self.squared::<S>(lower, upper);
            // Places without a child have sides in the wrong order.
            let there = S::le(lower[0], upper[0]);
            let near = S::and(S::le(squared, S::splat(self.stop)), there);
            S::store(row.as_mut_ptr(), squared);
            (S::bits(near), node.add(children_offset(S::N)).cast::<u32>())
        };
        let first = top;
        while near != 0 {
            let lane = near.trailing_zeros() as usize;
            near &= near - 1;
            // SAFETY: a lane of the node.
            let entry = Waiting { squared: row[lane], child: unsafe { *children.add(lane) } };
            // They are few: by insertion.
            let mut place = top;
            while place > first && stack[place - 1].squared < entry.squared {
                stack[place] = stack[place - 1];
                place -= 1;
            }
            stack[place] = entry;
            top += 1;
        }
        top
    }

    /// Tests the triangles of a leaf.
    ///
    /// # Safety
    /// The processor must have the set; the leaf must be one that a node names.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit<S: Simd, L: Leaves>(
        &mut self,
        leaves: L,
        leaf: u32,
        room: &mut L::Room,
        guess: &mut Option<(u32, Triangle)>,
    ) {
        let mut from = 0;
        loop {
            // SAFETY: the caller's contract.
            let (block, next) = unsafe { leaves.block::<S>(leaf, from, room) };
            // SAFETY: the caller's contract.
            unsafe {
                if S::WRITES_OUT
                    && let Some(block) = L::written::<S>(&block)
                {
                    S::call(VisitWritten { measured: &mut *self, block, guess: &mut *guess });
                } else {
                    self.visit_block::<S, _>(&block, guess);
                }
            }
            from = next;
            if L::ONE || from == 0 {
                return;
            }
        }
    }

    /// Tests the triangles of a block whose bounds are near enough.
    ///
    /// # Safety
    /// The processor must have the set, and a block of its width must follow the triangles' words.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit_block<S: Simd, B: TriangleBlock>(
        &mut self,
        block: &B,
        guess: &mut Option<(u32, Triangle)>,
    ) {
        let mut row = [0.0f32; MOST_LANES];
        // Lanes after the last triangle do not count.
        let all = (1u32 << block.count()) - 1;
        // SAFETY: the caller's contract.
        let mut near = unsafe {
            let places = block.places::<S>();
            let zero = [S::splat(0.0); 3];
            let (mut lower, mut upper) = (zero, zero);
            let mut corners = [zero; 3];
            let unit = S::splat(self.unit);
            for axis in 0..3 {
                let mut vectors = [block.coordinates::<S>(axis, 0); 3];
                for vector in 1..B::VECTORS {
                    vectors[vector] = block.coordinates::<S>(axis, vector);
                }
                let [a, b, c] = B::of_corners::<S>(vectors, places);
                lower[axis] = S::min(S::min(a, b), c);
                upper[axis] = S::max(S::max(a, b), c);
                let at = S::splat(self.point[axis]);
                corners[0][axis] = S::mul_sub(a, unit, at);
                corners[1][axis] = S::mul_sub(b, unit, at);
                corners[2][axis] = S::mul_sub(c, unit, at);
            }
            let squared = self.squared::<S>(lower, upper);
            let near = all & S::bits(S::le(squared, S::splat(self.stop)));
            if near == 0 {
                return;
            }
            let bounds = triangle_bound::squared_bounds::<S>(corners);
            S::store(row.as_mut_ptr(), bounds);
            near & S::bits(S::le(bounds, S::splat(self.triangle_stop)))
        };
        while near != 0 {
            // The one that seems nearest first: after it few are left.
            // SAFETY: lanes of the row.
            let least = near & unsafe { S::least(near, S::load(row.as_ptr())) };
            let lane = least.trailing_zeros() as usize;
            if row[lane] > self.triangle_stop {
                return;
            }
            near &= !(1 << lane);
            let triangle = block.triangle(lane);
            // It may be in many leaves.
            if triangle != self.search.best_triangle() {
                self.test(&block.corners(lane), triangle, guess);
            }
        }
    }
}
