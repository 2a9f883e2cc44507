//! `t` of the planes of triangles, a triangle and a ray a lane, for those that are seen at too grazing
//! an angle or from too near for interpolation.
//!
//! The operations are those of [`splitplane_core::intersect::distance_to_plane`] in its order, on sums
//! of two floats that do not overlap (Dekker 1971), so `t` is the same bit for bit. Left out
//! is only what adds zero: a zero may have the other sign here, which no other number depends on, since
//! divisors are not 0.

use splitplane_core::intersect::DOUBLE_NOISE;

use super::simd::{Simd, Task};

/// Rays and triangles, a pair a lane; on the axes of the mesh.
pub(crate) struct Plane<S: Simd> {
    /// Where the rays start.
    pub origin: [S::Floats; 3],
    /// Inner directions.
    pub direction: [S::Floats; 3],
    /// Corners, each on three axes.
    pub corners: [[S::Floats; 3]; 3],
}

impl<S: Simd> Task<S> for Plane<S> {
    /// `t`, and which lanes have one: not triangles without a plane, nor rays within it.
    type Output = (S::Floats, u32);

    #[inline(always)]
    unsafe fn run(&self) -> (S::Floats, u32) {
        // SAFETY: the caller's contract.
        unsafe {
            let [a, b, c] = self.corners;
            let (ab, ac) = (Double::<S>::edge(b, a), Double::<S>::edge(c, a));
            let oa = Double::<S>::edge(a, self.origin);
            let mut normal = ab;
            for axis in 0..3 {
                let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
                normal[axis] = ab[i].times(ac[j]).minus(ab[j].times(ac[i]));
            }
            let [x, y, z] = normal;
            let distance = x.times(oa[0]).plus(y.times(oa[1])).plus(z.times(oa[2]));
            let [dx, dy, dz] = self.direction;
            let speed = x.times_float(dx).plus(y.times_float(dy)).plus(z.times_float(dz));
            let t = S::div(distance.high, speed.high);
            // Below this the normal is what rounding left.
            let noise = S::mul(S::mul(length::<S>(ab), length::<S>(ac)), S::splat(DOUBLE_NOISE));
            let least = S::max(noise, S::splat(f32::MIN_POSITIVE));
            let without = S::bits(S::le(S::abs(speed.high), least));
            (t, S::bits(S::le(S::abs(t), S::splat(f32::MAX))) & !without)
        }
    }
}

/// The longest extent of edges.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
unsafe fn length<S: Simd>([x, y, z]: [Double<S>; 3]) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe { S::magnitude(S::magnitude(x.high, y.high), z.high) }
}

/// Sums of two floats that do not overlap, a sum a lane: see [`splitplane_core::arithmetic::Double`].
#[derive(Clone, Copy)]
struct Double<S: Simd> {
    high: S::Floats,
    low: S::Floats,
}

/// # Safety
/// All methods: the processor must have the set.
impl<S: Simd> Double<S> {
    /// From `from` to `to`, without error.
    #[inline(always)]
    unsafe fn edge(to: [S::Floats; 3], from: [S::Floats; 3]) -> [Double<S>; 3] {
        // SAFETY: the caller's contract.
        unsafe {
            [
                Double::difference_of(to[0], from[0]),
                Double::difference_of(to[1], from[1]),
                Double::difference_of(to[2], from[2]),
            ]
        }
    }

    /// `a - b` without error: Knuth's two-sum of `a` and `-b`.
    #[inline(always)]
    unsafe fn difference_of(a: S::Floats, b: S::Floats) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let high = S::sub(a, b);
            let b_part = S::sub(high, a);
            let a_part = S::sub(high, b_part);
            Double { high, low: S::sub(S::sub(a, a_part), S::add(b, b_part)) }
        }
    }

    /// The product.
    #[inline(always)]
    unsafe fn times(self, other: Double<S>) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let low = S::product_error(self.high, other.high);
            let low = S::add(low, S::mul(self.high, other.low));
            let low = S::add(low, S::mul(self.low, other.high));
            Double::renormalised(S::mul(self.high, other.high), low)
        }
    }

    /// The product with floats.
    #[inline(always)]
    unsafe fn times_float(self, other: S::Floats) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let low = S::product_error(self.high, other);
            let low = S::add(low, S::mul(self.low, other));
            Double::renormalised(S::mul(self.high, other), low)
        }
    }

    /// The sum.
    #[inline(always)]
    unsafe fn plus(self, other: Double<S>) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let high = S::add(self.high, other.high);
            let part = S::sub(high, self.high);
            let own = S::sub(high, part);
            let low = S::add(S::sub(self.high, own), S::sub(other.high, part));
            Double::renormalised(high, S::add(low, S::add(self.low, other.low)))
        }
    }

    /// The difference.
    #[inline(always)]
    unsafe fn minus(self, other: Double<S>) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let Double { high, low } = Double::<S>::difference_of(self.high, other.high);
            Double::renormalised(high, S::add(low, S::sub(self.low, other.low)))
        }
    }

    /// Dekker's fast two-sum: `high` is the greater.
    #[inline(always)]
    unsafe fn renormalised(high: S::Floats, low: S::Floats) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let sum = S::add(high, low);
            Double { high: sum, low: S::sub(low, S::sub(sum, high)) }
        }
    }
}
