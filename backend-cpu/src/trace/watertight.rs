//! The watertight test in vectors, a triangle and a ray per lane: one ray against the triangles of
//! a block ([`super::block_test`]), or the rays of a packet against one triangle
//! ([`super::packet`]).
//!
//! The operations are those of [`splitplane_core::query::intersect::watertight`] in its order, so all numbers
//! are the reference's bit for bit. Rays must not be wide.

use splitplane_core::arithmetic::snap;
use splitplane_core::query::intersect::{
    Candidate, DET_LEAST, EDGE_LEAST, INTERPOLATION_ERROR, NEEDLE, ROBUST, SLIVER, SUM_LEAST,
    T_LEAST, WIDTH_LEAST,
};
use splitplane_core::ray::Culling;

use super::refined::{Pairs, Refined};
use crate::simd::{MOST_LANES, Simd};

/// More than twice [`INTERPOLATION_ERROR`], by enough for the roundings of what it is multiplied with.
const MORE_THAN_TWO_ERRORS: f32 = 2.1 * INTERPOLATION_ERROR;
/// Less than 8, by more than the roundings of a bound of the reach.
const LESS_THAN_EIGHT: f32 = 7.99;

/// A corner of triangles as rays see it.
#[derive(Clone, Copy)]
pub(crate) struct Corner<S: Simd> {
    /// Its position relative to the ray's origin, on the sheared axes.
    pub from: [S::Floats; 3],
    /// Sheared coordinates: those of the ray are 0.
    pub flat: [S::Floats; 2],
    /// Inner `t`.
    pub depth: S::Floats,
}

/// # Safety
/// All methods: the processor must have the set.
impl<S: Simd> Corner<S> {
    /// A corner at `at`, of rays from `origin`, all on the sheared axes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn new(
        at: [S::Floats; 3],
        origin: [S::Floats; 3],
        shear: [S::Floats; 3],
    ) -> Corner<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let x = S::sub(at[0], origin[0]);
            let y = S::sub(at[1], origin[1]);
            let z = S::sub(at[2], origin[2]);
            let flat = [S::sub(x, S::mul(shear[0], z)), S::sub(y, S::mul(shear[1], z))];
            Corner { from: [x, y, z], flat, depth: S::mul(shear[2], z) }
        }
    }

    /// Its distance on the axis where it is farthest.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn reach(&self) -> S::Floats {
        let [x, y, z] = self.from;
        // SAFETY: the caller's contract.
        unsafe { S::magnitude(S::magnitude(x, y), z) }
    }

    /// The same of its sheared coordinates.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn width(&self) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe { S::magnitude(self.flat[0], self.flat[1]) }
    }
}

/// Triangles as rays see them.
///
/// # Safety
/// All methods: the processor must have the set.
pub(crate) trait View<S: Simd> {
    /// Sheared coordinates of the corners: x of all three, then y.
    unsafe fn flat(&self) -> [[S::Floats; 3]; 2];
    /// Inner `t` of the corners.
    unsafe fn depths(&self) -> [S::Floats; 3];
    /// The greatest [`Corner::reach`].
    unsafe fn reach(&self) -> S::Floats;
    /// At least that, if it were not for roundings, given the greatest [`Corner::width`] and the greatest distance in inner `t`. Largest
    /// components of directions are below 2.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn reach_at_most(&self, width: S::Floats, distance: S::Floats) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe { S::add(width, S::add(distance, distance)) }
    }
    /// The greatest [`Corner::width`]; the least and the greatest sheared coordinate are known.
    unsafe fn width(&self, ends: [S::Floats; 2]) -> S::Floats;
}

/// Inner `t` that count.
#[derive(Clone, Copy)]
pub(crate) struct Span<S: Simd> {
    /// The rays' limits.
    pub t_min: S::Floats,
    pub t_max: S::Floats,
    /// At most `t_max`: nothing beyond it can precede the best hit so far.
    pub stop: S::Floats,
}

