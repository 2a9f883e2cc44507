//! Accuracy `exact` in packets: the sieve of [`crate::trace::sieve`] with a ray in each lane.
//!
//! What is certain is taken in vectors, and what is certainly later than it is left out. The exact test decides the rest, ray by ray. In the end the hits that
//! were certain get their numbers, in vectors of `f64` as far as these know them.

use splitplane_core::aabb::Aabb;
use splitplane_core::exact::{ExactRay, meet};
use splitplane_core::query::intersect::STOP_SLACK;
use splitplane_core::query::traverse::Query;
use splitplane_core::query::traverse::exact::Best;
use splitplane_core::ray::{Culling, Hit, QueryOptions, Rays};
use splitplane_core::triangle::Triangle;

use super::group::Group;
use super::packet_block::PacketBlock;
use super::row::{GroupRow, ZERO, load, put, store};
use super::triangle::corners;
use super::{FEW, FEWEST_LANES, MOST_GROUPS, Packet, PacketRays};
use crate::layout::tree_layout::TreeLayout;
use crate::simd::{Compiled, MOST_LANES, Simd};
use crate::trace::exact_hits::{FirstLanes, Meetings, Numbers};
use crate::trace::prepare::{CHUNK, PreparedRays};
use crate::trace::ray_state::RayState;
use crate::trace::sieve::{
    Ends, Reach, Sifted, Sight, inner_interval, least_within, most_within, next_of, sift,
};
use crate::trace::watertight::Corner;

/// The costs of one triangle against all rays, and of one ray against a whole block.
const COST_OF_A_TRIANGLE: u32 = 2;
const COST_OF_A_RAY: u32 = 3;

/// Part of the greatest distance by which a sheared coordinate of a corner may be off, and more: see the sieve.
const CORNER_SLACK: f32 = 8.0 * crate::trace::sieve::ROUNDING;

/// What exact rays of a group have in addition.
#[derive(Clone, Copy)]
pub(super) struct ExactGroup {
    /// Inner limits, widened and narrowed; the upper one, or where nothing can precede the best hit.
    t_min: GroupRow,
    limit: GroupRow,
    within: [GroupRow; 2],
    /// Inner `t` between which the best hits certainly are; infinite without one.
    low: GroupRow,
    high: GroupRow,
    /// Corners of those that were not decided but certain.
    corners: [[GroupRow; 3]; 3],
    /// Which were decided, as bits, and these.
    decided: u32,
    best: [Best; MOST_LANES],
}

impl ExactGroup {
    /// No rays.
    pub(super) fn none() -> ExactGroup {
        ExactGroup {
            t_min: ZERO,
            limit: ZERO,
            within: [ZERO; 2],
            low: ZERO,
            high: ZERO,
            corners: [[ZERO; 3]; 3],
            decided: 0,
            best: [Best::default(); MOST_LANES],
        }
    }

    /// Begins with the rays of a group.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn begin<S: Simd>(&mut self, rays: &PacketRays<'_>) {
        for lane in 0..S::N {
            let (t_min, t_max) =
                (rays.ready.t_min[rays.first + lane], rays.ready.t_max[rays.first + lane]);
            self.t_min.0[lane] = t_min - t_min.abs() * STOP_SLACK;
            self.limit.0[lane] = t_max + t_max.abs() * STOP_SLACK;
            self.within[0].0[lane] = least_within(t_min);
            self.within[1].0[lane] = most_within(t_max);
        }
        // SAFETY: the caller's contract.
        unsafe {
            store::<S>(&mut self.low, S::splat(f32::INFINITY));
            store::<S>(&mut self.high, S::splat(f32::INFINITY));
        }
        self.decided = 0;
    }

    /// The corners of a lane's best hit.
    fn corners(&self, lane: usize) -> Triangle {
        [0, 1, 2].map(|corner| [0, 1, 2].map(|axis| self.corners[corner][axis].0[lane]))
    }

    /// The limits of the group's rays.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn ends<S: Simd>(&self) -> Ends<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let within = [load::<S>(&self.within[0]), load::<S>(&self.within[1])];
            Ends { t_min: load::<S>(&self.t_min), limit: load::<S>(&self.limit), within }
        }
    }
}

/// What exact rays of a packet have in addition.
#[derive(Clone, Copy)]
pub(super) struct ExactPacket {
    /// As in [`Reach`], for the farthest of the rays.
    errors: [[f32; 2]; 2],
    /// By how much a sheared coordinate may be off.
    slack: f32,
    groups: [ExactGroup; MOST_GROUPS],
}

