//! Where points lie: the device counts the windings of a ray from each point. Where it is not certain of them, it lists the
//! triangles that the ray may meet, and the host counts.
//!
//! The ray has one direction for all points. A triangle that holds the point is in the list whatever its plane, since
//! the device leaves out only what the ray misses for certain; so the list serves the question whether the point is on
//! the surface too. For the same reason no count is certain of a point that a triangle holds.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;
use splitplane_core::error::QueryError;
use splitplane_core::query::inside;
use splitplane_core::query::inside::{DIRECTION, LocateOptions, Located, Locator};
use splitplane_core::ray::{QueryOptions, Ray};
use splitplane_core::report::QueryReport;
use splitplane_float_state::Standard;

use super::accelerator::WgpuAccelerator;
use super::held::Held;
use super::lists::{FEW, Lists, slice_of};
use super::settle::{Asking, list};
use crate::device::wait::{Wait, blocking};

/// Host memory for a point of a slice while the device counts.
const EACH: usize = size_of::<Ray>();

impl WgpuAccelerator {
    /// Where points lie.
    pub(super) fn find_windings(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        let LocateOptions { max_memory, watch } = *options;
        let asking = &Asking::new(watch, points.len());
        let held = &Held::new(inside::check_points(points.len(), max_memory)?, max_memory)?;
        asking.check()?;
        let mut windings = inside::no_windings(points.len())?;
        let mut report = QueryReport::default();
        let slice = slice_of(held, EACH);
        for (points, windings) in points.chunks(slice).zip(windings.chunks_mut(slice)) {
            report.append(self.wind(points, windings, asking, held)?, 0)?;
        }
        asking.check()?;
        Ok(Located { windings, report })
    }

    /// The windings of the points of a slice.
    fn wind(
        &self,
        points: &[[f32; 3]],
        windings: &mut [Option<i32>],
        asking: &Asking<'_>,
        held: &Held,
    ) -> Result<QueryReport, QueryError> {
        let query = &QueryOptions::default();
        let (mut share, mut for_rays) = (held.share(), held.share());
        for_rays.hold((points.len() * EACH) as u64)?;
        let mut rays = list(points.len())?;
        rays.extend(points.iter().map(|&point| Ray::new(point, DIRECTION)));
        let left = self.counted(&rays, query, asking, &mut share, |point, [front, back]| {
            // A ray from within leaves through backs.
            windings[point] = Some(back as i32 - front as i32);
        })?;
        let from = |range: Range<usize>| {
            let mut again = list(range.len())?;
            again.extend(left[range].iter().map(|&point| rays[point]));
            Ok(Cow::Owned(again))
        };
        let settle = |first: usize, rays: &[Ray], lists: &Lists<'_>| {
            let mut found: Vec<Option<i32>> = list(rays.len())?;
            found.resize(rays.len(), None);
            let tasks = rays.par_chunks(FEW).zip(found.par_chunks_mut(FEW)).enumerate();
            tasks.try_for_each(|(task, (rays, found))| {
                let _state = Standard::set();
                let mut share = held.share();
                let mut locator = Locator::default();
                for (place, (ray, winding)) in rays.iter().zip(found).enumerate() {
                    let listed = lists.of(task * FEW + place);
                    let visit = |ray: &Ray, test: &mut inside::Test<'_>| {
                        self.host_scene().visit(listed, ray, query, test);
                    };
                    let mut ended = asking.check();
                    ended.clone()?;
                    let wound = locator.winding(ray.origin, visit, &mut |bytes| {
                        ended = share.hold(bytes).and_then(|()| asking.check());
                        ended.is_ok()
                    });
                    ended?;
                    *winding = wound?;
                    asking.advance(1);
                }
                Ok::<(), QueryError>(())
            })?;
            for (&point, found) in left[first..].iter().zip(found) {
                windings[point] = found;
            }
            Ok(())
        };
        blocking(self.list_in_runs(Wait::Blocking, (left.len(), from), query, asking, held, settle))
    }
}