/// Where rays meet triangles, a bit or a number per lane. Numbers count only where a bit says so.
pub(crate) struct Meeting<S: Simd> {
    /// Where the reference test gives a hit.
    pub met: u32,
    /// Where it may, by a closer look.
    pub unclear: u32,
    /// Where the ray passes all edges by more than rounding, and the triangle is neither tiny nor a needle along it.
    pub robust: u32,
    /// Inner `t` of the hit.
    pub t: S::Floats,
    /// Edge functions opposite the second and the third corner, and the sum of all three.
    pub v: S::Floats,
    pub w: S::Floats,
    pub det: S::Floats,
    /// Inner `t` of the nearest and the farthest corner.
    depths: [S::Floats; 2],
}

/// A [`Meeting`] in memory.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Met {
    t: [f32; MOST_LANES],
    v: [f32; MOST_LANES],
    w: [f32; MOST_LANES],
    det: [f32; MOST_LANES],
    depths: [[f32; MOST_LANES]; 2],
    pub met: u32,
    pub unclear: u32,
    pub robust: u32,
}

/// # Safety
/// All methods: the processor must have the set.
impl Met {
    /// Nothing is met.
    pub(crate) const NONE: Met = {
        let row = [0.0; MOST_LANES];
        Met { t: row, v: row, w: row, det: row, depths: [row; 2], met: 0, unclear: 0, robust: 0 }
    };

    /// The meeting.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn of<S: Simd>(meeting: &Meeting<S>) -> Met {
        let Meeting { met, unclear, robust, t, v, w, det, depths: [nearest, farthest] } = *meeting;
        let mut rows = Met { met, unclear, robust, ..Met::NONE };
        // SAFETY: the caller's contract; no set has more lanes than rows.
        unsafe {
            S::store(rows.t.as_mut_ptr(), t);
            S::store(rows.v.as_mut_ptr(), v);
            S::store(rows.w.as_mut_ptr(), w);
            S::store(rows.det.as_mut_ptr(), det);
            S::store(rows.depths[0].as_mut_ptr(), nearest);
            S::store(rows.depths[1].as_mut_ptr(), farthest);
        }
        rows
    }

    /// The stored meeting.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn meeting<S: Simd>(&self) -> Meeting<S> {
        let [nearest, farthest] = &self.depths;
        // SAFETY: as above.
        unsafe {
            Meeting {
                met: self.met,
                unclear: self.unclear,
                robust: self.robust,
                t: S::load(self.t.as_ptr()),
                v: S::load(self.v.as_ptr()),
                w: S::load(self.w.as_ptr()),
                det: S::load(self.det.as_ptr()),
                depths: [S::load(nearest.as_ptr()), S::load(farthest.as_ptr())],
            }
        }
    }

    /// The hit of a lane that is met.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn candidate(&self, lane: usize) -> Candidate {
        let [t, v, w, det] = [&self.t, &self.v, &self.w, &self.det].map(|row| row[lane]);
        // Snapped, as in the reference test.
        Candidate { t, u: snap(v / det), v: snap(w / det) }
    }
}

/// Edge functions opposite the first, second and third corner: twice the signed areas of triangles of
/// the ray and two sheared corners.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn edges<S: Simd>([[ax, bx, cx], [ay, by, cy]]: [[S::Floats; 3]; 2]) -> [S::Floats; 3] {
    // SAFETY: the caller's contract.
    unsafe {
        [
            S::sub(S::mul(cx, by), S::mul(cy, bx)),
            S::sub(S::mul(ax, cy), S::mul(ay, cx)),
            S::sub(S::mul(bx, ay), S::mul(by, ax)),
        ]
    }
}

/// Where no two edge functions have different signs.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn of_one_sign<S: Simd>([u, v, w]: [S::Floats; 3]) -> u32 {
    // SAFETY: the caller's contract.
    unsafe {
        let (least, most) = (S::min(u, S::min(v, w)), S::max(u, S::max(v, w)));
        let below = S::le(least, S::splat(-EDGE_LEAST));
        let above = S::le(S::splat(EDGE_LEAST), most);
        !S::bits(S::and(below, above))
    }
}

/// Where the edges of the triangle enclose the ray.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn enclosed<S: Simd, V: View<S>>(view: &V) -> u32 {
    // SAFETY: the caller's contract.
    unsafe { of_one_sign::<S>(edges::<S>(view.flat())) }
}