impl ExactPacket {
    /// No rays.
    pub(super) fn none() -> ExactPacket {
        ExactPacket { errors: [[0.0; 2]; 2], slack: 0.0, groups: [ExactGroup::none(); MOST_GROUPS] }
    }
}

/// A packet of exact rays. The layout must be made for the set, and all else hold that [`Packet::trace`] asks for.
pub(crate) struct TraceExactly<'a> {
    pub packet: &'a mut Packet,
    pub layout: &'a TreeLayout,
    pub ready: &'a PreparedRays,
    pub ray_states: &'a mut [RayState; CHUNK],
    /// The rays that were prepared, as they were given.
    pub given: Rays<'a>,
    /// How many groups were taken: one, or all.
    pub groups: usize,
    /// Bounds of all triangles, and of those that are not [large](crate::layout::large).
    pub bounds: [Aabb; 2],
    pub options: &'a QueryOptions<'a>,
    pub query: Query,
}

impl Compiled for TraceExactly<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let TraceExactly {
            packet,
            layout,
            ready,
            ray_states,
            given,
            groups,
            bounds,
            options,
            query,
        } = self;
        let rays = &mut PacketRays { ready, ray_states, given, written: 0, first: 0 };
        // SAFETY: the caller's contract.
        unsafe {
            packet.begin_exactly::<S>(rays, groups, &bounds);
            match groups {
                2 if S::WIDE => packet.walk::<S, 2, true>(layout, rays, options, query),
                4 if !S::WIDE => packet.walk::<S, 4, true>(layout, rays, options, query),
                _ => packet.walk::<S, 1, true>(layout, rays, options, query),
            }
            if query == Query::Closest {
                for group in packet.first..packet.first + groups {
                    rays.first = group * S::N;
                    let exact = &packet.exact.groups[group];
                    packet.groups[group].finish_exactly::<S>(exact, rays);
                }
            }
        }
    }
}

impl Packet {
    /// What exact rays need in addition, of those that were taken.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn begin_exactly<S: Simd>(
        &mut self,
        rays: &mut PacketRays<'_>,
        groups: usize,
        bounds: &[Aabb; 2],
    ) {
        let mut reach = [0.0f32; 2];
        for (sheared, axis) in self.axes.into_iter().enumerate() {
            let [least, most] = self.bounds.origin[sheared];
            for (reach, bounds) in reach.iter_mut().zip(bounds) {
                *reach = reach.max(bounds.hi[axis] - least).max(most - bounds.lo[axis]);
            }
        }
        self.exact.errors = Reach::of(reach, 0.0, 0.0).errors;
        self.exact.slack = reach[0] * CORNER_SLACK;
        for group in self.first..self.first + groups {
            rays.first = group * S::N;
            // SAFETY: the caller's contract.
            unsafe { self.exact.groups[group].begin::<S>(rays) };
        }
    }

    /// The triangles of a block that exact rays of the packet may meet, as [`Packet::cull`].
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn cull_exactly<'b, S: Simd, T: PacketBlock<'b>>(&self, block: &T) -> u32 {
        let [enter, stop] = [self.bounds.enter, self.bounds.stop];
        let [enter, stop] = [enter - enter.abs() * STOP_SLACK, stop + stop.abs() * STOP_SLACK];
        // SAFETY: the caller's contract.
        unsafe { block.cull::<S>(self, self.exact.slack, [enter, stop]) }
    }

    /// A test of a block for some rays of a group, some triangles of it.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn block_exactly<'b, S: Simd, T: PacketBlock<'b>>(
        &mut self,
        block: &T,
        rays: &mut PacketRays<'_>,
        (triangles, active): (u32, u32),
        options: &QueryOptions<'_>,
        query: Query,
    ) -> bool {
        if triangles == 0 {
            return false;
        }
        let group = rays.first / S::N;
        let errors = &self.exact.errors;
        let (group, exact) = (&mut self.groups[group], &mut self.exact.groups[group]);
        let test = ExactTest { group, exact, errors, block, rays, options, query };
        // SAFETY: the caller's contract.
        unsafe { S::call(ExactBlock { test, triangles, active }) }
    }
}

/// A group of exact rays at a block.
struct ExactTest<'a, 'b, T> {
    group: &'a mut Group,
    exact: &'a mut ExactGroup,
    errors: &'a [[f32; 2]; 2],
    block: &'a T,
    rays: &'a mut PacketRays<'b>,
    options: &'a QueryOptions<'a>,
    query: Query,
}

