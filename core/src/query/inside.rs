//! Inside or outside: how often a closed surface winds around a point.
//!
//! A ray from the point counts the surfaces it leaves and enters, each once even where it runs
//! through edges and vertices ([`query::all_hits`](crate::query::all_hits)). Everything is decided exactly, so the answer
//! does not depend on the ray's direction, nor on how near a surface the point lies; a point
//! exactly on a surface is reported as such.
//!
//! That holds for surfaces that are *closed*: every edge is passed as often in one direction as in
//! the other by the triangles around it. They may cross, touch, lie in one another and repeat.
//! Triangles that a build drops (two equal corners) do not open a surface, since they have no
//! inside to lose; a triangle with a coordinate that is not finite does. For an open surface the
//! answer is that of one ray: whether it is meaningful depends on where the holes are.
//!
//! Coordinates count as snapped (below 2^-126 as 0), those of points too.

use alloc::vec::Vec;

use crate::cancel::go_on_tracing;
use crate::error::{QueryError, check_bytes, refused};
use crate::exact::{ExactRay, cross, meet};
use crate::query::all_hits::{Collector, make_room};
use crate::query::traverse::{Triangles, exact};
use crate::ray::{Culling, QueryOptions, Ray};
use crate::report::QueryReport;
use crate::tree::KdTreeView;
use crate::triangle::Triangle;
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
#[non_exhaustive]
pub enum Rule {
    /// A winding number other than 0: points within any of several surfaces.
    #[default]
    NonZero,
    /// An odd winding number: an odd number of surfaces around the point. Ignores the orientation
    /// of the triangles.
    EvenOdd,
}

/// Where the points of a batch lie.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Located {
    /// How often the surface winds around each point; `None` for points on it. A surface whose
    /// corners run counter-clockwise as seen from outside winds once around the points in it, one
    /// with the opposite orientation -1 times.
    pub windings: Vec<Option<i32>>,
    /// Which backend answered, as for [all hits](crate::query::all_hits::AllHits::report).
    pub report: QueryReport,
}

/// Limits of the search for where points lie.
#[derive(Clone, Copy, Debug, Default)]
pub struct LocateOptions<'a> {
    /// Most bytes that the answer and its parts may take; `None` for no limit.
    pub max_memory: Option<u64>,
    /// Receives the number of points that are done, and may cancel the batch, between points and
    /// within one; `None` for no watch.
    pub watch: Option<&'a dyn Watch>,
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

/// Tests a triangle that a ray may meet (snapped corners). Returns the `t` beyond which none is of
/// interest any more.
pub type Test<'a> = dyn FnMut(&ExactRay, &Triangle, u32) -> f64 + 'a;

/// Finds the windings of points, one at a time. Its memory grows with the triangles that one ray
/// crosses, four bytes for each, and is kept between points.
#[derive(Clone, Debug, Default)]
pub struct Locator {
    /// Triangles that the ray crosses, twice their index, and one more where it comes from the front.
    crossed: Vec<u32>,
    tests: u32,
}