/// The test of some lanes, without the closer look, in three parts. Most often no triangle's edges enclose the ray. Of those that do,
/// many are the ones that rays start on, or start close to: they are left out before it is known how well `t` can be interpolated. What
/// is left is mostly a hit, and mostly one that needs nothing else.
///
/// Reach (R) is bounded in the second part, from the width (W) and the corners' distance in depth: slopes are at most 1, so a corner's x and y are
/// at most W + |z|. So what is plain by the bound is plain. A fat triangle with a sum that is known is
/// either interpolated, and then not met where that is less than `t_min`, or it is left out where it is with the error added. It is,
/// where twice the error is less than the distance to `t_min`: the sum is nearer to the interpolated `t`, a float, than to
/// `t_min`.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn meet<S: Simd, V: View<S>>(
    view: &V,
    of: u32,
    span: &Span<S>,
    culling: Culling,
) -> Option<Meeting<S>> {
    // SAFETY: the caller's contract.
    unsafe {
        let flat = view.flat();
        let [u, v, w] = edges::<S>(flat);
        let mut bits = of & of_one_sign::<S>([u, v, w]);
        if bits == 0 {
            return None;
        }
        let [da, db, dc] = view.depths();
        let nearest = S::min(da, S::min(db, dc));
        let farthest = S::max(da, S::max(db, dc));
        let depths = [nearest, farthest];
        // Edges of large triangles enclose the ray's line most often, wherever on it they are.
        bits &= S::bits(S::and(S::le(span.t_min, farthest), S::le(nearest, span.stop)));
        if bits == 0 {
            return None;
        }
        // Edge functions this small count as 0.
        let u = or_zero::<S>(u, EDGE_LEAST);
        let (v, w) = (or_zero::<S>(v, EDGE_LEAST), or_zero::<S>(w, EDGE_LEAST));
        let det = S::add(S::add(u, v), w);
        let sum = S::add(S::add(S::mul(u, da), S::mul(v, db)), S::mul(w, dc));
        let interpolated = S::div(sum, det);
        let (spread, size) = (S::sub(farthest, nearest), S::abs(det));
        let (beside, ends) = extent::<S>(flat);
        let width = view.width(ends);
        let most = view.reach_at_most(width, S::magnitude(nearest, farthest));
        let most_disorder = S::mul(S::mul(most, width), spread);
        let most_error = S::mul(most_disorder, S::splat(MORE_THAN_TWO_ERRORS));
        let nearly_eightfold = S::mul(S::splat(LESS_THAN_EIGHT), S::abs(sum));
        let (det_least, sum_least) = (S::splat(DET_LEAST), S::splat(SUM_LEAST));
        let fat = S::max(S::mul(S::mul(width, width), S::splat(SLIVER)), det_least);
        let fat = S::le(fat, size);
        let t = S::min(S::max(interpolated, nearest), farthest);
        let after = S::le(span.t_min, t);
        let gap = S::mul(S::sub(span.t_min, interpolated), size);
        let surely = S::and(S::le(most_error, gap), S::le(sum_least, nearly_eightfold));
        let before = S::bits(S::and(surely, fat)) & !S::bits(after);
        bits &= !before;
        if bits == 0 {
            return None;
        }
        bits &= !beside & faces::<S>(det, culling);
        let kept = S::bits(S::and(after, S::le(t, span.stop)));
        let plain = S::le(S::max(most_disorder, sum_least), nearly_eightfold);
        let fine = S::bits(S::and(plain, fat));
        // The reference finds the signs of edge functions that are 0.
        let least = S::min(S::abs(u), S::min(S::abs(v), S::abs(w)));
        let clear = S::bits(S::le(S::splat(EDGE_LEAST), least));
        let mut met = bits & fine & kept & clear;
        let (mut unclear, mut robust) = (0, 0);
        // Seldom.
        if bits & !(fine & (clear | !kept)) != 0 {
            let area = S::mul(view.reach(), width);
            let disorder = S::mul(area, spread);
            let eightfold = S::mul(S::splat(8.0), S::abs(sum));
            let plain = S::le(S::max(disorder, sum_least), eightfold);
            let fine = S::bits(S::and(plain, fat));
            let fine_and_kept = bits & fine & kept;
            // Many of the others are rejected as in the reference. Without a branch, which no predictor would get right.
            let error = S::mul(S::div(disorder, size), S::splat(INTERPOLATION_ERROR));
            let early = S::sub(interpolated, error);
            let after = S::le(span.t_min, S::add(interpolated, error));
            let before = S::le(early, span.t_max);
            // Nothing is further off than the farthest corner, whatever the error. A `t` that counts as 0 may precede the best.
            let stop = S::max(span.stop, S::splat(T_LEAST));
            let soon = S::le(S::min(farthest, early), stop);
            let known = S::le(det_least, size);
            let hazy = S::bits(S::le(disorder, S::max(eightfold, sum_least))) | !S::bits(known);
            let within = S::bits(S::and(S::and(after, before), soon)) | hazy;
            unclear = (bits & !fine & within) | (fine_and_kept & !clear);
            met = fine_and_kept & clear;
            let sure = S::le(S::mul(area, S::splat(ROBUST)), least);
            let short = S::le(spread, S::mul(S::splat(NEEDLE), width));
            let ordinary = S::and(short, S::le(S::splat(WIDTH_LEAST), width));
            robust = S::bits(S::and(sure, ordinary)) & clear;
        }
        Some(Meeting { met, unclear, robust, t, v, w, det, depths })
    }
}