/// Some of its triangles, and some of the rays.
struct ExactBlock<'a, 'b, T> {
    test: ExactTest<'a, 'b, T>,
    triangles: u32,
    active: u32,
}

impl<'b, T: PacketBlock<'b>> Compiled for ExactBlock<'_, '_, T> {
    /// Whether a best hit changed.
    type Output = bool;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> bool {
        let ExactBlock { mut test, mut triangles, mut active } = self;
        let (many, mut better) = (active.count_ones(), false);
        let few = many <= FEW || triangles.count_ones() * COST_OF_A_TRIANGLE > many * COST_OF_A_RAY;
        // SAFETY: the caller's contract.
        unsafe {
            if few {
                while active != 0 {
                    let lane = active.trailing_zeros() as usize;
                    active &= active - 1;
                    better |= test.ray::<S>(lane);
                }
            } else {
                if triangles & (triangles - 1) != 0 {
                    // As in the watertight test.
                    let mut rest = triangles;
                    while rest != 0 {
                        let index = rest.trailing_zeros() as usize;
                        rest &= rest - 1;
                        let met = test.may_be_within::<S>(index) & active != 0;
                        triangles ^= u32::from(!met) << index;
                    }
                }
                while triangles != 0 && active != 0 {
                    let index = triangles.trailing_zeros() as usize;
                    triangles &= triangles - 1;
                    if test.options.ignore == Some(test.block.triangle(index)) {
                        continue;
                    }
                    let taken = test.triangle::<S>(index, active);
                    better |= taken != 0;
                    if test.query == Query::Any {
                        active &= !taken;
                    }
                }
            }
            if better && test.query == Query::Closest {
                let stop = S::min(load::<S>(&test.exact.limit), load::<S>(&test.group.stop));
                store::<S>(&mut test.group.stop, stop);
            }
        }
        better
    }
}

