//! The range of a scene's coordinates and sizes, and the scale that queries derive from it.

use super::{
    COORDINATE_LEAST, COORDINATE_MOST, EXTENT_LEAST, FAR, ORIGIN_LEAST, ORIGIN_SLACK, SCENE_SLACK,
    SIZE_SLACK,
};
use crate::aabb::{Aabb, max, min};
use crate::triangle::Triangle;

/// The data of all triangles that queries need: the range of their coordinates and sizes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Greatest magnitude of a coordinate.
    pub greatest: f32,
    /// Least magnitude of a coordinate other than zero.
    pub least: f32,
    /// Longest extent of any triangle.
    pub longest: f32,
    /// Least of the triangles' longest extents.
    pub shortest: f32,
}

impl Limits {
    /// The limits of no triangle.
    pub const NONE: Limits =
        Limits { greatest: 0.0, least: f32::MAX, longest: 0.0, shortest: f32::MAX };

    /// The limits of one triangle.
    #[inline]
    pub fn of(triangle: &Triangle) -> Limits {
        let mut limits = Limits::NONE;
        let bounds = Aabb::of_points(triangle);
        let mut longest = 0.0;
        for axis in 0..3 {
            // Halved, so that it cannot overflow, and doubled unless that would.
            longest = max(longest, bounds.half_extent(axis));
            for corner in triangle {
                let magnitude = corner[axis].abs();
                limits.greatest = max(limits.greatest, magnitude);
                if magnitude > 0.0 {
                    limits.least = min(limits.least, magnitude);
                }
            }
        }
        longest = min(longest, 0.5 * f32::MAX) * 2.0;
        (limits.longest, limits.shortest) = (longest, longest);
        limits
    }

    /// The limits of both.
    #[inline]
    #[must_use]
    pub fn union(self, other: Limits) -> Limits {
        Limits {
            greatest: max(self.greatest, other.greatest),
            least: min(self.least, other.least),
            longest: max(self.longest, other.longest),
            shortest: min(self.shortest, other.shortest),
        }
    }
}

/// The scale of a scene, which queries need in addition to tree and triangles; computed once per
/// scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneScale {
    /// Bounds of the tree.
    pub bounds: Aabb,
    /// Absolute slack of plane positions.
    pub slack: f32,
    /// The same without the part that triangles' sizes need: for boxes that are [`widened`] by their own triangles'.
    pub base_slack: f32,
    /// The value for which origin coordinates below [`ORIGIN_LEAST`] are taken: 0, or where corners
    /// have coordinates so small that their distance from 0 might vanish in a product, that least
    /// value itself. Not in wide scenes.
    pub origin_least: f32,
    /// Origins within are not far: no closer look is needed.
    pub near: Aabb,
    /// True when exponents leave the range in which the plain test neither overflows nor meets
    /// subnormals; then every test is scaled first.
    pub wide: bool,
}

impl SceneScale {
    /// The scale of a scene with these bounds and limits.
    pub fn new(bounds: Aabb, limits: &Limits) -> SceneScale {
        let extent = longest_extent(&bounds);
        // Half of what counts as far, and clamped: a first guess that need not be exact.
        let reach = min(extent, f32::MAX / FAR) * (0.5 * FAR);
        let mut near = bounds;
        for axis in 0..3 {
            near.lo[axis] = (bounds.lo[axis] - reach).max(-f32::MAX);
            near.hi[axis] = (bounds.hi[axis] + reach).min(f32::MAX);
        }
        // The bounds of a tree may be wider than its triangles, though no tree of ours has such.
        let wide = limits.greatest > COORDINATE_MOST
            || bounds.lo.iter().chain(&bounds.hi).any(|x| x.abs() > COORDINATE_MOST)
            || extent < EXTENT_LEAST;
        // The last part matters only next to the least normal numbers, where a device may flush
        // halved positions and distances.
        let least = if wide { 4.0 * f32::MIN_POSITIVE } else { ORIGIN_SLACK };
        let base_slack = extent * SCENE_SLACK + least;
        SceneScale {
            bounds,
            near,
            // Each product is below its factor, and the sum of two such cannot overflow.
            slack: limits.longest * SIZE_SLACK + base_slack,
            base_slack,
            origin_least: if limits.least < COORDINATE_LEAST { ORIGIN_LEAST } else { 0.0 },
            wide,
        }
    }
}

/// The box of a part of some triangles, widened by the slack that triangles need none of which is longer than `longest`
/// on any axis. Rounded outward.
pub fn widened(part: &Aabb, longest: f32) -> Aabb {
    let slack = longest * SIZE_SLACK;
    Aabb {
        lo: part.lo.map(|x| (x - slack).next_down().max(-f32::MAX)),
        hi: part.hi.map(|x| (x + slack).next_up().min(f32::MAX)),
    }
}

/// The longest extent of a box, at most `f32::MAX`; 0 for an empty one.
pub fn longest_extent(bounds: &Aabb) -> f32 {
    let half = (0..3).map(|axis| bounds.half_extent(axis)).fold(0.0, max);
    min(half, 0.5 * f32::MAX) * 2.0
}