impl<S: Simd> Meeting<S> {
    /// Those that are met at the least inner `t`.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn nearest(&self) -> u32 {
        // SAFETY: the caller's contract.
        unsafe { self.met & S::least(self.met, self.t) }
    }

    /// Decides what is unclear and robust; the rest is left to the reference.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn look_closely(&mut self, pairs: Pairs<S>, span: &Span<S>) {
        // SAFETY: the caller's contract.
        unsafe {
            let decided = self.unclear & self.robust;
            let Refined { t, v, w, det } = pairs.only(decided).refined();
            let (t, kept) = held::<S>(t, self.depths, span);
            self.met |= decided & kept;
            self.unclear &= !decided;
            let mask = S::mask(decided);
            self.t = S::select(mask, t, self.t);
            self.v = S::select(mask, v, self.v);
            self.w = S::select(mask, w, self.w);
            self.det = S::select(mask, det, self.det);
        }
    }
}

/// `t` clamped between the nearest and the farthest corner, and where it is within the span.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn held<S: Simd>(
    t: S::Floats,
    [nearest, farthest]: [S::Floats; 2],
    span: &Span<S>,
) -> (S::Floats, u32) {
    // SAFETY: the caller's contract.
    unsafe {
        let t = S::min(S::max(t, nearest), farthest);
        (t, S::bits(S::and(S::le(span.t_min, t), S::le(t, span.stop))))
    }
}

/// Where the ray is beside the bounds of the sheared corners, and their least and greatest sheared
/// coordinate.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn extent<S: Simd>(
    [[ax, bx, cx], [ay, by, cy]]: [[S::Floats; 3]; 2],
) -> (u32, [S::Floats; 2]) {
    // SAFETY: the caller's contract.
    unsafe {
        let (least_x, most_x) = (S::min(ax, S::min(bx, cx)), S::max(ax, S::max(bx, cx)));
        let (least_y, most_y) = (S::min(ay, S::min(by, cy)), S::max(ay, S::max(by, cy)));
        let zero = S::splat(0.0);
        let low = S::le(S::max(least_x, least_y), zero);
        let within = S::and(low, S::le(zero, S::min(most_x, most_y)));
        (!S::bits(within), [S::min(least_x, least_y), S::max(most_x, most_y)])
    }
}

/// Where the triangle is not culled, as far as the sum of its edge functions says.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn faces<S: Simd>(det: S::Floats, culling: Culling) -> u32 {
    // SAFETY: the caller's contract.
    unsafe {
        let zero = S::splat(0.0);
        match culling {
            Culling::None => !0,
            Culling::Back => S::bits(S::le(zero, det)),
            Culling::Front => S::bits(S::le(det, zero)),
        }
    }
}

/// 0 for numbers nearer to 0 than `least`.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn or_zero<S: Simd>(x: S::Floats, least: f32) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe { S::keep(S::le(S::splat(least), S::abs(x)), x) }
}

#[cfg(test)]
mod tests;
