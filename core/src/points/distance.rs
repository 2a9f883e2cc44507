//! Which of two points is closer, by operations that give the same bits on every device.
//!
//! *Units.* A tree measures in a unit of its own, 2^e, where e is the exponent of the greatest coordinate (at most 126). So coordinates are
//! between -4 and 4, whatever the cloud's size. A coordinate below 2^-126 counts as 0, in the caller's unit and in the tree's.
//!
//! *The squared distance* of q and p is `((s0 + s1) + s2) + s3` with `s = snap(d d)` and `d = q - p`, each operation guarded. A difference that
//! a device flushes has a square below 2^-252, which is 0 anyway, and sums of snapped squares are 0 or at least 2^-126: flushing cannot be seen.
//! So it errs by 5 u of itself (u = 2^-24: 2 u from a difference, squared, 1 u from a square, 3 u from up to three sums, less what does not
//! come together) plus N 2^-126; [`ERROR`] is 8 u. Two points whose distances are less than 2^-63 units count as equal to the query and tie.
//! A query beyond 2^63 units overflows: then all points are at infinity, and tie.
//!
//! *Ties* go to the lower index: what is compared is the [`key`].
//!
//! *Why culling loses no point.* A box, or the far side of a plane, is passed over where its bound is greater than the distance that
//! still counts. Let p lie in it. On each axis the exact `|q - p|` is at least the exact gap between q and the box. Rounding to nearest,
//! squaring of numbers that are not negative, snapping and sums are monotone, and the bound is made by the same operations in the same order
//! as the distance. So the computed bound is never above the computed distance of p, and no slack is needed. Bounds that
//! equal the distance are followed, since they may hold ties.

use crate::arithmetic::{Arithmetic, exponent, power_of_two, snap};

/// How far a squared distance may be off, relative to itself: 8 u.
pub const ERROR: f64 = 8.0 / 16_777_216.0;

/// The key of no point: after those of all points.
pub const NOTHING: u64 = key(f32::INFINITY, u32::MAX);

/// What orders points: squared distance (in units, not negative), then index.
#[inline(always)]
pub const fn key(distance_squared: f32, point: u32) -> u64 {
    (distance_squared.to_bits() as u64) << 32 | point as u64
}

/// The squared distance, in units, of a key.
#[inline(always)]
pub const fn distance_of(key: u64) -> f32 {
    f32::from_bits((key >> 32) as u32)
}

/// What an axis adds to a squared distance.
#[inline(always)]
pub fn part<A: Arithmetic>(difference: f32) -> f32 {
    A::snapped_product(difference, difference)
}

/// The sum of squares, in the order of axes.
#[inline(always)]
pub fn sum_of_squares<A: Arithmetic, const N: usize>(differences: [f32; N]) -> f32 {
    let mut sum = part::<A>(differences[0]);
    for axis in 1..N {
        sum = A::sum(sum, part::<A>(differences[axis]));
    }
    sum
}

/// The squared distance of two points in units.
#[inline(always)]
pub fn distance_squared<A: Arithmetic, const N: usize>(a: [f32; N], b: [f32; N]) -> f32 {
    let mut differences = a;
    for axis in 0..N {
        differences[axis] = A::difference(a[axis], b[axis]);
    }
    sum_of_squares::<A, N>(differences)
}

/// The unit that a tree measures in, a power of two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit {
    exponent: i32,
}

impl Unit {
    /// For coordinates of at most this size, which must be finite.
    pub fn of(greatest: f32) -> Unit {
        Unit { exponent: exponent(greatest).clamp(-126, 126) }
    }

    /// The power of two with this exponent, which is clamped to -126..=126.
    pub fn of_exponent(exponent: i32) -> Unit {
        Unit { exponent: exponent.clamp(-126, 126) }
    }

    /// The exponent of the power of two.
    pub fn exponent(self) -> i32 {
        self.exponent
    }

    /// A coordinate or a length, in units; infinite where it is too great.
    #[inline]
    pub fn scaled<A: Arithmetic>(self, length: f32) -> f32 {
        A::snapped_product(snap(length), power_of_two(-self.exponent))
    }

    /// A point, in units.
    #[inline]
    pub fn point<A: Arithmetic, const N: usize>(self, point: [f32; N]) -> [f32; N] {
        point.map(|x| self.scaled::<A>(x))
    }

    /// A coordinate of units as one of the caller's, without error.
    #[inline]
    pub fn of_units(self, x: f32) -> f64 {
        f64::from(x) * f64::from(power_of_two(self.exponent))
    }

    /// A squared distance in units as one of the caller's, without error.
    #[inline]
    pub fn unscaled(self, squared: f32) -> f64 {
        let unit = f64::from(power_of_two(self.exponent));
        f64::from(squared) * (unit * unit)
    }
}
