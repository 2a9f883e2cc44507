//! Which rays are traced as one packet, and the bounds that are computed beforehand.

use core::ops::Range;

use splitplane_core::query::intersect::{PLANE_SLACK, STOP_SLACK, SceneScale};
use splitplane_core::ray::Hit;

use super::Packet;
use super::bounds::{Bounds, ranges};
use super::group::Group;
use super::row::store;
use crate::simd::Simd;
use crate::trace::prepare::PreparedRays;
use crate::trace::ray_state::ORIGIN_SLACK;

/// A packet has at least one in this many of the rays that fit.
const FEWEST: usize = 2;
/// Slopes of a packet, parts of the largest component, differ by less than this on both other axes
/// together.
const SLOPE_SPREAD: f32 = 0.4;
/// Origins of a packet differ by less than this part of the scene's extents together.
const ORIGIN_SPREAD: f32 = 0.2;

impl Packet {
    /// Takes rays as [`Packet::take`] does if they are worth tracing as one packet: many, side by side.
    /// True if it did.
    ///
    /// # Safety
    /// As for [`Packet::take`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn take_coherent<S: Simd>(
        &mut self,
        ready: &mut PreparedRays,
        groups: Range<usize>,
        rays: u32,
        scene: &SceneScale,
    ) -> bool {
        let many = rays.count_ones() as usize * FEWEST >= groups.len() * S::N;
        // SAFETY: the caller's contract.
        if !many || !unsafe { self.take::<S>(ready, groups, rays, scene) } {
            return false;
        }
        let Bounds { shear: [x, y, _], origin, .. } = &self.bounds;
        let (mut origins, mut extents) = (0.0, 0.0);
        for axis in 0..3 {
            origins += origin[axis][1] - origin[axis][0];
            extents += scene.bounds.hi[axis] - scene.bounds.lo[axis];
        }
        let slopes = (x[1] - x[0]) + (y[1] - y[0]);
        slopes < SLOPE_SPREAD && origins < ORIGIN_SPREAD * extents
    }

    /// Takes prepared rays, those of `rays` in some groups of as many lanes as the set has, if they
    /// have one octant and one largest axis, and none begins before its origin. True if it did.
    ///
    /// # Safety
    /// The processor must have the set; there must be as many lanes, and at least one ray.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn take<S: Simd>(
        &mut self,
        ready: &mut PreparedRays,
        groups: Range<usize>,
        rays: u32,
        scene: &SceneScale,
    ) -> bool {
        let lanes = groups.start * S::N..groups.end * S::N;
        let one = rays.trailing_zeros() as usize;
        // Where rays go all ways, two are enough to detect it.
        let last = (u32::BITS - 1 - rays.leading_zeros()) as usize;
        if (ready.octant[one] ^ ready.octant[last]) & 7 != 0 || ready.axes[one] != ready.axes[last]
        {
            return false;
        }
        let (mut octants, mut axes) = (0, 0);
        for lane in lanes.clone() {
            let there = 0u32.wrapping_sub(rays >> lane & 1);
            octants |= (ready.octant[lane] ^ ready.octant[one]) & there;
            axes |= (ready.axes[lane] ^ ready.axes[one]) & there;
        }
        // Whether its end is solid need not be the same for all.
        if octants & 7 != 0 || axes != 0 {
            return false;
        }
        let others = ((u64::MAX << lanes.start & !(u64::MAX << lanes.end)) as u32) & !rays;
        if others != 0 {
            // Places without a ray take the numbers of a ray that is there.
            ready.repeat(one, others);
        }
        let octant = ready.octant[one] as usize & 7;
        self.octant = octant | if octants & 8 == 0 { ready.octant[one] as usize & 8 } else { 0 };
        self.axes = ready.ray(one).axes;
        self.first = groups.start;
        // SAFETY: the caller's contract.
        unsafe {
            self.bound::<S>(ready, scene, groups.clone());
            // Distances below 0 need the slack of `behind`, which packets do not have.
            if self.bounds.enter < 0.0 {
                return false;
            }
            for group in groups {
                let first = group * S::N;
                self.groups[group].begin::<S>(ready, first, rays >> first, self.axes);
            }
        }
        true
    }

    /// Finds the bounds of the rays that were taken.
    ///
    /// # Safety
    /// As for [`Packet::take`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn bound<S: Simd>(
        &mut self,
        ready: &PreparedRays,
        scene: &SceneScale,
        groups: Range<usize>,
    ) {
        let [ox, oy, oz] = &ready.origin;
        let [rx, ry, rz] = &ready.reciprocal;
        let [sx, sy, sz] = &ready.shear;
        let rows = [ox, oy, oz, rx, ry, rz, sx, sy, sz, &ready.enter, &ready.exit];
        // SAFETY: the caller's contract. No closures: they would not have the set's instructions.
        let [least, most] = unsafe {
            let mut least = [S::splat(f32::INFINITY); 11];
            let mut most = [S::splat(f32::NEG_INFINITY); 11];
            for group in groups {
                for (k, row) in rows.iter().enumerate() {
                    let x = S::load(row.as_ptr().add(group * S::N));
                    (least[k], most[k]) = (S::min(least[k], x), S::max(most[k], x));
                }
            }
            ranges::<S, 11>(least, most)
        };
        let (least, most) = (&least.0, &most.0);
        let bounds = &mut self.bounds;
        for axis in 0..3 {
            let (lo, hi) = (least[axis], most[axis]);
            let magnitude = if lo.abs() > hi.abs() { lo.abs() } else { hi.abs() };
            let slack = scene.base_slack * (1.0 + 4.0 * PLANE_SLACK) + magnitude * ORIGIN_SLACK;
            let (low, high) = (lo - slack, hi + slack);
            let backwards = self.octant >> axis & 1 != 0;
            (bounds.near[axis], bounds.far[axis]) =
                if backwards { (low, high) } else { (high, low) };
            bounds.reciprocal[axis] = [least[3 + axis], most[3 + axis]];
            bounds.shear[axis] = [least[6 + axis], most[6 + axis]];
            let sheared = self.axes[axis];
            bounds.origin[axis] = [least[sheared], most[sheared]];
        }
        let (enter, stop) = (least[9], most[10]);
        (bounds.enter, bounds.stop) = (enter, stop);
    }
}