impl<'b, T: PacketBlock<'b>> ExactTest<'_, '_, T> {
    /// A triangle's corners as the rays see them.
    ///
    /// # Safety
    /// As for [`Packet::trace`]; the triangle must be one of the block's.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn sheared<S: Simd>(&self, index: usize) -> [Corner<S>; 3] {
        // SAFETY: the caller's contract.
        unsafe {
            let origin = self.rays.rows::<S>(&self.rays.ready.sheared_origin);
            let shear = self.rays.rows::<S>(&self.rays.ready.shear);
            let [a, b, c] = corners::<S, _>(self.block, index, self.group.axes);
            [
                Corner::new(a, origin, shear),
                Corner::new(b, origin, shear),
                Corner::new(c, origin, shear),
            ]
        }
    }

    /// The rays that are not certainly outside of a triangle.
    ///
    /// # Safety
    /// As for [`ExactTest::sheared`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn may_be_within<S: Simd>(&self, index: usize) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            let seen = self.sheared::<S>(index);
            !sight(&seen).outside(self.error::<S>(width(&seen)))
        }
    }

    /// The error of edge functions, by the distance of the scene.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn error<S: Simd>(&self, width: S::Floats) -> S::Floats {
        let [edge, least] = self.errors[usize::from(!self.block.is_large())];
        // SAFETY: the caller's contract.
        unsafe { S::add(S::mul(S::splat(edge), width), S::splat(least)) }
    }

    /// Tests a triangle for some rays. Returns those whose best hit changed.
    ///
    /// # Safety
    /// As for [`ExactTest::sheared`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn triangle<S: Simd>(&mut self, index: usize, active: u32) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            let seen = self.sheared::<S>(index);
            let (sight, width) = (sight(&seen), width(&seen));
            let ends = self.exact.ends::<S>();
            let bits = active & sight.reaches(&ends) & !sight.outside(self.error::<S>(width));
            if bits == 0 {
                return 0;
            }
            let [a, b, c] = &seen;
            let own = S::max(a.reach(), S::max(b.reach(), c.reach()));
            // No ray of a packet was moved.
            let (of, none) = ([own, width], S::splat(0.0));
            let judged = sight.judge(bits, of, none, &ends, self.options.culling);
            let triangle = self.block.triangle(index);
            let best = &self.group.triangle;
            // Or met before, in another leaf.
            let bits = judged.bits & !S::equal(best.0.as_ptr().cast(), triangle);
            let certain = judged.certain & bits;
            let number = S::splat(f32::from_bits(triangle));
            if self.query == Query::Any {
                if certain != 0 {
                    put::<S>(S::mask(certain), &mut self.group.triangle, number);
                    let nowhere = S::splat(f32::NEG_INFINITY);
                    put::<S>(S::mask(certain), &mut self.group.stop, nowhere);
                }
                return certain | self.decide::<S>(index, bits & !certain);
            }
            let (low, high) = (judged.low, judged.high);
            let bits = bits & S::bits(S::le(low, load::<S>(&self.exact.high)));
            let taken = certain & bits & !S::bits(S::le(load::<S>(&self.exact.low), high));
            if taken != 0 {
                let mask = S::mask(taken);
                put::<S>(mask, &mut self.group.triangle, number);
                put::<S>(mask, &mut self.exact.low, low);
                put::<S>(mask, &mut self.exact.high, high);
                let limit = S::add(high, S::mul(S::abs(high), S::splat(STOP_SLACK)));
                put::<S>(mask, &mut self.exact.limit, limit);
                let at = corners::<S, _>(self.block, index, [0, 1, 2]);
                for (rows, at) in self.exact.corners.iter_mut().zip(at) {
                    for (row, x) in rows.iter_mut().zip(at) {
                        put::<S>(mask, row, x);
                    }
                }
                self.exact.decided &= !taken;
            }
            taken | self.decide::<S>(index, bits & !taken)
        }
    }

    /// Decides a triangle for some rays. Returns those whose best hit changed.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn decide<S: Simd>(&mut self, index: usize, mut unclear: u32) -> u32 {
        let mut taken = 0;
        while unclear != 0 {
            let lane = unclear.trailing_zeros() as usize;
            unclear &= unclear - 1;
            taken |= u32::from(self.decide_one(lane, index)) << lane;
        }
        taken
    }

    /// Tests a block for one ray. True when its best hit changed.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn ray<S: Simd>(&mut self, lane: usize) -> bool {
        let t_min = self.exact.t_min.0[lane];
        let within = [self.exact.within[0].0[lane], self.exact.within[1].0[lane]];
        let (errors, limit) = (*self.errors, self.exact.limit.0[lane]);
        let reach = Reach { errors, moved: 0.0, late: 0.0, t_min, t_max: limit, within };
        // SAFETY: the caller's contract.
        let sifted = unsafe {
            let ray_state = self.rays.ray_state::<S>(lane);
            sift::<S, _>(ray_state, &reach, self.block, limit, self.options.culling)
        };
        sifted.is_some_and(|sifted| self.take(lane, &sifted))
    }

    /// Takes what one ray meets of the block. True when its best hit changed.
    #[inline(never)]
    fn take(&mut self, lane: usize, sifted: &Sifted) -> bool {
        let (mut bits, mut better) = (sifted.in_order(), false);
        while let Some((index, certain)) = next_of(&mut bits) {
            let triangle = self.block.triangle(index);
            let best = self.group.triangle.0[lane].to_bits();
            // Or met before, in another leaf.
            if best == triangle || self.options.ignore == Some(triangle) {
                continue;
            }
            let [low, high] = [sifted.low[index], sifted.high[index]];
            if low > self.exact.high.0[lane] {
                continue;
            }
            if certain && self.query == Query::Any {
                self.group.triangle.0[lane] = f32::from_bits(triangle);
                self.group.stop.0[lane] = f32::NEG_INFINITY;
                return true;
            }
            if certain && high < self.exact.low.0[lane] {
                let corners = self.block.corners(index);
                for (rows, corner) in self.exact.corners.iter_mut().zip(corners) {
                    for (row, x) in rows.iter_mut().zip(corner) {
                        row.0[lane] = x;
                    }
                }
                self.exact.decided &= !(1 << lane);
                self.set(lane, triangle, [low, high]);
                better = true;
            } else if self.decide_one(lane, index) {
                better = true;
                if self.query == Query::Any {
                    break;
                }
            }
        }
        better
    }

    /// Sets a lane's best hit.
    fn set(&mut self, lane: usize, triangle: u32, [low, high]: [f32; 2]) {
        self.group.triangle.0[lane] = f32::from_bits(triangle);
        (self.exact.low.0[lane], self.exact.high.0[lane]) = (low, high);
        self.exact.limit.0[lane] = high + high.abs() * STOP_SLACK;
    }

    /// Decides a triangle for one ray, by the exact test. True when its best hit changed.
    #[inline(never)]
    fn decide_one(&mut self, lane: usize, index: usize) -> bool {
        let Some(ray) = self.rays.exact(lane) else { return false };
        let (triangle, corners) = (self.block.triangle(index), self.block.corners(index));
        let (query, culling) = (self.query, self.options.culling);
        if query == Query::Any {
            let mut best = Best::default();
            best.test(&ray, &corners, triangle, culling, query);
            if best.is_hit() {
                self.group.triangle.0[lane] = f32::from_bits(triangle);
                self.group.stop.0[lane] = f32::NEG_INFINITY;
            }
            return best.is_hit();
        }
        let (exact, before) = (&mut *self.exact, self.group.triangle.0[lane].to_bits());
        if exact.decided >> lane & 1 == 0 {
            exact.decided |= 1 << lane;
            exact.best[lane] = Best::default();
            if before != Hit::MISS.triangle {
                // It is met, and faces the ray as it must.
                let corners = exact.corners(lane);
                exact.best[lane].test(&ray, &corners, before, Culling::None, query);
            }
        }
        exact.best[lane].test(&ray, &corners, triangle, culling, query);
        if exact.best[lane].triangle() != Some(triangle) {
            return false;
        }
        let exponent = self.rays.ready.exponent[self.rays.first + lane];
        let between = inner_interval(&exact.best[lane], (exponent, 0.0), 0.0);
        self.set(lane, triangle, between);
        true
    }
}

