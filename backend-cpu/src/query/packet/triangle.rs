//! One triangle against all rays of a packet.

use splitplane_core::intersect::{EDGE_LEAST, INTERPOLATION_ERROR, STOP_SLACK};
use splitplane_core::ray::{Culling, QueryOptions};

use super::Rays;
use super::group::Group;
use super::row::{load, put};
use crate::query::leaf::{Best, counts, cross, decide, dot, snapped};
use crate::query::record::Record;
use crate::query::simd::Simd;

/// The greatest magnitude of three.
///
/// # Safety
/// As for [`load`].
#[inline(always)]
unsafe fn magnitude<S: Simd>([x, y, z]: [S::Floats; 3]) -> S::Floats {
    // SAFETY: as above.
    unsafe { S::magnitude(S::magnitude(x, y), z) }
}

impl Group {
    /// Decides a triangle for some rays by the reference test; those whose best hit changed.
    #[inline(always)]
    pub(super) fn decide(
        &mut self,
        record: &Record<'_>,
        index: usize,
        mut unclear: u32,
        rays: &Rays<'_>,
        options: &QueryOptions,
    ) -> u32 {
        let mut taken = 0;
        while unclear != 0 {
            let lane = unclear.trailing_zeros() as usize;
            unclear &= unclear - 1;
            let ray = rays.ready.ray(rays.first + lane);
            let Some(found) = decide(&ray, &record.corners(index), options) else { continue };
            let mut best = Best { hit: self.hit(lane), stop: self.beyond.0[lane] };
            if best.take(&ray, &found, record.triangle(index)) {
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
    #[inline(always)]
    pub(super) unsafe fn within<S: Simd>(
        &self,
        record: &Record<'_>,
        rays: &Rays<'_>,
        index: usize,
    ) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            let [kx, ky, kz] = self.axes;
            let corners = record.places_of(index);
            let zero = S::splat(0.0);
            let sx = rays.row::<S>(&rays.ready.shear[0]);
            let sy = rays.row::<S>(&rays.ready.shear[1]);
            let ox = rays.row::<S>(&rays.ready.sheared_origin[0]);
            let oy = rays.row::<S>(&rays.ready.sheared_origin[1]);
            let oz = rays.row::<S>(&rays.ready.sheared_origin[2]);
            let (mut flat_x, mut flat_y) = ([zero; 3], [zero; 3]);
            for k in 0..3 {
                let x = S::sub(S::splat(*record.coordinates(kx).add(corners[k])), ox);
                let y = S::sub(S::splat(*record.coordinates(ky).add(corners[k])), oy);
                let z = S::sub(S::splat(*record.coordinates(kz).add(corners[k])), oz);
                flat_x[k] = S::sub(x, S::mul(sx, z));
                flat_y[k] = S::sub(y, S::mul(sy, z));
            }
            let ([ax, bx, cx], [ay, by, cy]) = (flat_x, flat_y);
            let u = S::sub(S::mul(cx, by), S::mul(cy, bx));
            let v = S::sub(S::mul(ax, cy), S::mul(ay, cx));
            let w = S::sub(S::mul(bx, ay), S::mul(by, ax));
            let least = S::min(u, S::min(v, w));
            let most = S::max(u, S::max(v, w));
            let below = S::le(least, S::splat(-EDGE_LEAST));
            let above = S::le(S::splat(EDGE_LEAST), most);
            !S::bits(S::and(below, above))
        }
    }

    /// The watertight test of one triangle against some rays; keeps what precedes. The rays whose best
    /// hit changed, and those for which the triangle is seen at too grazing an angle or from too near
    /// for interpolation, for the reference to decide. As `sift` of [`super::leaf`], with rays as
    /// lanes.
    ///
    /// # Safety
    /// As for [`super::Packet::trace`].
    #[inline(always)]
    pub(super) unsafe fn test<S: Simd>(
        &mut self,
        record: &Record<'_>,
        rays: &Rays<'_>,
        index: usize,
        active: u32,
        culling: Culling,
    ) -> (u32, u32) {
        // SAFETY: the caller's contract.
        unsafe {
            let [kx, ky, kz] = self.axes;
            let corners = record.places_of(index);
            let zero = S::splat(0.0);
            let sx = rays.row::<S>(&rays.ready.shear[0]);
            let sy = rays.row::<S>(&rays.ready.shear[1]);
            let sz = rays.row::<S>(&rays.ready.shear[2]);
            let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
            let (mut flat_x, mut flat_y) = ([zero; 3], [zero; 3]);
            let ox = rays.row::<S>(&rays.ready.sheared_origin[0]);
            let oy = rays.row::<S>(&rays.ready.sheared_origin[1]);
            let oz = rays.row::<S>(&rays.ready.sheared_origin[2]);
            for k in 0..3 {
                x[k] = S::sub(S::splat(*record.coordinates(kx).add(corners[k])), ox);
                y[k] = S::sub(S::splat(*record.coordinates(ky).add(corners[k])), oy);
                z[k] = S::sub(S::splat(*record.coordinates(kz).add(corners[k])), oz);
                flat_x[k] = S::sub(x[k], S::mul(sx, z[k]));
                flat_y[k] = S::sub(y[k], S::mul(sy, z[k]));
            }
            let ([ax, bx, cx], [ay, by, cy]) = (flat_x, flat_y);
            let u = S::sub(S::mul(cx, by), S::mul(cy, bx));
            let v = S::sub(S::mul(ax, cy), S::mul(ay, cx));
            let w = S::sub(S::mul(bx, ay), S::mul(by, ax));
            let least = S::min(u, S::min(v, w));
            let most = S::max(u, S::max(v, w));
            let below = S::le(least, S::splat(-EDGE_LEAST));
            let above = S::le(S::splat(EDGE_LEAST), most);
            let mut bits = active & !S::bits(S::and(below, above));
            if bits == 0 {
                return (0, 0);
            }
            let [da, db, dc] = [S::mul(sz, z[0]), S::mul(sz, z[1]), S::mul(sz, z[2])];
            let nearest = S::min(da, S::min(db, dc));
            let farthest = S::max(da, S::max(db, dc));
            let (t_min, t_max) =
                (rays.row::<S>(&rays.ready.t_min), rays.row::<S>(&rays.ready.t_max));
            let limit = S::min(load::<S>(&self.beyond), t_max);
            bits &= S::bits(S::and(S::le(t_min, farthest), S::le(nearest, limit)));
            let (u, v, w) = (counts::<S>(u), counts::<S>(v), counts::<S>(w));
            let det = S::add(S::add(u, v), w);
            // Within the bounds of the sheared corners.
            let least = S::max(S::min(ax, S::min(bx, cx)), S::min(ay, S::min(by, cy)));
            let most = S::min(S::max(ax, S::max(bx, cx)), S::max(ay, S::max(by, cy)));
            bits &= S::bits(S::and(S::le(least, zero), S::le(zero, most)));
            let (not_front, not_back) = (S::bits(S::le(det, zero)), S::bits(S::le(zero, det)));
            bits &= match culling {
                Culling::None => !(not_front & not_back),
                Culling::Back => !not_front,
                Culling::Front => !not_back,
            };
            if bits == 0 {
                return (0, 0);
            }
            let sum = S::add(S::add(S::mul(u, da), S::mul(v, db)), S::mul(w, dc));
            let interpolated = S::div(sum, det);
            let reach = S::max(magnitude::<S>(x), S::max(magnitude::<S>(y), magnitude::<S>(z)));
            let width = S::max(magnitude::<S>(flat_x), magnitude::<S>(flat_y));
            let disorder = S::mul(S::mul(reach, width), S::sub(farthest, nearest));
            let fine = S::bits(S::le(disorder, S::mul(S::splat(8.0), S::abs(sum))));
            let inner = S::min(S::max(interpolated, nearest), farthest);
            let kept = S::and(S::le(t_min, inner), S::le(inner, limit));
            let mut unclear = 0;
            if bits & !fine != 0 {
                let part = S::div(disorder, S::abs(det));
                let error = S::mul(part, S::splat(INTERPOLATION_ERROR));
                // Not less than, and not greater than.
                let after = S::bits(S::le(t_min, S::add(interpolated, error)));
                let before = S::bits(S::le(S::sub(interpolated, error), t_max));
                unclear = bits & !fine & after & before;
            }
            // The caller's t: packets hold no moved rays.
            let most = S::splat(f32::MAX);
            let t = S::mul(inner, load::<S>(&self.outwards));
            let t = snapped::<S>(S::min(S::max(t, S::splat(-f32::MAX)), most));
            let within = S::le(rays.row::<S>(&rays.ready.limits[0]), t);
            let within = S::and(within, S::le(t, rays.row::<S>(&rays.ready.limits[1])));
            let met = bits & fine & S::bits(S::and(kept, within));
            let best = load::<S>(&self.t);
            let mut taken = met & !S::bits(S::le(best, t));
            let mut tied = met & S::bits(S::and(S::le(best, t), S::le(t, best)));
            while tied != 0 {
                let lane = tied.trailing_zeros() as usize;
                tied &= tied - 1;
                let lower = record.triangle(index) < self.triangle.0[lane].to_bits();
                taken |= u32::from(lower) << lane;
            }
            if taken != 0 {
                let mask = S::mask(taken);
                put::<S>(mask, &mut self.t, t);
                put::<S>(mask, &mut self.u, snapped::<S>(S::div(v, det)));
                put::<S>(mask, &mut self.v, snapped::<S>(S::div(w, det)));
                put::<S>(
                    mask,
                    &mut self.triangle,
                    S::splat(f32::from_bits(record.triangle(index))),
                );
                // As `PreparedRay::stop_after`: what is flushed to 0 or clamped is equal outside.
                let slack = S::mul(S::abs(inner), S::splat(STOP_SLACK));
                let least = S::splat(f32::MIN_POSITIVE * (1.0 + STOP_SLACK));
                let least = S::mul(least, load::<S>(&self.inwards));
                let stop = S::max(S::add(inner, slack), least);
                let clamped = S::le(most, S::abs(t));
                put::<S>(mask, &mut self.beyond, S::select(clamped, S::splat(f32::INFINITY), stop));
            }
            (taken, unclear)
        }
    }

    /// Rays that one triangle may be a hit of by the fast test, whichever way it faces.
    ///
    /// # Safety
    /// As for [`super::Packet::trace`].
    #[inline(always)]
    pub(super) unsafe fn test_fast<S: Simd>(
        &self,
        record: &Record<'_>,
        rays: &Rays<'_>,
        index: usize,
        active: u32,
    ) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            let [a, b, c] = record.places_of(index);
            let zero = S::splat(0.0);
            let (mut d, mut ab, mut ac, mut ao) = ([zero; 3], [zero; 3], [zero; 3], [zero; 3]);
            for axis in 0..3 {
                let row = record.coordinates(axis);
                let a = S::splat(*row.add(a));
                let (b, c) = (S::splat(*row.add(b)), S::splat(*row.add(c)));
                let o = rays.row::<S>(&rays.ready.origin[axis]);
                d[axis] = rays.row::<S>(&rays.ready.direction[axis]);
                (ab[axis], ac[axis], ao[axis]) = (S::sub(b, a), S::sub(c, a), S::sub(o, a));
            }
            let p = cross::<S>(d, ac);
            let inverse = S::div(S::splat(1.0), dot::<S>(ab, p));
            let u = S::mul(dot::<S>(ao, p), inverse);
            let q = cross::<S>(ao, ab);
            let v = S::mul(dot::<S>(d, q), inverse);
            let t = S::mul(dot::<S>(ac, q), inverse);
            let inside = S::and(S::le(zero, S::min(u, v)), S::le(S::add(u, v), S::splat(1.0)));
            let limit = S::min(load::<S>(&self.beyond), rays.row::<S>(&rays.ready.t_max));
            let reached = S::and(S::le(rays.row::<S>(&rays.ready.t_min), t), S::le(t, limit));
            S::bits(S::and(inside, reached)) & active
        }
    }
}
