//! Perfect splits: the bounds of what a triangle has in a cell.

use splitplane_core::aabb::Aabb;
use splitplane_core::triangle::Triangle;

/// Corners of a triangle cut by the six sides of a box.
const CORNERS: usize = 9;
/// Bound on the error of a computed corner, of the greatest coordinate of the triangle on that axis. Each
/// cut rounds at most 16 times (2^-53 each) and there are at most seven.
const ERROR: f64 = 1.0 / 70_368_744_177_664.0; // 2^-46

/// Bounds of the parts of a triangle in a cell left and right of a plane, within `bounds`, which those of
/// the part in the cell must be. Every point of the exact parts, sides of the cell included, lies
/// within; `None` where there is no such point. In `f64`, rounded outward.
///
/// The triangle is cut by the sides of the cell that it crosses and then by the plane (Sutherland and
/// Hodgman 1974). Every cut is by a plane moved outward by the bound on the error of the corners before:
/// so each point of the exact part stays within the error of some point of the computed one, however
/// steep the edges.
pub fn clip(
    corners: &Triangle,
    cell: &Aabb,
    bounds: &Aabb,
    axis: usize,
    plane: f32,
) -> [Option<Aabb>; 2] {
    let mut polygon = Polygon::of(corners);
    for side in 0..3 {
        let (lo, hi) = (f64::from(cell.lo[side]), f64::from(cell.hi[side]));
        if polygon.low[side] < lo {
            polygon.cut(side, lo - polygon.error[side], 1.0);
        }
        if polygon.high[side] > hi {
            polygon.cut(side, hi + polygon.error[side], -1.0);
        }
    }
    let (mut left, mut right) = (*bounds, *bounds);
    left.hi[axis] = plane;
    right.lo[axis] = plane;
    let extents = polygon.extents(axis, f64::from(plane));
    [polygon.bounds(&extents[0], left), polygon.bounds(&extents[1], right)]
}

/// The part of a triangle within the planes so far.
struct Polygon {
    corners: [[f64; 3]; CORNERS + 1],
    count: usize,
    /// Bounds of the triangle.
    low: [f64; 3],
    high: [f64; 3],
    /// Bounds on the error of corners, by axis.
    error: [f64; 3],
}

impl Polygon {
    #[inline]
    fn of(triangle: &Triangle) -> Polygon {
        let mut corners = [[0.0; 3]; CORNERS + 1];
        for (corner, input) in corners.iter_mut().zip(triangle) {
            *corner = input.map(f64::from);
        }
        let [a, b, c] = [corners[0], corners[1], corners[2]];
        let low = [0, 1, 2].map(|k| least(least(a[k], b[k]), c[k]));
        let high = [0, 1, 2].map(|k| greatest(greatest(a[k], b[k]), c[k]));
        let error = [0, 1, 2].map(|k| greatest(-low[k], high[k]) * ERROR);
        Polygon { corners, count: 3, low, high, error }
    }

    /// Keeps what lies on the side of a plane that `sign` points to.
    #[inline]
    fn cut(&mut self, axis: usize, plane: f64, sign: f64) {
        let mut out = [[0.0; 3]; CORNERS + 1];
        let mut count = 0;
        let mut push = |corner: &[f64; 3]| {
            // A convex polygon gains one corner a cut; rounding may make it a little less convex, but
            // corners beyond the ninth lie on an edge.
            out[count] = *corner;
            count = (count + 1).min(CORNERS);
        };
        for i in 0..self.count {
            let p = &self.corners[i];
            let q = &self.corners[if i + 1 == self.count { 0 } else { i + 1 }];
            let (dp, dq) = ((p[axis] - plane) * sign, (q[axis] - plane) * sign);
            if dp >= 0.0 {
                push(p);
            }
            if (dp > 0.0 && dq < 0.0) || (dp < 0.0 && dq > 0.0) {
                let mut cut = between(p, q, dp / (dp - dq));
                cut[axis] = plane;
                push(&cut);
            }
        }
        (self.corners, self.count) = (out, count);
    }

    /// What `limit` has in common with the extents of a part, rounded outward.
    #[inline(always)]
    fn bounds(&self, [lo, hi]: &[[f64; 3]; 2], mut limit: Aabb) -> Option<Aabb> {
        for k in 0..3 {
            let (low, high) = (down(lo[k] - self.error[k]), up(hi[k] + self.error[k]));
            limit.lo[k] = if low > limit.lo[k] { low } else { limit.lo[k] };
            limit.hi[k] = if high < limit.hi[k] { high } else { limit.hi[k] };
        }
        (!limit.is_empty()).then_some(limit)
    }

