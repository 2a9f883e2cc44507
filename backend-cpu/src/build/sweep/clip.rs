//! Perfect splits: the bounds of what a triangle has in a cell.

use splitplane_core::aabb::Aabb;
use splitplane_core::layout::Reference;
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
    let clipper = Clipper::new(cell, axis, plane);
    let parts =
        clipper.clip(&points(corners), &Reference::new(bounds, 0), &mut Polygons::default());
    parts.map(|part| part.1.then(|| part.0.bounds()))
}

/// The corners of a triangle.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn points(corners: &Triangle) -> [Point; 3] {
    corners.map(|[x, y, z]| [f64::from(x), f64::from(y), f64::from(z), 0.0])
}

/// Clips triangles to the two sides of a plane in a cell.
pub(super) struct Clipper {
    /// Ends of the cell; nothing is beyond the fourth ones.
    lo: Point,
    hi: Point,
    axis: usize,
    plane: f32,
    /// The plane on its axis, and nothing on the others.
    low: [f32; 4],
    high: [f32; 4],
}

impl Clipper {
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn new(cell: &Aabb, axis: usize, plane: f32) -> Clipper {
        let [mut lo, mut hi] = [[f64::NEG_INFINITY; 4], [f64::INFINITY; 4]];
        for k in 0..3 {
            (lo[k], hi[k]) = (f64::from(cell.lo[k]), f64::from(cell.hi[k]));
        }
        let [mut low, mut high] = [[f32::NEG_INFINITY; 4], [f32::INFINITY; 4]];
        (low[axis], high[axis]) = (plane, plane);
        Clipper { lo, hi, axis, plane, low, high }
    }

    /// [`clip`] for a reference; whether there is such a part comes with it.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn clip(
        &self,
        corners: &[Point; 3],
        reference: &Reference,
        polygons: &mut Polygons,
    ) -> [(Reference, bool); 2] {
        let [a, b, c] = corners;
        // Sides of the cell that the triangle crosses: two bits an axis.
        let (mut errors, mut crossed) = ([0.0; 4], 0u32);
        for k in 0..4 {
            let low = least(least(a[k], b[k]), c[k]);
            let high = greatest(greatest(a[k], b[k]), c[k]);
            errors[k] = greatest(-low, high) * ERROR;
            crossed |= u32::from(low < self.lo[k]) << (2 * k);
            crossed |= u32::from(high > self.hi[k]) << (2 * k + 1);
        }
        let (axis, plane) = (self.axis, f64::from(self.plane));
        // Most triangles lie within the cell.
        let parts = if crossed == 0 {
            extents(corners, axis, plane, errors[axis])
        } else {
            let Polygons([polygon, next]) = polygons;
            let (mut polygon, mut next) = (polygon, next);
            polygon.corners[..3].copy_from_slice(corners);
            polygon.count = 3;
            while crossed != 0 {
                let side = crossed.trailing_zeros() as usize;
                crossed &= crossed - 1;
                let (k, above) = (side / 2 % 4, side % 2 == 1);
                let plane = if above { self.hi[k] + errors[k] } else { self.lo[k] - errors[k] };
                polygon.cut(k, plane, if above { -1.0 } else { 1.0 }, next);
                (polygon, next) = (next, polygon);
            }
            extents(&polygon.corners[..polygon.count.min(CORNERS)], axis, plane, errors[axis])
        };
        let [left, right] = &parts;
        [
            within(left, &errors, reference, &[f32::NEG_INFINITY; 4], &self.high),
            within(right, &errors, reference, &self.low, &[f32::INFINITY; 4]),
        ]
    }
}

/// A point: three coordinates, and 0 to fill the vector.
pub(super) type Point = [f64; 4];

/// Scratch: the part of a triangle within the planes so far, and within one more.
#[derive(Default)]
pub(super) struct Polygons([Polygon; 2]);

/// A convex polygon.
#[derive(Default)]
struct Polygon {
    corners: [Point; CORNERS + 1],
    count: usize,
}

impl Polygon {
    /// The part on the side of a plane that `sign` points to.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn cut(&self, axis: usize, plane: f64, sign: f64, out: &mut Polygon) {
        out.count = 0;
        for i in 0..self.count.min(CORNERS) {
            let p = &self.corners[i];
            let q = &self.corners[if i + 1 == self.count { 0 } else { i + 1 }];
            let (dp, dq) = ((p[axis] - plane) * sign, (q[axis] - plane) * sign);
            // Written without branches, and counted where they are there. A convex polygon gains one
            // corner a cut; rounding may make it a little less convex, but corners beyond the ninth
            // lie on an edge.
            out.corners[out.count] = *p;
            out.count = (out.count + usize::from(dp >= 0.0)).min(CORNERS);
            let mut cut = between(p, q, dp / (dp - dq));
            cut[axis] = plane;
            out.corners[out.count] = cut;
            let crosses = (dp > 0.0) & (dq < 0.0) | (dp < 0.0) & (dq > 0.0);
            out.count = (out.count + usize::from(crosses)).min(CORNERS);
        }
    }
}