impl Locator {
    /// The winding number of a point, `None` where it is on a triangle. `visit` hands all triangles
    /// that a ray may meet to a test, as often as it likes. Every few hundred triangles, and before
    /// it takes more memory, calls `go_on` with the number of bytes held; after it returns false,
    /// the result is invalid.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] where the system has no memory for the crossings; the bytes are those held
    /// here.
    pub fn winding(
        &mut self,
        point: [f32; 3],
        visit: impl Fn(&Ray, &mut Test<'_>),
        go_on: &mut impl FnMut(u64) -> bool,
    ) -> Result<Option<i32>, QueryError> {
        let Locator { crossed, tests } = self;
        crossed.clear();
        let mut is_due = || {
            *tests = tests.wrapping_add(1);
            tests.is_multiple_of(Collector::TESTS)
        };
        let bytes = |room: usize| (room * size_of::<u32>()) as u64;
        let mut ended = false;
        for ray in boundary_rays(point) {
            visit(&ray, &mut |ray, corners, _| {
                if !ended {
                    let met = meet(ray, corners, Culling::None);
                    ended = met.is_some_and(|met| met.is_within_limits())
                        || is_due() && !go_on(bytes(crossed.capacity()));
                }
                if ended { f64::NEG_INFINITY } else { f64::INFINITY }
            });
            if ended {
                return Ok(None);
            }
        }
        let mut was_refused = false;
        visit(&Ray::new(point, DIRECTION), &mut |ray, corners, triangle| {
            if ended {
                return f64::NEG_INFINITY;
            }
            if let Some(met) = cross(ray, corners, Culling::None)
                && met.is_within_limits()
            {
                match make_room(crossed, each_once, go_on) {
                    Ok(true) => crossed.push(triangle << 1 | u32::from(met.is_front())),
                    Ok(false) => ended = true,
                    Err(_) => (ended, was_refused) = (true, true),
                }
            }
            ended = ended || is_due() && !go_on(bytes(crossed.capacity()));
            if ended { f64::NEG_INFINITY } else { f64::INFINITY }
        });
        if was_refused {
            return Err(refused(bytes(crossed.capacity())));
        }
        each_once(crossed);
        // A ray from within leaves through backs.
        Ok(Some(crossed.iter().map(|crossing| if crossing & 1 == 1 { -1 } else { 1 }).sum()))
    }
}

fn each_once(crossed: &mut Vec<u32>) {
    crossed.sort_unstable();
    crossed.dedup();
}

/// Rays that end where they begin meet, exactly, the triangles that hold the point and whose plane they are
/// not in; no plane holds all three axes.
pub(crate) fn boundary_rays(point: [f32; 3]) -> [Ray; 3] {
    [0, 1, 2].map(|axis| {
        let mut direction = [0.0; 3];
        direction[axis] = 1.0;
        Ray::new(point, direction).with_limits(0.0, 0.0)
    })
}

/// Bytes of the answer to this many points.
///
/// # Errors
/// [`QueryError::OutOfMemory`] when they are more than allowed.
pub fn check_points(points: usize, max_memory: Option<u64>) -> Result<u64, QueryError> {
    let bytes = (points * size_of::<Option<i32>>()) as u64;
    check_bytes(bytes, max_memory)?;
    Ok(bytes)
}

/// The windings of this many points, all of them 0 so far, for which [`check_points`] has
/// accounted.
///
/// # Errors
/// [`QueryError::OutOfMemory`] where the system has no memory for them.
pub fn no_windings(points: usize) -> Result<Vec<Option<i32>>, QueryError> {
    let mut windings = Vec::new();
    let bytes = points.saturating_mul(size_of::<Option<i32>>()) as u64;
    windings.try_reserve_exact(points).map_err(|_| refused(bytes))?;
    windings.resize(points, Some(0));
    Ok(windings)
}

/// Where points lie, one at a time: the reference, which backends on devices use too.
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
///
/// # Errors
/// [`QueryError::OutOfMemory`] and [`QueryError::Cancelled`].
pub fn one_by_one(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    points: &[[f32; 3]],
    limits: &LocateOptions<'_>,
) -> Result<Located, QueryError> {
    let LocateOptions { max_memory, watch } = *limits;
    let (total, options) = (points.len() as u64, QueryOptions::default());
    let held = check_points(points.len(), max_memory)?;
    let mut located =
        Located { windings: no_windings(points.len())?, report: QueryReport::default() };
    let mut locator = Locator::default();
    for (done, (&point, winding)) in points.iter().zip(&mut located.windings).enumerate() {
        let mut ended = go_on_tracing(watch, done as u64, total);
        if ended.is_ok() {
            let visit = |ray: &Ray, test: &mut Test<'_>| {
                exact::visit(tree, triangles, ray, &options, &mut (), test);
            };
            let wound = locator.winding(point, visit, &mut |bytes| {
                ended = check_bytes(held + bytes, max_memory)
                    .and_then(|()| go_on_tracing(watch, done as u64, total));
                ended.is_ok()
            });
            *winding = wound.map_err(|error| error.beside(held, max_memory))?;
        }
        ended?;
    }
    go_on_tracing(watch, total, total)?;
    Ok(located)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whichever of the faces the ray leaves through, by whatever index, and inside out.
    #[test]
    fn windings_count_backs_less_fronts() {
        let corners = [[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]];
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let mut locator = Locator::default();
        for first in 0..4 {
            for (inside_out, winding) in [(false, 1), (true, -1)] {
                let visit = |ray: &Ray, test: &mut Test<'_>| {
                    let ray = ExactRay::new(ray).expect("a ray");
                    for index in 0..4 {
                        let [a, b, c] =
                            faces[(first + index) % 4].map(|corner: usize| corners[corner]);
                        let triangle = if inside_out { [a, c, b] } else { [a, b, c] };
                        test(&ray, &triangle, index as u32);
                    }
                };
                let mut of = |point| locator.winding(point, visit, &mut |_| true);
                assert_eq!(of([0.5; 3]), Ok(Some(winding)));
                assert_eq!(of([3.0; 3]), Ok(Some(0)));
                // In through one face and out through another.
                assert_eq!(of([-0.5, 0.5, -0.25]), Ok(Some(0)));
                assert_eq!(of([1.0, 1.0, 0.0]), Ok(None));
            }
        }
    }
}
