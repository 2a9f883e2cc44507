//! Which rays are traced as one packet, and what is known of them beforehand.

use splitplane_core::intersect::{PLANE_SLACK, SceneScale};
use splitplane_core::ray::Hit;

use super::Packet;
use super::bounds::range;
use super::row::store;
use crate::query::prepare::{ORIGIN_SLACK, PreparedRays};
use crate::query::simd::Simd;

/// A packet has at least this part of the rays that it has room for, one in so many.
const FEWEST: u32 = 2;
/// Directions of a packet differ by less than this on all axes together; the largest component of
/// each is between 1 and 2.
const DIRECTION_SPREAD: f32 = 0.6;
/// Origins of a packet differ by less than this part of the scene's extents together.
const ORIGIN_SPREAD: f32 = 0.2;

impl Packet {
    /// Takes rays that were made ready, those of `rays` from place `first` on, if they are worth
    /// tracing as one packet: many, of one octant, side by side. True if it did.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(always)]
    pub unsafe fn take<S: Simd>(
        &mut self,
        ready: &mut PreparedRays,
        first: usize,
        rays: u32,
        scene: &SceneScale,
        forced: bool,
    ) -> bool {
        let fewest = if forced { 1 } else { S::N as u32 / FEWEST };
        if rays.count_ones() < fewest {
            return false;
        }
        let one = rays.trailing_zeros() as usize + first;
        let (mut octants, mut axes) = (0, 0);
        for lane in 0..S::N {
            let there = 0u32.wrapping_sub(rays >> lane & 1);
            octants |= (ready.octant[first + lane] ^ ready.octant[one]) & there;
            axes |= (ready.axes[first + lane] ^ ready.axes[one]) & there;
        }
        // Whether its end is solid need not be the same for all.
        if octants & 7 != 0 || axes != 0 {
            return false;
        }
        let whole = rays == (1u32 << S::N) - 1;
        if !whole {
            // Places without a ray take the numbers of one that is there.
            ready.repeat(one, (!rays & ((1u32 << S::N) - 1)) << first);
        }
        let spread = |[lo, hi]: [f32; 2]| hi - lo;
        // SAFETY: the caller's contract; there are lanes from `first` on.
        unsafe {
            let (mut directions, mut origins, mut extents) = (0.0, 0.0, 0.0);
            let mut origin = [[0.0; 2]; 3];
            for axis in 0..3 {
                directions += spread(range::<S>(&ready.direction[axis], first));
                origin[axis] = range::<S>(&ready.origin[axis], first);
                origins += spread(origin[axis]);
                extents += scene.bounds.hi[axis] - scene.bounds.lo[axis];
            }
            let near = directions < DIRECTION_SPREAD && origins < ORIGIN_SPREAD * extents;
            if !(near || forced) {
                return false;
            }
            let octant = ready.octant[one] as usize & 7;
            self.octant =
                octant | if octants & 8 == 0 { ready.octant[one] as usize & 8 } else { 0 };
            self.axes = ready.ray(one).axes;
            let bounds = &mut self.bounds;
            for axis in 0..3 {
                let [lo, hi] = origin[axis];
                let most = if lo.abs() > hi.abs() { lo.abs() } else { hi.abs() };
                let slack = scene.slack * (1.0 + 4.0 * PLANE_SLACK) + most * ORIGIN_SLACK;
                let (low, high) = (lo - slack, hi + slack);
                let backwards = octant >> axis & 1 != 0;
                (bounds.near[axis], bounds.far[axis]) =
                    if backwards { (low, high) } else { (high, low) };
                bounds.reciprocal[axis] = range::<S>(&ready.reciprocal[axis], first);
                bounds.shear[axis] = range::<S>(&ready.shear[axis], first);
            }
            bounds.origin = self.axes.map(|axis| origin[axis]);
            let [enter, last] = range::<S>(&ready.enter, first);
            let [exit, stop] = range::<S>(&ready.exit, first);
            let reach = last.abs().max(enter.abs()).max(exit.abs().max(stop.abs()));
            (bounds.enter, bounds.stop, bounds.reach) = (enter, stop, reach * (2.0 * PLANE_SLACK));
            let mut exit = S::load(ready.exit.as_ptr().add(first));
            if !whole {
                exit = S::select(S::mask(rays), exit, S::splat(f32::NEG_INFINITY));
            }
            store::<S>(&mut self.stop, exit);
            for lane in 0..S::N {
                // Of rays that are alive between -126 and 126.
                let biased = (ready.exponent[first + lane] + 127) as u32;
                self.outwards.0[lane] = f32::from_bits(254u32.wrapping_sub(biased) << 23);
                self.inwards.0[lane] = f32::from_bits(biased << 23);
            }
            store::<S>(&mut self.t, S::splat(Hit::MISS.t));
            store::<S>(&mut self.triangle, S::splat(f32::from_bits(Hit::MISS.triangle)));
            store::<S>(&mut self.u, S::splat(0.0));
            store::<S>(&mut self.v, S::splat(0.0));
            store::<S>(&mut self.beyond, S::splat(f32::INFINITY));
            self.ways = false;
            true
        }
    }
}
