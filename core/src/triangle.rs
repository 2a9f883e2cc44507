//! Triangles: which ones of the input are kept, and clipping to one side of a split plane.

use crate::aabb::{Aabb, max, min};
use crate::arithmetic::{Arithmetic, snap};

/// Three corners.
pub type Triangle = [[f32; 3]; 3];

/// One input triangle as the builder prepared it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prepared {
    /// The corners, every coordinate snapped.
    pub corners: Triangle,
    /// False when the triangle is left out: a coordinate is not finite, or two corners are equal
    /// bit for bit after snapping. Collinear triangles with three distinct corners are kept: they
    /// are the seams of T-junctions, and dropping them leaks.
    pub kept: bool,
    /// True when snapping changed a coordinate.
    pub snapped: bool,
}

/// Snaps a triangle and decides whether it is kept. Without branches: every triangle passes through
/// here.
#[inline]
pub fn prepare(input: &Triangle) -> Prepared {
    let mut corners = *input;
    let (mut greatest, mut changed) = (0, 0);
    for x in corners.as_flattened_mut() {
        let before = x.to_bits();
        *x = snap(*x);
        greatest = greatest.max(before & 0x7fff_ffff);
        changed |= before ^ x.to_bits();
    }
    // The bits of finite numbers, without the sign, are less than those of infinity.
    let finite = greatest < f32::INFINITY.to_bits();
    let [a, b, c] = corners;
    let differ = |p: [f32; 3], q: [f32; 3]| (p[0] != q[0]) | (p[1] != q[1]) | (p[2] != q[2]);
    Prepared {
        corners,
        kept: finite & differ(a, b) & differ(b, c) & differ(c, a),
        snapped: finite & (changed != 0),
    }
}

/// Beyond this magnitude, edge differences could overflow and clipping keeps the old bounds.
pub const GREATEST_CLIPPED: f32 = 8.507_059e37; // 2^126
/// Below this extent across the plane, `plane - corner` could be subnormal, which devices flush, and
/// clipping keeps the old bounds.
pub const LEAST_CLIPPED: f32 = 7.888_609e-31; // 2^-100
/// Each intersection point is off by at most 12 roundings (2^-24 each) of the greater end of its edge
/// (ends of opposite signs double the difference); it is pushed outward by a third more.
pub const OUTWARD: f32 = 9.536_743e-7; // 2^-20
/// The greatest loss of a flushed product.
pub const OUTWARD_LEAST: f32 = 7.523_164e-37; // 2^-120

/// Bounds of the parts of a triangle left and right of a plane, within the reference's old bounds
/// (which may already be clipped by other planes): Zhou et al. 2008, Algorithm 2, "clip". Rounded
/// outward, so they hold every point of the exact parts. A part without points comes out empty.
///
/// The plane must lie strictly between the old bounds on its axis.
#[inline]
pub fn clip<A: Arithmetic>(
    corners: &Triangle,
    bounds: &Aabb,
    axis: usize,
    plane: f32,
) -> [Aabb; 2] {
    let mut limits = [*bounds, *bounds];
    limits[0].hi[axis] = plane;
    limits[1].lo[axis] = plane;
    let mut reach = 0.0;
    for x in corners.as_flattened() {
        reach = max(reach, x.abs());
    }
    if reach > GREATEST_CLIPPED {
        return limits;
    }
    let others = [(axis + 1) % 3, (axis + 2) % 3];
    let mut parts = [Aabb::EMPTY; 2];
    for i in 0..3 {
        let (p, q) = (&corners[i], &corners[(i + 1) % 3]);
        // A corner in the plane belongs to both sides.
        for (part, inside) in parts.iter_mut().zip([p[axis] <= plane, p[axis] >= plane]) {
            if inside {
                for other in others {
                    part.lo[other] = min(part.lo[other], p[other]);
                    part.hi[other] = max(part.hi[other], p[other]);
                }
            }
        }
        let crosses = (p[axis] < plane && plane < q[axis]) || (q[axis] < plane && plane < p[axis]);
        if !crosses {
            continue;
        }
        // From the lower end in both triangles of an edge, so that both compute the same point.
        let (low, high) = if p[axis] < q[axis] { (p, q) } else { (q, p) };
        let across = A::snapped_difference(high[axis], low[axis]);
        if across < LEAST_CLIPPED {
            return limits;
        }
        let ratio = A::quotient(A::snapped_difference(plane, low[axis]), across);
        for other in others {
            let along = A::snapped_difference(high[other], low[other]);
            let point = A::snapped_sum(low[other], A::snapped_product(ratio, along));
            let reach = max(low[other].abs(), high[other].abs());
            let error = A::snapped_sum(A::snapped_product(reach, OUTWARD), OUTWARD_LEAST);
            let (least, most) = (A::snapped_difference(point, error), A::snapped_sum(point, error));
            for part in &mut parts {
                part.lo[other] = min(part.lo[other], least);
                part.hi[other] = max(part.hi[other], most);
            }
        }
    }
    for (limit, part) in limits.iter_mut().zip(&parts) {
        for other in others {
            limit.lo[other] = max(limit.lo[other], part.lo[other]);
            limit.hi[other] = min(limit.hi[other], part.hi[other]);
        }
    }
    limits
}