    /// Lower and upper ends, on each axis, of the parts on both sides of a plane.
    #[inline]
    fn extents(&self, axis: usize, plane: f64) -> [[[f64; 3]; 2]; 2] {
        let (below, above) = (plane + self.error[axis], plane - self.error[axis]);
        let mut parts = [[[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]]; 2];
        let [left, right] = &mut parts;
        for i in 0..self.count {
            let p = &self.corners[i];
            let q = &self.corners[if i + 1 == self.count { 0 } else { i + 1 }];
            let (from, to) = (p[axis], q[axis]);
            if from <= below {
                add(left, p);
            }
            if from >= above {
                add(right, p);
            }
            if (from < below && to > below) || (from > below && to < below) {
                add(left, &between(p, q, (below - from) / (to - from)));
            }
            if (from < above && to > above) || (from > above && to < above) {
                add(right, &between(p, q, (above - from) / (to - from)));
            }
        }
        parts
    }
}

#[inline(always)]
fn add([lo, hi]: &mut [[f64; 3]; 2], point: &[f64; 3]) {
    for k in 0..3 {
        lo[k] = least(lo[k], point[k]);
        hi[k] = greatest(hi[k], point[k]);
    }
}

#[inline(always)]
fn between(p: &[f64; 3], q: &[f64; 3], ratio: f64) -> [f64; 3] {
    let mut out = [0.0; 3];
    for k in 0..3 {
        out[k] = p[k] + ratio * (q[k] - p[k]);
    }
    out
}

#[inline(always)]
fn least(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

#[inline(always)]
fn greatest(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// The greatest `f32` that is not above, 0 and numbers below 2^-126 apart: those go on to the next that
/// is not subnormal, as everything that reaches a tree.
#[inline]
fn down(x: f64) -> f32 {
    let near = x as f32;
    let below = if f64::from(near) > x { near.next_down() } else { near };
    if below.abs() >= f32::MIN_POSITIVE {
        below
    } else if x >= 0.0 {
        0.0
    } else {
        -f32::MIN_POSITIVE
    }
}

/// [`down`], the other way.
#[inline]
fn up(x: f64) -> f32 {
    // 0 is not negated: the tree has no -0.
    0.0 - down(-x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_outward_and_leaves_no_subnormals() {
        for x in
            [0.0, 1.0, -1.0, 0.1, -0.1, 1e-40, -1e-40, 1e-38, -1e-38, 3.4e38, -3.4e38, 1.0 / 3.0]
        {
            let (low, high) = (down(x), up(x));
            assert!(f64::from(low) <= x && x <= f64::from(high), "{x}: {low} {high}");
            for y in [low, high] {
                assert!(y == 0.0 || y.is_normal(), "{x}: {y}");
                assert_ne!(y.to_bits(), (-0.0f32).to_bits());
            }
        }
        assert_eq!((down(0.5), up(0.5)), (0.5, 0.5));
        assert_eq!((down(1e-40), up(1e-40)), (0.0, f32::MIN_POSITIVE));
    }

    #[test]
    fn a_part_beside_the_cell_is_none() {
        // Its bounds meet the cell, it does not.
        let corners = [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [4.0, 4.0, 0.0]];
        let cell = Aabb { lo: [0.0; 3], hi: [1.0, 1.0, 1.0] };
        let bounds = Aabb { lo: [0.0; 3], hi: [1.0, 1.0, 0.0] };
        assert_eq!(clip(&corners, &cell, &bounds, 0, 0.5), [None, None]);
        // In a wider one the left part has nothing.
        let cell = Aabb { lo: [0.0; 3], hi: [4.0, 3.0, 1.0] };
        let bounds = Aabb { lo: [0.0; 3], hi: [4.0, 3.0, 0.0] };
        let [left, right] = clip(&corners, &cell, &bounds, 0, 0.5);
        assert_eq!(left, None);
        let right = right.unwrap();
        assert!(right.lo[0] <= 1.0 && right.lo[0] > 0.9999);
        assert_eq!(right.hi, [4.0, 3.0, 0.0]);
    }
}
