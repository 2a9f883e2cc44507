//! Rays and hits: what goes into a query and what comes out.

mod rays;

use crate::watch::Watch;
use bytemuck::{Pod, Zeroable};
use thiserror::Error;

pub use rays::Rays;

/// A ray: the points `origin + t * direction` with `t_min <= t <= t_max`, both ends included.
///
/// 32 bytes without padding, the form that crosses to a device. The direction may have any length
/// other than zero; `t` is in units of that length. A ray with a non-finite origin or direction, a
/// zero direction (components below 2^-126 count as zero) or a NaN limit hits nothing. `t_min` may
/// be negative and `t_max` infinite.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Ray {
    /// Where `t = 0`.
    pub origin: [f32; 3],
    /// Least accepted `t`.
    pub t_min: f32,
    /// Direction, of any length but zero.
    pub direction: [f32; 3],
    /// Greatest accepted `t`.
    pub t_max: f32,
}

impl Ray {
    /// The half-line from `origin`: `t` from 0 to infinity. Takes arrays, and vectors that turn into them, such
    /// as those of glam and mint.
    #[inline]
    pub fn new(origin: impl Into<[f32; 3]>, direction: impl Into<[f32; 3]>) -> Ray {
        let (origin, direction) = (origin.into(), direction.into());
        Ray { origin, t_min: 0.0, direction, t_max: f32::INFINITY }
    }

    /// The same ray with other limits, both included.
    #[must_use]
    pub const fn with_limits(mut self, t_min: f32, t_max: f32) -> Ray {
        self.t_min = t_min;
        self.t_max = t_max;
        self
    }

    /// The segment from `a` to `b`: `t` runs from 0 at `a` to 1 at `b`.
    pub fn segment(a: impl Into<[f32; 3]>, b: impl Into<[f32; 3]>) -> Ray {
        let (a, b) = (a.into(), b.into());
        Ray::new(a, [b[0] - a[0], b[1] - a[1], b[2] - a[2]]).with_limits(0.0, 1.0)
    }
}

/// Where a ray meets a triangle, or [`Hit::MISS`]. 16 bytes, the form that crosses to a device.
///
/// The point is `(1 - u - v) * a + u * b + v * c` for the triangle's corners `a`, `b`, `c`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Hit {
    /// Distance in units of the ray's direction; infinity for a miss.
    pub t: f32,
    /// Index of the triangle in the caller's mesh; `u32::MAX` for a miss.
    pub triangle: u32,
    /// Barycentric weight of the second corner, in `[0, 1]`.
    pub u: f32,
    /// Barycentric weight of the third corner, in `[0, 1]`.
    pub v: f32,
}

/// The word of [`Hit::UNDECIDED`], by the name that shaders give it.
const UNDECIDED_HIT: u32 = 0xffff_fffd;

impl Hit {
    /// The record of a miss.
    pub const MISS: Hit = Hit { t: f32::INFINITY, triangle: u32::MAX, u: 0.0, v: 0.0 };

    /// The `triangle` of a ray of accuracy `exact` that bounds of error left undecided; see
    /// [`Undecided::Flag`]. Its `t` is no greater than that of anything undecided.
    pub const UNDECIDED: u32 = UNDECIDED_HIT;

    /// True for a triangle that was hit: neither for a miss, nor for a mark that a device stores in
    /// place of an answer, such as [`Hit::UNDECIDED`].
    pub fn is_hit(&self) -> bool {
        self.triangle < Hit::UNDECIDED
    }

    /// True for a ray that a device left undecided: there may be a hit.
    pub fn is_undecided(&self) -> bool {
        self.triangle == Hit::UNDECIDED
    }

    /// `None` for a miss.
    pub fn some(self) -> Option<Hit> {
        self.is_hit().then_some(self)
    }

    /// True when this hit comes before `other`: lesser `t`, at equal `t` the lower triangle index.
    /// The order every query minimises, which makes the answer independent of traversal order.
    pub fn precedes(&self, other: &Hit) -> bool {
        self.t < other.t || (self.t == other.t && self.triangle < other.triangle)
    }
}

/// Which side of a triangle a query ignores. The front is the side from which the corners run
/// counter-clockwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Culling {
    /// Both sides count.
    #[default]
    None,
    /// Triangles seen from the back are ignored.
    Back,
    /// Triangles seen from the front are ignored.
    Front,
}