/// True when a corner within the bounds shows, without clipping, that the triangle has points on
/// both sides of the plane: the common case, of triangles not clipped before.
#[inline]
pub fn corners_on_both_sides(corners: &Triangle, bounds: &Aabb, axis: usize, plane: f32) -> bool {
    let (mut left, mut right) = (false, false);
    for corner in corners {
        let mut within = true;
        for k in 0..3 {
            within &= bounds.lo[k] <= corner[k] && corner[k] <= bounds.hi[k];
        }
        left |= within && corner[axis] <= plane;
        right |= within && corner[axis] >= plane;
    }
    left && right
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::{Hostile, Strict};

    #[test]
    fn what_is_kept() {
        let good = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        assert!(prepare(&good).kept, "collinear triangles stay");
        let mut equal = good;
        equal[1] = [-0.0, 0.0, 1e-40];
        assert!(!prepare(&equal).kept, "equal after snapping");
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut triangle = good;
            triangle[2][1] = bad;
            assert!(!prepare(&triangle).kept);
        }
        let mut tiny = good;
        tiny[0][2] = -0.0;
        assert!(prepare(&tiny).snapped && prepare(&tiny).kept);
    }

    /// Every point of the triangle on a side lies in that side's clipped bounds, and the bounds are
    /// tight to within the stated error; the hostile model agrees bit for bit.
    #[test]
    fn clipped_bounds_hold_their_part() {
        let mut state = 1u32;
        let mut next = move || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 8) as f32 / 16_777_216.0 * 20.0 - 10.0
        };
        for _ in 0..2000 {
            let corners: Triangle = core::array::from_fn(|_| core::array::from_fn(|_| next()));
            let bounds = Aabb::of_points(&corners);
            for axis in 0..3 {
                let plane = 0.5 * bounds.lo[axis] + 0.5 * bounds.hi[axis];
                let parts = clip::<Strict>(&corners, &bounds, axis, plane);
                assert_eq!(parts, clip::<Hostile>(&corners, &bounds, axis, plane));
                assert!(corners_on_both_sides(&corners, &bounds, axis, plane));
                for (side, part) in parts.iter().enumerate() {
                    for k in 0..=400 {
                        let (u, v) = (f64::from(k % 20) / 20.0, f64::from(k / 20) / 20.0);
                        if u + v > 1.0 {
                            continue;
                        }
                        let point: [f64; 3] = core::array::from_fn(|i| {
                            let [a, b, c] = corners.map(|p| f64::from(p[i]));
                            a + u * (b - a) + v * (c - a)
                        });
                        let here = if side == 0 {
                            point[axis] <= f64::from(plane)
                        } else {
                            point[axis] >= f64::from(plane)
                        };
                        let slack = 1e-12;
                        assert!(
                            !here
                                || (0..3).all(|i| {
                                    f64::from(part.lo[i]) <= point[i] + slack
                                        && point[i] <= f64::from(part.hi[i]) + slack
                                })
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn a_triangle_that_only_touches_is_cut_to_the_touching_part() {
        let corners = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        let bounds = Aabb::of_points(&corners);
        let [_, right] = clip::<Strict>(&corners, &bounds, 0, 3.0);
        assert_eq!(right.lo[0], 3.0);
        assert!(right.hi[1] >= 1.0 && right.hi[1] < 1.0001);
        // Within old bounds that the part does not reach, nothing remains.
        let far = Aabb { lo: [0.0, 2.0, 0.0], hi: [4.0, 4.0, 0.0] };
        assert!(clip::<Strict>(&corners, &far, 0, 3.0)[1].is_empty());
        assert!(!corners_on_both_sides(&corners, &far, 0, 3.0));
    }
}
