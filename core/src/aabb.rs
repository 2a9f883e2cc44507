//! Axis-aligned bounding boxes.

use bytemuck::{Pod, Zeroable};

use crate::arithmetic::{Arithmetic, Strict, sqrt};

/// An axis-aligned box `[lo, hi]`, both ends included. Units are those of the mesh.
///
/// A box with `lo > hi` on an axis holds nothing; [`Aabb::EMPTY`] is the neutral element of
/// [`Aabb::union`].
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Aabb {
    /// Lower corner.
    pub lo: [f32; 3],
    /// Upper corner.
    pub hi: [f32; 3],
}

impl Default for Aabb {
    /// [`Aabb::EMPTY`].
    fn default() -> Aabb {
        Aabb::EMPTY
    }
}

impl Aabb {
    /// The box that holds nothing: union with it changes no box. Finite, because WGSL may assume
    /// that infinities do not occur.
    pub const EMPTY: Aabb = Aabb { lo: [f32::MAX; 3], hi: [-f32::MAX; 3] };

    /// The least box that holds every point.
    #[inline]
    pub fn of_points(points: &[[f32; 3]]) -> Aabb {
        let mut bounds = Aabb::EMPTY;
        for point in points {
            for axis in 0..3 {
                bounds.lo[axis] = min(bounds.lo[axis], point[axis]);
                bounds.hi[axis] = max(bounds.hi[axis], point[axis]);
            }
        }
        bounds
    }

    /// The least box that holds both.
    #[inline]
    #[must_use]
    pub fn union(&self, other: &Aabb) -> Aabb {
        let mut out = *self;
        for axis in 0..3 {
            out.lo[axis] = min(out.lo[axis], other.lo[axis]);
            out.hi[axis] = max(out.hi[axis], other.hi[axis]);
        }
        out
    }

    /// The part common to both; empty when they do not meet.
    #[must_use]
    pub fn intersection(&self, other: &Aabb) -> Aabb {
        let mut out = *self;
        for axis in 0..3 {
            out.lo[axis] = max(out.lo[axis], other.lo[axis]);
            out.hi[axis] = min(out.hi[axis], other.hi[axis]);
        }
        out
    }

    /// True when the box holds no point.
    pub fn is_empty(&self) -> bool {
        (0..3).any(|axis| self.lo[axis] > self.hi[axis])
    }

    /// True when every point of `other` lies in this box; true for an empty `other`.
    pub fn contains(&self, other: &Aabb) -> bool {
        other.is_empty()
            || (0..3).all(|axis| self.lo[axis] <= other.lo[axis] && other.hi[axis] <= self.hi[axis])
    }

    /// The square of the distance from a point to the nearest point of the box; 0 within it, infinity for an
    /// empty box. In `f64`, so that it is off by a few parts in 2^52 at most: round it down by that for a bound
    /// that must not be too great.
    pub fn distance_squared(&self, point: [f32; 3]) -> f64 {
        if self.is_empty() {
            return f64::INFINITY;
        }
        let outside = [0, 1, 2].map(|axis| {
            let [lo, hi, at] = [self.lo[axis], self.hi[axis], point[axis]].map(f64::from);
            if at < lo {
                lo - at
            } else if at > hi {
                at - hi
            } else {
                0.0
            }
        });
        outside.iter().map(|distance| distance * distance).sum()
    }

    /// Half the extent on one axis: `hi / 2 - lo / 2`, each step snapped. Halving is exact above the
    /// subnormals, so this is the rounded extent, halved, and it cannot overflow.
    #[inline(always)]
    pub fn half_extent_in<A: Arithmetic>(&self, axis: usize) -> f32 {
        A::snapped_difference(
            A::snapped_product(self.hi[axis], 0.5),
            A::snapped_product(self.lo[axis], 0.5),
        )
    }

    /// [`Aabb::half_extent_in`] the arithmetic of Rust.
    pub fn half_extent(&self, axis: usize) -> f32 {
        self.half_extent_in::<Strict>(axis)
    }

    /// The axis of greatest extent; the lowest such axis on a tie.
    pub fn longest_axis(&self) -> usize {
        let half = [0, 1, 2].map(|axis| self.half_extent(axis));
        let mut longest = 0;
        for axis in 1..3 {
            if half[axis] > half[longest] {
                longest = axis;
            }
        }
        longest
    }

    /// Length of the diagonal in `f64`, for rules that place cameras and state errors; 0 for an
    /// empty box. Not used by anything that shapes a tree.
    pub fn diagonal(&self) -> f64 {
        if self.is_empty() {
            return 0.0;
        }
        let squared: f64 = (0..3)
            .map(|axis| f64::from(self.hi[axis]) - f64::from(self.lo[axis]))
            .map(|extent| extent * extent)
            .sum();
        sqrt(squared)
    }
}

/// The lesser value. Written out because `f32::min` may return either zero, while this keeps the
/// first on equality, as `select` does in WGSL.
#[inline]
pub fn min(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

/// The greater value; the first on equality.
#[inline]
pub fn max(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_to_faces_edges_and_corners() {
        let bounds = Aabb { lo: [-1.0, 0.0, 2.0], hi: [1.0, 3.0, 5.0] };
        for (point, distance) in [
            ([0.0, 1.0, 3.0], 0.0),
            ([1.0, 3.0, 5.0], 0.0),
            ([4.0, 1.0, 3.0], 9.0),
            ([0.0, -2.0, 1.0], 5.0),
            ([-3.0, 4.0, 7.0], 9.0),
            ([f32::MAX, 0.0, 2.0], (f64::from(f32::MAX) - 1.0).powi(2)),
        ] {
            assert_eq!(bounds.distance_squared(point), distance, "{point:?}");
        }
        assert_eq!(Aabb::EMPTY.distance_squared([0.0; 3]), f64::INFINITY);
    }

    #[test]
    fn diagonal_of_a_pythagorean_box() {
        let bounds = Aabb { lo: [1.0, 2.0, 3.0], hi: [3.0, 5.0, 9.0] };
        assert_eq!(bounds.diagonal(), 7.0);
        assert_eq!(Aabb::EMPTY.diagonal(), 0.0);
    }

    #[test]
    fn half_extent_survives_the_whole_range() {
        let bounds = Aabb { lo: [-f32::MAX; 3], hi: [f32::MAX; 3] };
        assert_eq!(bounds.half_extent(0), f32::MAX);
    }

    #[test]
    fn roots_squared_are_what_they_are_of() {
        for power in -1000..=1000 {
            for part in [1.0, 1.5, 1.9999] {
                let x = part * f64::from_bits(((1023 + power) as u64) << 52);
                let root = sqrt(x);
                let error = root * root / x - 1.0;
                assert!(root > 0.0 && error.abs() < 8.0 * f64::EPSILON, "{x}: {root}");
            }
        }
        assert_eq!(sqrt(f64::INFINITY), f64::INFINITY);
        for none in [0.0, -0.0, -1.0, f64::NEG_INFINITY, f64::NAN] {
            assert_eq!(sqrt(none), 0.0, "{none}");
        }
    }
}
