//! Inside or outside: how often a closed surface winds around a point.
//!
//! A ray from the point counts the surfaces it leaves and enters, each once even where it runs through
//! edges and vertices ([`crate::all_hits`]). All is decided exactly, so the answer does not depend on the
//! ray's direction, nor on how near a surface the point lies; a point exactly on a surface is told apart.
//!
//! That holds for surfaces that are *closed*: every edge is passed as often in one direction as in the
//! other by the triangles around it. They may cross, touch, lie in one another and repeat. Triangles that
//! a build drops (two equal corners) do not open a surface, since they have no inside to lose; a triangle with
//! a coordinate that is not finite does. For an open surface the answer is that of one ray: whether it
//! means anything depends on where the holes are.
//!
//! Coordinates count as snapped (below 2^-126 as 0), those of points too.

use alloc::vec;
use alloc::vec::Vec;

use crate::backend::{Accelerator, QueryError, go_on_tracing};
use crate::ray::{Accuracy, QueryOptions, Ray};
use crate::watch::Watch;

/// Where a point lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Location {
    /// Outside of the surface.
    Outside,
    /// Within it.
    Inside,
    /// On a triangle, its edges and corners included. Triangles without area do not count: where a surface
    /// is closed, others cover them.
    Boundary,
}

/// What counts as inside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rule {
    /// A winding number other than 0: what lies within any of several surfaces.
    #[default]
    NonZero,
    /// An odd winding number: an odd number of surfaces around the point. Does not ask which way the
    /// triangles are turned.
    EvenOdd,
}

/// Where the points of a batch lie.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Located {
    /// How often the surface winds around each point; `None` for points on it. One surface whose corners run
    /// counter-clockwise as seen from outside winds once around what is in it, one turned the other
    /// way -1 times.
    pub windings: Vec<Option<i32>>,
    /// Points that the accelerator of a device answered on the CPU; see
    /// [`AllHits::answered_by_cpu`](crate::all_hits::AllHits::answered_by_cpu).
    pub answered_by_cpu: u64,
}

impl Located {
    /// Where a point of the batch lies.
    pub fn location(&self, point: usize, rule: Rule) -> Location {
        match (self.windings[point], rule) {
            (None, _) => Location::Boundary,
            (Some(0), _) => Location::Outside,
            (Some(winding), Rule::EvenOdd) if winding % 2 == 0 => Location::Outside,
            _ => Location::Inside,
        }
    }
}

/// The direction of rays that count windings: along no axis, so that few of them run through edges.
pub const DIRECTION: [f32; 3] = [0.537_109_4, 0.291_015_6, 0.791_015_6];

/// Points of a part of a batch: what holds all crossings of their rays at once.
const PART: usize = 1 << 12;

/// Where points lie, by rays in this direction (finite, not zero), which makes no difference where the surface is
/// closed. A point with a coordinate that is not finite is outside. `watch` is told how many points are
/// done.
///
/// # Errors
/// As for [`Accelerator::all_hits_watched`].
pub fn locate_along(
    accelerator: &(impl Accelerator + ?Sized),
    points: &[[f32; 3]],
    direction: [f32; 3],
    watch: &dyn Watch,
) -> Result<Located, QueryError> {
    let total = points.len() as u64;
    let mut located = Located { windings: vec![Some(0); points.len()], answered_by_cpu: 0 };
    let parts = points.chunks(PART).zip(located.windings.chunks_mut(PART)).enumerate();
    for (part, (points, windings)) in parts {
        go_on_tracing(watch, (part * PART) as u64, total)?;
        mark_boundary(accelerator, points, windings)?;
        let beside: Vec<usize> = (0..points.len()).filter(|&i| windings[i].is_some()).collect();
        let rays: Vec<Ray> = beside.iter().map(|&i| Ray::new(points[i], direction)).collect();
        let all = accelerator.all_hits(&rays, &QueryOptions::default())?;
        for (ray, &point) in beside.iter().enumerate() {
            // A ray from within leaves through backs.
            let sign = |front: bool| if front { -1 } else { 1 };
            windings[point] = Some(all.of(ray).iter().map(|met| sign(met.front)).sum());
        }
        if all.answered_by_cpu > 0 {
            located.answered_by_cpu += points.len() as u64;
        }
    }
    go_on_tracing(watch, total, total)?;
    Ok(located)
}

/// Forgets the winding of points on triangles. A ray that ends where it begins meets, exactly, the triangles
/// that hold the point and whose plane it is not in; no plane holds all three axes.
fn mark_boundary(
    accelerator: &(impl Accelerator + ?Sized),
    points: &[[f32; 3]],
    windings: &mut [Option<i32>],
) -> Result<(), QueryError> {
    let exactly = QueryOptions { accuracy: Accuracy::Exact, ..QueryOptions::default() };
    let mut on = vec![false; points.len()];
    for axis in 0..3 {
        let mut direction = [0.0; 3];
        direction[axis] = 1.0;
        let rays: Vec<Ray> =
            points.iter().map(|&point| Ray::new(point, direction).with_limits(0.0, 0.0)).collect();
        accelerator.any_hits(&rays, &mut on, &exactly)?;
        for (winding, on) in windings.iter_mut().zip(&on) {
            if *on {
                *winding = None;
            }
        }
    }
    Ok(())
}