/// The rays and a triangle, as the sieve takes them.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn sight<S: Simd>([a, b, c]: &[Corner<S>; 3]) -> Sight<S> {
    let flat = [[a.flat[0], b.flat[0], c.flat[0]], [a.flat[1], b.flat[1], c.flat[1]]];
    // SAFETY: the caller's contract.
    unsafe { Sight::new(flat, [a.depth, b.depth, c.depth]) }
}

/// The greatest sheared coordinate.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn width<S: Simd>([a, b, c]: &[Corner<S>; 3]) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe { S::max(a.width(), S::max(b.width(), c.width())) }
}

impl PacketRays<'_> {
    /// A ray of the group as the exact test takes it.
    fn exact(&self, lane: usize) -> Option<ExactRay> {
        ExactRay::new(&self.given.ray(self.first + lane))
    }
}

impl Group {
    /// The numbers of the closest hits.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn finish_exactly<S: Simd>(&mut self, exact: &ExactGroup, rays: &PacketRays<'_>) {
        let mut hits = 0;
        for lane in 0..S::N {
            let is_hit = self.triangle.0[lane].to_bits() != Hit::MISS.triangle;
            hits |= u32::from(is_hit) << lane;
        }
        let certain = hits & !exact.decided;
        let mut meetings = Meetings::NONE;
        for lane in 0..S::N {
            if certain >> lane & 1 != 0 {
                let ray = rays.given.ray(rays.first + lane);
                for axis in 0..3 {
                    meetings.origin[axis][lane] = ray.origin[axis];
                    meetings.direction[axis][lane] = ray.direction[axis];
                }
            }
        }
        for (to, from) in meetings.corners.iter_mut().zip(&exact.corners) {
            for (to, from) in to.iter_mut().zip(from) {
                *to = from.0;
            }
        }
        let Numbers { t, u, v, known } = if certain == 0 {
            Numbers::NONE
        } else {
            // SAFETY: the caller's contract.
            unsafe {
                if S::N == FEWEST_LANES {
                    S::call(FirstLanes::<FEWEST_LANES>(&meetings))
                } else {
                    S::call(FirstLanes::<MOST_LANES>(&meetings))
                }
            }
        };
        (self.t.0, self.v.0, self.w.0) = (t, u, v);
        // SAFETY: the caller's contract.
        unsafe {
            store::<S>(&mut self.det, S::splat(1.0));
            let miss = S::splat(Hit::MISS.t);
            put::<S>(S::mask(!hits), &mut self.t, miss);
            put::<S>(S::mask(!hits), &mut self.v, S::splat(0.0));
            put::<S>(S::mask(!hits), &mut self.w, S::splat(0.0));
        }
        let mut rest = hits & !(certain & known);
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let triangle = self.triangle.0[lane].to_bits();
            let hit = if exact.decided >> lane & 1 != 0 {
                exact.best[lane].hit()
            } else {
                let met = rays.exact(lane);
                let met = met.and_then(|ray| meet(&ray, &exact.corners(lane), Culling::None));
                debug_assert!(met.is_some());
                met.map_or(Hit::MISS, |met| met.hit(triangle))
            };
            (self.t.0[lane], self.v.0[lane], self.w.0[lane]) = (hit.t, hit.u, hit.v);
        }
    }
}