/// Which ray/triangle test answers a query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Accuracy {
    /// Moeller and Trumbore 1997: rays aimed at edges and vertices may leak through a closed mesh. Faster for rays that
    /// scatter in some scenes, by up to 1.3 times; slower than watertight for coherent ones.
    Fast,
    /// Woop, Benthin and Wald 2013 with guarded arithmetic: no ray slips between two triangles
    /// that share an edge or a vertex.
    #[default]
    Watertight,
    /// The hit that real arithmetic gives for the mesh and the ray as they are (see
    /// [`exact`](crate::exact)): least exact distance, among equal ones the lowest index. Its `t` is that
    /// distance rounded to nearest. A triangle without area is met nowhere, and neither is one in
    /// whose plane the ray lies.
    Exact,
}

impl Accuracy {
    /// All of them, in ascending order of their guarantees.
    pub const ALL: [Accuracy; 3] = [Accuracy::Fast, Accuracy::Watertight, Accuracy::Exact];

    /// The name that [`FromStr`](core::str::FromStr) reads; also used in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Accuracy::Fast => "fast",
            Accuracy::Watertight => "watertight",
            Accuracy::Exact => "exact",
        }
    }
}

/// A name that is not an accuracy's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("there is no accuracy of this name; the accuracies are fast, watertight and exact")]
pub struct UnknownAccuracy;

impl core::str::FromStr for Accuracy {
    type Err = UnknownAccuracy;

    /// The inverse of [`Accuracy::name`]; upper case is not accepted.
    fn from_str(name: &str) -> Result<Accuracy, UnknownAccuracy> {
        Accuracy::ALL.into_iter().find(|accuracy| accuracy.name() == name).ok_or(UnknownAccuracy)
    }
}

/// What to do with rays of accuracy [`Accuracy::Exact`] that a device cannot decide within its
/// bounds of error. Either way their number is in the [`QueryReport`](crate::report::QueryReport).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Undecided {
    /// Trace them again on the CPU.
    #[default]
    Redo,
    /// Leave them without an answer and list them in the report.
    Flag,
}

/// Query settings.
#[derive(Clone, Copy, Debug, Default)]
pub struct QueryOptions<'a> {
    /// Which triangle test answers.
    pub accuracy: Accuracy,
    /// Which side to ignore.
    pub culling: Culling,
    /// One triangle to ignore, by its index in the caller's mesh. All rays of the call ignore it, so it serves
    /// single rays that leave a surface. In a batch set [`Ray::t_min`] of each ray, or start it off the surface.
    pub ignore: Option<u32>,
    /// How to treat rays that a device cannot decide; accuracy [`Accuracy::Exact`] only.
    pub undecided: Undecided,
    /// Receives the number of rays that are done, and may cancel the batch; `None` for no watch.
    /// Answers do not depend on it.
    pub watch: Option<&'a dyn Watch>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accuracies_are_found_by_their_names() {
        for accuracy in Accuracy::ALL {
            assert_eq!(accuracy.name().parse(), Ok(accuracy));
        }
        assert_eq!("Exact".parse::<Accuracy>(), Err(UnknownAccuracy));
    }

    #[test]
    fn misses_and_marks_are_no_hits() {
        let hit = |triangle| Hit { triangle, ..Hit::MISS };
        assert!(hit(0).is_hit() && hit(0).some().is_some() && !hit(0).is_undecided());
        assert!(hit(Hit::UNDECIDED - 1).is_hit());
        assert!(!hit(Hit::UNDECIDED).is_hit() && hit(Hit::UNDECIDED).is_undecided());
        assert!(!Hit::MISS.is_hit() && !Hit::MISS.is_undecided() && Hit::MISS.some().is_none());
    }

    #[test]
    fn the_lower_triangle_comes_first_at_equal_distance() {
        let hit = |t, triangle| Hit { t, triangle, ..Hit::MISS };
        assert!(hit(1.0, 7).precedes(&hit(2.0, 3)) && !hit(2.0, 3).precedes(&hit(1.0, 7)));
        assert!(hit(1.0, 3).precedes(&hit(1.0, 7)) && !hit(1.0, 7).precedes(&hit(1.0, 3)));
        assert!(!hit(1.0, 3).precedes(&hit(1.0, 3)));
    }

    #[test]
    fn accuracies_are_told_apart_by_name() {
        assert_eq!(Accuracy::ALL.map(Accuracy::name), ["fast", "watertight", "exact"]);
        assert_eq!(Accuracy::default(), Accuracy::Watertight);
    }
}
