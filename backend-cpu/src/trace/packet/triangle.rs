//! One triangle against all rays of a group.

use splitplane_core::query::intersect::STOP_SLACK;
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Culling, QueryOptions};

use super::PacketRays;
use super::group::Group;
use super::packet_block::PacketBlock;
use super::row::{GroupRow, load, put};
use crate::simd::{Compiled, Simd};
use crate::trace::block_test::decide;
use crate::trace::fast;
use crate::trace::refined::Pairs;
use crate::trace::watertight::{Corner, Meeting, Met, View, enclosed, meet, or_zero};

impl Group {
    /// Decides a triangle for some rays by the reference test. Returns those whose best hit
    /// changed.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn decide<'b, T: PacketBlock<'b>>(
        &mut self,
        block: &T,
        index: usize,
        mut unclear: u32,
        rays: &PacketRays<'_>,
        options: &QueryOptions<'_>,
    ) -> u32 {
        let mut taken = 0;
        while unclear != 0 {
            let lane = unclear.trailing_zeros() as usize;
            unclear &= unclear - 1;
            let ray = rays.ready.ray(rays.first + lane);
            let Some(found) = decide(&ray, &block.corners(index), options) else { continue };
            let mut best = self.best(lane);
            if best.take(&ray, &found, block.triangle(index)) {
                self.set(lane, &best);
                taken |= 1 << lane;
            }
        }
        taken
    }

    /// The rays that the edges of a triangle enclose, as the test finds them.
    ///
    /// # Safety
    /// As for [`super::Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn within<'b, S: Simd, T: PacketBlock<'b>>(
        &self,
        block: &T,
        rays: &PacketRays<'_>,
        index: usize,
    ) -> u32 {
        // SAFETY: the caller's contract.
        unsafe { enclosed(&ShearedTriangle::<S>::new(rays, self.axes, block, index)) }
    }

    /// The watertight test of one triangle against some rays; keeps the hits that precede. Returns
    /// the rays whose best hit changed, and those for which the reference must decide.
    ///
    /// # Safety
    /// As for [`super::Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn test<'b, S: Simd, T: PacketBlock<'b>>(
        &mut self,
        block: &T,
        rays: &PacketRays<'_>,
        index: usize,
        active: u32,
        culling: Culling,
        query: Query,
    ) -> (u32, u32) {
        // SAFETY: the caller's contract.
        unsafe {
            let seen = ShearedTriangle::<S>::new(rays, self.axes, block, index);
            let span = rays.span::<S>(&self.beyond);
            let Some(mut meeting) = meet(&seen, active, &span, culling) else { return (0, 0) };
            if meeting.unclear & meeting.robust != 0 {
                let (mut met, beyond) = (Met::of(&meeting), &self.beyond);
                S::call(GroupCloserLook { rays, block, index, beyond, met: &mut met });
                meeting = met.meeting();
            }
            let Meeting { met, unclear, t, v, w, det, .. } = meeting;
            (self.take::<S, _>(block, rays, index, met, [t, v, w, det], query), unclear)
        }
    }

    /// Keeps the hits of one triangle that are within the limits and precede: inner `t`, edge functions opposite the second and the
    /// third corner, and the sum of all three. Returns the rays whose best hit changed.
    ///
    /// # Safety
    /// As for [`super::Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn take<'b, S: Simd, T: PacketBlock<'b>>(
        &mut self,
        block: &T,
        rays: &PacketRays<'_>,
        index: usize,
        met: u32,
        [inner, v, w, det]: [S::Floats; 4],
        query: Query,
    ) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            // The caller's t: packets hold no moved rays.
            let most = S::splat(f32::MAX);
            let t = S::mul(inner, load::<S>(&self.outwards));
            let t = or_zero::<S>(S::min(S::max(t, S::splat(-f32::MAX)), most), f32::MIN_POSITIVE);
            let within = S::le(rays.row::<S>(&rays.ready.limits[0]), t);
            let within = S::and(within, S::le(t, rays.row::<S>(&rays.ready.limits[1])));
            let met = met & S::bits(within);
            let triangle = S::splat(f32::from_bits(block.triangle(index)));
            if query == Query::Any {
                put::<S>(S::mask(met), &mut self.triangle, triangle);
                return met;
            }
            let best = load::<S>(&self.t);
            let mut taken = met & !S::bits(S::le(best, t));
            let mut tied = met & S::bits(S::and(S::le(best, t), S::le(t, best)));
            while tied != 0 {
                let lane = tied.trailing_zeros() as usize;
                tied &= tied - 1;
                let lower = block.triangle(index) < self.triangle.0[lane].to_bits();
                taken |= u32::from(lower) << lane;
            }
            if taken != 0 {
                let mask = S::mask(taken);
                put::<S>(mask, &mut self.t, t);
                put::<S>(mask, &mut self.triangle, triangle);
                put::<S>(mask, &mut self.v, v);
                put::<S>(mask, &mut self.w, w);
                put::<S>(mask, &mut self.det, det);
                // As `PreparedRay::stop_after`: values that are flushed to 0 or clamped are equal
                // outside.
                let slack = S::mul(S::abs(inner), S::splat(STOP_SLACK));
                let stop = S::max(S::add(inner, slack), load::<S>(&self.least));
                let clamped = S::le(most, S::abs(t));
                put::<S>(mask, &mut self.beyond, S::select(clamped, S::splat(f32::INFINITY), stop));
            }
            taken
        }
    }

    /// The fast test of one triangle against some rays; keeps the hits that precede. Returns the rays whose best hit changed.
    ///
    /// # Safety
    /// As for [`super::Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn test_fast<'b, S: Simd, T: PacketBlock<'b>>(
        &mut self,
        block: &T,
        rays: &PacketRays<'_>,
        index: usize,
        active: u32,
        culling: Culling,
        query: Query,
    ) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            let origin = rays.rows::<S>(&rays.ready.origin);
            let direction = rays.rows::<S>(&rays.ready.direction);
            let corners = corners::<S, _>(block, index, [0, 1, 2]);
            let limit = S::min(load::<S>(&self.beyond), rays.row::<S>(&rays.ready.t_max));
            let span = [rays.row::<S>(&rays.ready.t_min), limit];
            let meeting = fast::meet::<S>(origin, direction, corners, span, culling);
            let met = meeting.met & active;
            if met == 0 {
                return 0;
            }
            let found = [meeting.t, meeting.u, meeting.v, S::splat(1.0)];
            self.take::<S, _>(block, rays, index, met, found, query)
        }
    }
}

