//! Bounds from below of the distances of triangles, for many triangles at once.
//!
//! Let the origin be the point, and x any vector. All of a triangle is on the far side of the plane across x through the corner c for which
//! x c is least, so it is no nearer than m / |x|, where m = min x c. Where x is the triangle's closest point, that is its distance. So x
//! needs no care: it is computed in `f32` with whatever errors, and only m / |x| must be trusted.
//!
//! *Errors.* u is 2^-24, and coordinates of corners are at most 2. A corner's coordinate errs by 2 u, its product with x, summed over the axes, by 3 u of
//! 2 |x|_1. Together that is 8 u |x|_1, at most 14 u |x|: the quotient m / |x| is too great by at most 14 u. Squares and their
//! quotient err by 5 u. [`widened`] allows for 16 u of each. Where m² is below [`LEAST`], what underflows might count, and the bound is 0.

use crate::simd::Simd;

/// 16 u.
const SLACK: f64 = 9.536_743_164_062_5e-7; // 2^-20
/// Below this a square is not trusted.
const LEAST: f32 = 7.888_609e-31; // 2^-100

/// Triangles may be passed over where [`squared_bounds`] gives more than this for them, if none of interest has a squared distance of more than `stop`.
pub(super) fn widened(stop: f64) -> f32 {
    let reach = stop.sqrt() + SLACK;
    (reach * reach * (1.0 + SLACK)) as f32
}

/// Bounds from below of the squared distances of triangles from the origin, for a comparison with [`widened`]. The corners are `corners[which][axis]`,
/// each coordinate at most 2.
///
/// x is the foot of the perpendicular where it lies within the triangle, and else the closest of the edges' closest points.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn squared_bounds<S: Simd>(corners: [[S::Floats; 3]; 3]) -> S::Floats {
    let [a, b, c] = corners;
    // SAFETY: the caller's contract.
    unsafe {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let part = |of: S::Floats, whole: S::Floats| {
            // 0 for what is no number.
            S::min(S::max(S::div(of, whole), zero), one)
        };
        let (e, f) = (difference::<S>(a, b), difference::<S>(a, c));
        let (ee, ff, ef) = (dot::<S>(e, e), dot::<S>(f, f), dot::<S>(e, f));
        // From the first corner to the origin, along both edges.
        let (pe, pf) = (S::sub(zero, dot::<S>(a, e)), S::sub(zero, dot::<S>(a, f)));

        // How much nearer the best of an edge is than the first corner, squared.
        let (along_e, along_f) = (part(pe, ee), part(pf, ff));
        let gain_e = S::mul(along_e, S::sub(S::add(pe, pe), S::mul(along_e, ee)));
        let gain_f = S::mul(along_f, S::sub(S::add(pf, pf), S::mul(along_f, ff)));
        // The third edge begins at the second corner.
        let (pg, gg) = {
            let less = S::sub(ee, ef);
            (S::add(S::sub(pf, pe), less), S::add(less, S::sub(ff, ef)))
        };
        let along_g = part(pg, gg);
        let gain_g = S::add(
            S::sub(S::add(pe, pe), ee),
            S::mul(along_g, S::sub(S::add(pg, pg), S::mul(along_g, gg))),
        );
        let f_is_nearer = S::le(gain_e, gain_f);
        let mut v = S::select(f_is_nearer, zero, along_e);
        let mut w = S::keep(f_is_nearer, along_f);
        let g_is_nearer = S::le(S::max(gain_e, gain_f), gain_g);
        v = S::select(g_is_nearer, S::sub(one, along_g), v);
        w = S::select(g_is_nearer, along_g, w);

        // The foot.
        let twice_area = S::div(one, S::sub(S::mul(ee, ff), S::mul(ef, ef)));
        let foot_v = S::mul(S::sub(S::mul(pe, ff), S::mul(pf, ef)), twice_area);
        let foot_w = S::mul(S::sub(S::mul(pf, ee), S::mul(pe, ef)), twice_area);
        let within = S::and(
            S::and(S::le(zero, foot_v), S::le(zero, foot_w)),
            S::le(S::add(foot_v, foot_w), one),
        );
        v = S::select(within, foot_v, v);
        w = S::select(within, foot_w, w);

        let mut x = a;
        for axis in 0..3 {
            x[axis] = S::add(S::add(a[axis], S::mul(v, e[axis])), S::mul(w, f[axis]));
        }
        let least = S::min(S::min(dot::<S>(x, a), dot::<S>(x, b)), dot::<S>(x, c));
        let least = S::max(least, zero);
        let squared = S::mul(least, least);
        S::keep(S::le(S::splat(LEAST), squared), S::div(squared, dot::<S>(x, x)))
    }
}

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn difference<S: Simd>(from: [S::Floats; 3], to: [S::Floats; 3]) -> [S::Floats; 3] {
    // SAFETY: the caller's contract.
    unsafe { [S::sub(to[0], from[0]), S::sub(to[1], from[1]), S::sub(to[2], from[2])] }
}

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn dot<S: Simd>(a: [S::Floats; 3], b: [S::Floats; 3]) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe { S::add(S::add(S::mul(a[0], b[0]), S::mul(a[1], b[1])), S::mul(a[2], b[2])) }
}