impl Group {
    /// Begins with prepared rays, from lane `first` on; `rays` says which lanes have one.
    ///
    /// # Safety
    /// As for [`Packet::take`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn begin<S: Simd>(
        &mut self,
        ready: &PreparedRays,
        first: usize,
        rays: u32,
        axes: [usize; 3],
    ) {
        self.axes = axes;
        // SAFETY: the caller's contract.
        unsafe {
            let exit = S::load(ready.exit.as_ptr().add(first));
            let nowhere = S::splat(f32::NEG_INFINITY);
            store::<S>(&mut self.stop, S::select(S::mask(rays), exit, nowhere));
            for lane in 0..S::N {
                // Of rays that are alive between -126 and 126.
                let biased = (ready.exponent[first + lane] + 127) as u32;
                self.outwards.0[lane] = f32::from_bits(254u32.wrapping_sub(biased) << 23);
                let inwards = f32::from_bits(biased.max(127) << 23);
                self.least.0[lane] = f32::MIN_POSITIVE * (1.0 + STOP_SLACK) * inwards;
            }
            store::<S>(&mut self.t, S::splat(Hit::MISS.t));
            store::<S>(&mut self.triangle, S::splat(f32::from_bits(Hit::MISS.triangle)));
            store::<S>(&mut self.v, S::splat(0.0));
            store::<S>(&mut self.w, S::splat(0.0));
            store::<S>(&mut self.det, S::splat(1.0));
            store::<S>(&mut self.beyond, S::splat(f32::INFINITY));
        }
    }
}