/// Lower and upper ends, on each axis, of the parts of a polygon on both sides of a plane that is off by
/// at most `error`.
#[cfg_attr(not(unoptimised), inline(always))]
fn extents(corners: &[Point], axis: usize, plane: f64, error: f64) -> [[Point; 2]; 2] {
    let (below, above) = (plane + error, plane - error);
    let mut parts = [[[f64::INFINITY; 4], [f64::NEG_INFINITY; 4]]; 2];
    for i in 0..corners.len() {
        let p = &corners[i];
        let q = &corners[if i + 1 == corners.len() { 0 } else { i + 1 }];
        let (from, to) = (p[axis], q[axis]);
        for (part, plane, sign) in [(0, below, 1.0), (1, above, -1.0)] {
            // Without branches: missing corners are infinitely far away. Signs change no
            // comparison.
            let (here, there) = ((plane - from) * sign, (plane - to) * sign);
            let cut = between(p, q, (plane - from) / (to - from));
            let corner = here >= 0.0;
            let crosses = (here > 0.0) & (there < 0.0) | (here < 0.0) & (there > 0.0);
            add(&mut parts[part], p, corner);
            add(&mut parts[part], &cut, crosses);
        }
    }
    parts
}

/// The intersection of a reference's bounds with extents, rounded outward, and with a side of a
/// plane; and whether it is not empty.
#[cfg_attr(not(unoptimised), inline(always))]
fn within(
    [lo, hi]: &[Point; 2],
    errors: &Point,
    reference: &Reference,
    least_low: &[f32; 4],
    greatest_high: &[f32; 4],
) -> (Reference, bool) {
    let words: &[f32; 8] = bytemuck::cast_ref(reference);
    let (mut out, mut empty) = (*words, false);
    for k in 0..4 {
        let (low, high) = (down(lo[k] - errors[k]), up(hi[k] + errors[k]));
        let low = if low > least_low[k] { low } else { least_low[k] };
        let high = if high < greatest_high[k] { high } else { greatest_high[k] };
        out[k] = if low > words[k] { low } else { words[k] };
        out[k + 4] = if high < words[k + 4] { high } else { words[k + 4] };
        empty |= k < 3 && out[k] > out[k + 4];
    }
    out[3] = words[3];
    out[7] = words[7];
    (bytemuck::cast(out), !empty)
}

/// Widens extents to a point, if it is there.
#[cfg_attr(not(unoptimised), inline(always))]
fn add([lo, hi]: &mut [Point; 2], point: &Point, there: bool) {
    for k in 0..4 {
        lo[k] = least(lo[k], if there { point[k] } else { f64::INFINITY });
        hi[k] = greatest(hi[k], if there { point[k] } else { f64::NEG_INFINITY });
    }
}

#[cfg_attr(not(unoptimised), inline(always))]
fn between(p: &Point, q: &Point, ratio: f64) -> Point {
    let mut out = [0.0; 4];
    for k in 0..4 {
        out[k] = p[k] + ratio * (q[k] - p[k]);
    }
    out
}

#[cfg_attr(not(unoptimised), inline(always))]
fn least(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

#[cfg_attr(not(unoptimised), inline(always))]
fn greatest(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// The greatest `f32` that is not above, 0 and numbers below 2^-126 apart: those go on to the next that
/// is not subnormal, as everything that reaches a tree.
#[cfg_attr(not(unoptimised), inline(always))]
fn down(x: f64) -> f32 {
    let near = x as f32;
    let bits = near.to_bits() as i32;
    // One step down of the bits of a number from 0 on is one of the number, below 0 one step up.
    let step = if f64::from(near) > x { 1 | bits >> 31 } else { 0 };
    let below = f32::from_bits(bits.wrapping_sub(step) as u32);
    let least = if x >= 0.0 { 0.0 } else { -f32::MIN_POSITIVE };
    // Nor is what is a step down from 0.
    if below.abs() >= f32::MIN_POSITIVE { below } else { least }
}

/// [`down`], the other way.
#[cfg_attr(not(unoptimised), inline(always))]
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