#[cfg(test)]
mod tests {
    use splitplane_core::query::closest_point::of_triangle;

    use super::*;
    use crate::simd::{Compiled, InstructionSet, MOST_LANES};

    struct Bounds<'a>(&'a [[[f32; MOST_LANES]; 3]; 3]);

    impl Compiled for Bounds<'_> {
        type Output = [f32; MOST_LANES];

        #[cfg_attr(not(unoptimised), inline(always))]
        unsafe fn run<S: Simd>(self) -> Self::Output {
            let mut row = [0.0; MOST_LANES];
            // SAFETY: the caller's contract.
            unsafe {
                let mut corners = [[S::splat(0.0); 3]; 3];
                for (corner, rows) in corners.iter_mut().zip(self.0) {
                    for (x, row) in corner.iter_mut().zip(rows) {
                        *x = S::load(row.as_ptr());
                    }
                }
                S::store(row.as_mut_ptr(), squared_bounds::<S>(corners));
            }
            row
        }
    }

    /// Coordinates at most 2: triangles of all sizes and shapes, near and far, flat ones, points, and what is no number.
    fn triangles() -> Vec<[[f32; 3]; 3]> {
        let mut state = 1u32;
        let mut random = move || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        let mut all = Vec::new();
        for number in 0..40_000 {
            let size = 0.5f32.powi(number % 27);
            let at = [random(), random(), random()].map(|x| x * 0.5f32.powi(number / 27 % 23));
            let mut corner = || [0, 1, 2].map(|axis: usize| at[axis] + size * random());
            let (a, b, mut c) = (corner(), corner(), corner());
            match number % 7 {
                0 => c = [0, 1, 2].map(|axis: usize| 0.5 * (a[axis] + b[axis])),
                1 => c = b,
                2 => c = [0, 1, 2].map(|axis: usize| b[axis] + 1e-4 * c[axis]),
                _ => {}
            }
            all.push([a, b, c]);
        }
        all.push([[f32::NAN; 3]; 3]);
        all.push([[0.0; 3]; 3]);
        all.push([[1e-30; 3]; 3]);
        all.push([[1e-40; 3], [0.0; 3], [1e-42; 3]]);
        all
    }

    #[test]
    fn bounds_are_never_above_the_distance_and_mostly_close_to_it() {
        let all = triangles();
        for set in InstructionSet::available() {
            let (mut close, mut looked, mut above) = (0, 0, 0);
            for some in all.chunks(set.lanes()) {
                let mut rows = [[[0.0; MOST_LANES]; 3]; 3];
                for (lane, triangle) in some.iter().enumerate() {
                    for (rows, corner) in rows.iter_mut().zip(triangle) {
                        for (row, x) in rows.iter_mut().zip(corner) {
                            row[lane] = *x;
                        }
                    }
                }
                // SAFETY: the processor has the set.
                let row = unsafe { set.run(Bounds(&rows)) };
                for (triangle, &bound) in some.iter().zip(&row) {
                    assert!(bound >= 0.0, "{set:?} {triangle:?}");
                    if triangle[0][0].is_nan() {
                        assert_eq!(bound, 0.0);
                        continue;
                    }
                    let squared = of_triangle([0.0; 3], triangle).distance_squared;
                    assert!(
                        bound <= widened(squared),
                        "{set:?} {triangle:?}: {bound:e} {squared:e}"
                    );
                    looked += 1;
                    above += usize::from(f64::from(bound) > squared);
                    close += usize::from(f64::from(bound).sqrt() > 0.99 * squared.sqrt() - 1e-6);
                }
            }
            assert!(close * 100 > looked * 95, "{set:?}: {close} of {looked}");
            // So what is allowed for is seen: without it the test above would fail.
            assert!(above > 0, "{set:?}");
        }
    }
}
