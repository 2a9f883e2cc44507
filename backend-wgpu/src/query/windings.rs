//! Where points lie: the device lists the triangles that a ray from each point may meet, and the host counts
//! windings.
//!
//! The ray has one direction for all points. A triangle that holds the point is in the list whatever its plane, since
//! the device leaves out only what the ray misses for certain; so the list serves the question whether the point is on
//! the surface too.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;
use splitplane_core::error::QueryError;
use splitplane_core::query::inside;
use splitplane_core::query::inside::{DIRECTION, LocateOptions, Located, Locator};
use splitplane_core::ray::{QueryOptions, Ray};

use super::accelerator::WgpuAccelerator;
use super::held::Held;
use super::lists::{FEW, Lists};
use super::settle::{Asking, list};

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
        let query = &QueryOptions::default();
        let from = |range: Range<usize>| {
            let mut rays = list(range.len())?;
            rays.extend(points[range].iter().map(|&point| Ray::new(point, DIRECTION)));
            Ok(Cow::Owned(rays))
        };
        let settle = |first: usize, rays: &[Ray], lists: &Lists<'_>| {
            let windings = &mut windings[first..first + rays.len()];
            let tasks = rays.par_chunks(FEW).zip(windings.par_chunks_mut(FEW)).enumerate();
            tasks.try_for_each(|(task, (rays, windings))| {
                let mut share = held.share();
                let mut locator = Locator::default();
                for (place, (ray, winding)) in rays.iter().zip(windings).enumerate() {
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
                Ok(())
            })
        };
        let report = self.list_in_runs(points.len(), from, query, asking, held, settle)?;
        asking.check()?;
        Ok(Located { windings, report })
    }
}
