//! Hits as real arithmetic has them: accuracy [`Exact`](crate::ray::Accuracy::Exact), and all hits.
//!
//! Decisions are exact for the mesh and the ray as given: coordinates after snapping (see
//! [`arithmetic::snap`](crate::arithmetic::snap)), nothing else rounded. Each question is first decided in `f64` with
//! a bound on its error (after Shewchuk 1997); where that does not suffice, in whole numbers
//! (`integer.rs`), which round nothing.
//!
//! Conventions: triangles are closed. A triangle without area, and one in whose plane the ray lies,
//! is met nowhere. Limits are closed and compared with the exact distance; the distance reported is
//! that one rounded to nearest, below 2^-126 taken as 0, beyond `f32::MAX` as `f32::MAX`.

pub(crate) mod cell;
mod doubled;
#[cfg(feature = "alloc")]
mod enclosed;
#[cfg(feature = "alloc")]
pub(crate) mod foot;
mod integer;
mod meeting;
#[cfg(feature = "alloc")]
mod number;
#[cfg(feature = "alloc")]
pub mod overlap;
mod perturbed;

pub use meeting::{Meeting, meet};
pub use perturbed::cross;

use crate::arithmetic::snap;
use crate::ray::Ray;

/// A ray as the exact predicates take it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExactRay {
    /// Origin, snapped.
    pub origin: [f32; 3],
    /// Direction, snapped; at least one component is not 0.
    pub direction: [f32; 3],
    /// Least accepted `t`, not NaN.
    pub t_min: f32,
    /// Greatest accepted `t`, not NaN.
    pub t_max: f32,
}

impl ExactRay {
    /// Checks a ray; `None` when it can hit nothing: a component that is not finite, a zero
    /// direction, a NaN limit, or no `t` between the limits.
    #[inline]
    pub fn new(ray: &Ray) -> Option<ExactRay> {
        let finite = |p: &[f32; 3]| p.iter().all(|x| x.is_finite());
        let direction = ray.direction.map(snap);
        let some = finite(&ray.origin)
            && finite(&ray.direction)
            && direction != [0.0; 3]
            && ray.t_min <= ray.t_max;
        some.then_some(ExactRay {
            origin: ray.origin.map(snap),
            direction,
            t_min: ray.t_min,
            t_max: ray.t_max,
        })
    }
}

#[cfg(all(test, feature = "alloc"))]
mod tests;
