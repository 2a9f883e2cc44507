//! The numbers of exact hits, in vectors of `f64`.
//!
//! As [`splitplane_core::exact`] finds them first, with the same operations in the same order. Bounds of error are a fifth greater than there: what is
//! known here is known there, and by the same numbers.

use splitplane_core::arithmetic::snap;
use splitplane_core::ray::Ray;
use splitplane_core::triangle::Triangle;

use crate::simd::{Compiled, MOST_LANES, Simd};

/// A number of each pair of a ray and a triangle.
type Row = [f32; MOST_LANES];

/// Half a unit in the last place of 1.
const EPSILON: f64 = f64::EPSILON / 2.0;
/// Relative to the sum of the magnitudes of its terms a triple product errs by less than this.
const TRIPLE_ERROR: f64 = 12.0 * EPSILON;
/// The precision, as a part of the sum, to which weights must be known: 2^-27.
const WEIGHT_ERROR: f64 = 1.0 / (1u64 << 27) as f64;

/// Rays, and triangles that they meet, a pair in each lane.
#[derive(Clone, Copy)]
pub(crate) struct Meetings {
    /// Of the rays, as they were given.
    pub origin: [Row; 3],
    pub direction: [Row; 3],
    /// Snapped.
    pub corners: [[Row; 3]; 3],
}

/// What is known of them.
pub(crate) struct Numbers {
    pub t: Row,
    /// Weights of the second and third corner.
    pub u: Row,
    pub v: Row,
    /// For which lanes these are the numbers of the hit, as bits.
    pub known: u32,
}

impl Meetings {
    /// No rays.
    pub(crate) const NONE: Meetings = {
        let row = [0.0; MOST_LANES];
        Meetings { origin: [row; 3], direction: [row; 3], corners: [[row; 3]; 3] }
    };

    /// Sets a lane's ray and triangle.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn set(&mut self, lane: usize, ray: &Ray, corners: &Triangle) {
        for axis in 0..3 {
            self.origin[axis][lane] = ray.origin[axis];
            self.direction[axis][lane] = ray.direction[axis];
            for corner in 0..3 {
                self.corners[corner][axis][lane] = corners[corner][axis];
            }
        }
    }

    /// The ray of a lane, without limits, and the triangle.
    pub(crate) fn of(&self, lane: usize) -> (Ray, Triangle) {
        let at = |rows: &[Row; 3]| [rows[0][lane], rows[1][lane], rows[2][lane]];
        (Ray::new(at(&self.origin), at(&self.direction)), [0, 1, 2].map(|i| at(&self.corners[i])))
    }
}

impl Numbers {
    /// Nothing is known.
    pub(crate) const NONE: Numbers = {
        let row = [0.0; MOST_LANES];
        Numbers { t: row, u: row, v: row, known: 0 }
    };
}

/// The greater of two numbers.
#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The greatest magnitude of a component.
#[inline(always)]
fn greatest(x: f64, y: f64, z: f64) -> f64 {
    greater(greater(x.abs(), y.abs()), z.abs())
}

/// A weight, of an edge function and the sum of all three.
#[inline(always)]
fn weight(edge: f64, sum: f64) -> f32 {
    let x = snap((edge / sum) as f32);
    let x = if x < 0.0 { 0.0 } else { x };
    if x > 1.0 { 1.0 } else { x }
}

/// The first so many lanes, each of which has a pair.
pub(crate) struct FirstLanes<'a, const N: usize>(pub &'a Meetings);

impl<const N: usize> Compiled for FirstLanes<'_, N> {
    type Output = Numbers;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Numbers {
        let mut numbers = Numbers::NONE;
        let mut known = [0u32; MOST_LANES];
        let Meetings { origin, direction, corners } = self.0;
        let ([ox, oy, oz], [dx, dy, dz]) = (origin, direction);
        let [[ax, ay, az], [bx, by, bz], [cx, cy, cz]] = corners;
        // Without branches: compilers turn it into vectors.
        for i in 0..N {
            let (dx, dy, dz) = (snap(dx[i]), snap(dy[i]), snap(dz[i]));
            let (dx, dy, dz) = (f64::from(dx), f64::from(dy), f64::from(dz));
            let (ox, oy, oz) = (snap(ox[i]), snap(oy[i]), snap(oz[i]));
            let (ox, oy, oz) = (f64::from(ox), f64::from(oy), f64::from(oz));
            let (ax, ay, az) = (f64::from(ax[i]), f64::from(ay[i]), f64::from(az[i]));
            let (px, py, pz) =
                (f64::from(bx[i]) - ax, f64::from(by[i]) - ay, f64::from(bz[i]) - az);
            let (qx, qy, qz) =
                (f64::from(cx[i]) - ax, f64::from(cy[i]) - ay, f64::from(cz[i]) - az);
            let (x, y, z) = (ax - ox, ay - oy, az - oz);
            // d x ac, and oa x ab.
            let (ex, ey, ez) = (dy * qz - dz * qy, dz * qx - dx * qz, dx * qy - dy * qx);
            let (fx, fy, fz) = (y * pz - z * py, z * px - x * pz, x * py - y * px);
            let side = x * ex + y * ey + z * ez;
            let far = dx * fx + dy * fy + dz * fz;
            let speed = px * ex + py * ey + pz * ez;
            let numerator = qx * fx + qy * fy + qz * fz;
            let reach = 6.0 * TRIPLE_ERROR * greatest(x, y, z);
            let (wide, high) = (greatest(px, py, pz), greatest(qx, qy, qz));
            let fast = greatest(dx, dy, dz);
            let (v_error, w_error) = (reach * fast * high, reach * fast * wide);
            let error = 6.0 * TRIPLE_ERROR * fast * wide * high;
            let numerator_error = reach * wide * high;
            let denominator = -speed;
            // The distance.
            let value = numerator / denominator;
            let size = denominator.abs();
            let spread = numerator_error + error * value.abs();
            let off = 2.1 * spread / size + 2.0 * EPSILON * value.abs();
            let (least, most) = ((value - off) as f32, (value + off) as f32);
            let is_one = (least == most) & (least.abs() >= f32::MIN_POSITIVE);
            let is_finite = least.abs() <= f32::MAX;
            let is_sure = (numerator.abs() > numerator_error) & (size > 2.0 * error);
            // The weights.
            let sum = -denominator;
            let worst = greater(greater(v_error, w_error), error);
            let is_near = 8.0 * worst < size * WEIGHT_ERROR;
            let (u, v) = (weight(-side, sum), weight(-far, sum));
            let v = if u + v > 1.0 { 1.0 - u } else { v };
            (numbers.t[i], numbers.u[i], numbers.v[i]) = (least, u, v);
            known[i] = u32::from(is_one & is_finite & is_sure & is_near);
        }
        for (i, known) in known.into_iter().enumerate() {
            numbers.known |= known << i;
        }
        numbers
    }
}

#[cfg(test)]
mod tests;
