//! Where points lie: windings around them.

use core::sync::atomic::AtomicU64;
use core::sync::atomic::Ordering::Relaxed;

use rayon::prelude::*;
use splitplane_core::error::{QueryError, refused};
use splitplane_core::query::inside;
use splitplane_core::query::inside::{LocateOptions, Located, Locator};
use splitplane_core::ray::{QueryOptions, Ray};
use splitplane_core::report::QueryReport;
use splitplane_core::watch::Stage;
use splitplane_float_state::Standard;

use super::CpuAccelerator;
use super::task_bytes::{FEW, TaskBytes};
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::trace::exact;

impl CpuAccelerator {
    /// Where points lie.
    pub(super) fn find_windings(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        let LocateOptions { max_memory, watch } = *options;
        let meter = &ProgressMeter::of(watch);
        meter.begin_stage(Stage::Rays, points.len() as u64);
        let held = AtomicU64::new(inside::check_points(points.len(), max_memory)?);
        meter.check_batch()?;
        let mut windings = inside::no_windings(points.len())?;
        let options = QueryOptions::default();
        let tasks = points.par_chunks(FEW).zip(windings.par_chunks_mut(FEW));
        tasks.try_for_each(|(points, windings)| {
            let _state = Standard::set();
            let mut share = TaskBytes { held: &held, own: 0, max_memory };
            let mut locator = Locator::default();
            for (&point, winding) in points.iter().zip(windings) {
                let mut ended = meter.check_batch();
                ended.clone()?;
                let visit = |ray: &Ray, test: &mut inside::Test<'_>| {
                    exact::visit(&self.layout, &self.layout.tree.bounds, ray, &options, test);
                };
                let wound = locator.winding(point, visit, &mut |bytes| {
                    meter.record_work(WORK_BETWEEN_CHECKS / 8);
                    ended = meter.check_batch().and_then(|()| share.hold(bytes));
                    ended.is_ok()
                });
                ended?;
                *winding = wound.map_err(|_| refused(held.load(Relaxed)))?;
                meter.advance(1);
                meter.record_work(WORK_BETWEEN_CHECKS / 64);
            }
            share.hold(0)
        })?;
        meter.finish_stage();
        meter.check_batch().map(|()| Located { windings, report: QueryReport::default() })
    }
}
