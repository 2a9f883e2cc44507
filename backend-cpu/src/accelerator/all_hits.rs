//! All hits of rays.

use core::sync::atomic::AtomicU64;
use core::sync::atomic::Ordering::Relaxed;

use rayon::prelude::*;
use splitplane_core::error::{QueryError, check_bytes, refused};
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions, Collector, Crossing};
use splitplane_core::ray::Ray;
use splitplane_core::watch::Stage;
use splitplane_float_state::Standard;

use super::CpuAccelerator;
use super::task_bytes::{FEW, TaskBytes};
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::trace::exact;

impl CpuAccelerator {
    /// All hits of a batch.
    pub(super) fn find_all_hits(
        &self,
        rays: &[Ray],
        options: &AllHitsOptions<'_>,
    ) -> Result<AllHits, QueryError> {
        let meter = &ProgressMeter::of(options.watch);
        let query = &options.query();
        meter.begin_stage(Stage::Rays, rays.len() as u64);
        // The starts of all, and the report on each part.
        let tasks = rays.len().div_ceil(FEW);
        let lists = (rays.len() * size_of::<usize>() + tasks * size_of::<Option<AllHits>>()) as u64;
        let held = AtomicU64::new(lists);
        let lacking = || refused(held.load(Relaxed));
        check_bytes(lists, options.max_memory)?;
        let mut parts: Vec<Option<AllHits>> = Vec::new();
        parts.try_reserve_exact(tasks).map_err(|_| lacking())?;
        parts.resize(tasks, None);
        rays.par_chunks(FEW).zip(&mut parts).try_for_each(|(rays, out)| {
            let _state = Standard::set();
            let mut share = TaskBytes { held: &held, own: 0, max_memory: options.max_memory };
            let mut part = AllHits::with_room(rays.len()).map_err(|_| lacking())?;
            let mut collector = Collector::default();
            let (layout, bounds) = (&self.layout, &self.layout.tree.bounds);
            for ray in rays {
                // The threads' results are copied together at the end, so they count twice.
                let copy = |crossings: usize| (crossings * size_of::<Crossing>()) as u64;
                let beside = part.bytes() + copy(part.crossings.len());
                let mut ended = share.hold(beside + collector.bytes());
                ended.clone()?;
                let go_on = |bytes| {
                    meter.record_work(WORK_BETWEEN_CHECKS / 8);
                    ended = meter.check_batch().and_then(|()| share.hold(beside + bytes));
                    ended.is_ok()
                };
                exact::all_hits(layout, bounds, ray, query, &mut collector, go_on);
                ended?;
                let grown = collector.growth(&part.crossings);
                share.hold(beside + collector.bytes() + grown)?;
                collector.finish(&mut part.crossings).map_err(|_| lacking())?;
                part.starts.push(part.crossings.len());
            }
            drop(collector);
            trim(&mut part.crossings);
            share.hold(part.bytes() + size_of_val(&part.crossings[..]) as u64)?;
            meter.advance(rays.len() as u64);
            meter.record_work(WORK_BETWEEN_CHECKS);
            *out = Some(part);
            meter.check_batch()
        })?;
        let mut all = AllHits::with_room(rays.len()).map_err(|_| lacking())?;
        let crossings = parts.iter().flatten().map(|part| part.crossings.len()).sum();
        all.crossings.try_reserve_exact(crossings).map_err(|_| lacking())?;
        parts.into_iter().flatten().try_for_each(|part| all.append(part))?;
        meter.finish_stage();
        meter.check_batch().map(|()| all)
    }
}

/// Gives back what a list has to spare, as long as there is memory for a shorter one: shrinking it where it is
/// could end the process.
fn trim(crossings: &mut Vec<Crossing>) {
    let mut shorter = Vec::new();
    if crossings.len() < crossings.capacity() && shorter.try_reserve_exact(crossings.len()).is_ok()
    {
        shorter.extend_from_slice(crossings);
        *crossings = shorter;
    }
}