/// One triangle's corners in all lanes, each on three axes.
///
/// # Safety
/// The processor must have the set; the triangle must be one of the block's.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn corners<'b, S: Simd, T: PacketBlock<'b>>(
    block: &T,
    index: usize,
    [x, y, z]: [usize; 3],
) -> [[S::Floats; 3]; 3] {
    // SAFETY: the caller's contract.
    unsafe {
        let (x, y, z) = (block.row(x), block.row(y), block.row(z));
        let [a, b, c] = block.places_of(index);
        [
            [S::splat(*x.add(a)), S::splat(*y.add(a)), S::splat(*z.add(a))],
            [S::splat(*x.add(b)), S::splat(*y.add(b)), S::splat(*z.add(b))],
            [S::splat(*x.add(c)), S::splat(*y.add(c)), S::splat(*z.add(c))],
        ]
    }
}

/// One triangle as the rays see it.
struct ShearedTriangle<S: Simd> {
    corners: [Corner<S>; 3],
}

impl<S: Simd> ShearedTriangle<S> {
    /// # Safety
    /// As for [`super::Packet::trace`]; the triangle must be one of the block's.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn new<'b, T: PacketBlock<'b>>(
        rays: &PacketRays<'_>,
        axes: [usize; 3],
        block: &T,
        index: usize,
    ) -> ShearedTriangle<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let origin = rays.rows::<S>(&rays.ready.sheared_origin);
            let shear = rays.rows::<S>(&rays.ready.shear);
            let [a, b, c] = corners::<S, _>(block, index, axes);
            let corners = [
                Corner::new(a, origin, shear),
                Corner::new(b, origin, shear),
                Corner::new(c, origin, shear),
            ];
            ShearedTriangle { corners }
        }
    }
}

impl<S: Simd> View<S> for ShearedTriangle<S> {
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn flat(&self) -> [[S::Floats; 3]; 2] {
        let [a, b, c] = &self.corners;
        [[a.flat[0], b.flat[0], c.flat[0]], [a.flat[1], b.flat[1], c.flat[1]]]
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn depths(&self) -> [S::Floats; 3] {
        let [a, b, c] = &self.corners;
        [a.depth, b.depth, c.depth]
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn reach(&self) -> S::Floats {
        let [a, b, c] = &self.corners;
        // SAFETY: the caller's contract.
        unsafe { S::max(a.reach(), S::max(b.reach(), c.reach())) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn width(&self, _: [S::Floats; 2]) -> S::Floats {
        let [a, b, c] = &self.corners;
        // SAFETY: the caller's contract. The corners are loaded.
        unsafe { S::max(a.width(), S::max(b.width(), c.width())) }
    }
}

/// A closer look at a triangle for the rays that are unclear.
struct GroupCloserLook<'a, T> {
    rays: &'a PacketRays<'a>,
    block: &'a T,
    index: usize,
    /// See [`Group::beyond`].
    beyond: &'a GroupRow,
    met: &'a mut Met,
}

impl<'b, T: PacketBlock<'b>> Compiled for GroupCloserLook<'_, T> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let ready = self.rays.ready;
        // SAFETY: the caller's contract; the triangle is one of the block's.
        unsafe {
            let pairs = Pairs::<S> {
                origin: self.rays.rows::<S>(&ready.origin),
                direction: self.rays.rows::<S>(&ready.direction),
                corners: corners::<S, _>(self.block, self.index, [0, 1, 2]),
            };
            let mut meeting = self.met.meeting::<S>();
            meeting.look_closely(pairs, &self.rays.span::<S>(self.beyond));
            *self.met = Met::of(&meeting);
        }
    }
}
