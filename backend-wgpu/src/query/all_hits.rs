//! All hits of a batch: the device lists triangles, and the host decides which of them are crossed.

use std::borrow::Cow;

use rayon::prelude::*;
use splitplane_core::error::QueryError;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions, Collector, Crossing};
use splitplane_core::ray::Ray;
use splitplane_float_state::Standard;

use super::accelerator::WgpuAccelerator;
use super::held::{Held, Share};
use super::lists::{FEW, Lists};
use super::settle::{Asking, list};
use crate::device::wait::Wait;

/// What the tasks of a batch have in common.
#[derive(Clone, Copy)]
pub(super) struct Batch<'a> {
    pub(super) accelerator: &'a WgpuAccelerator,
    pub(super) options: &'a AllHitsOptions<'a>,
    pub(super) asking: &'a Asking<'a>,
    pub(super) held: &'a Held,
}

impl WgpuAccelerator {
    /// All hits of a batch.
    pub(super) async fn find_all_hits(
        &self,
        wait: Wait,
        rays: &[Ray],
        options: &AllHitsOptions<'_>,
    ) -> Result<AllHits, QueryError> {
        let asking = &Asking::new(options.watch, rays.len());
        let held = &Held::new((rays.len() * size_of::<usize>()) as u64, options.max_memory)?;
        let batch = Batch { accelerator: self, options, asking, held };
        let mut all = AllHits::with_room(rays.len())?;
        let mut answer = held.share();
        let part = |range| Ok(Cow::Borrowed(&rays[range]));
        let query = &options.query();
        let settle = |_, rays: &[Ray], lists: &Lists<'_>| {
            let mut parts: Vec<Option<(AllHits, Share<'_>)>> = list(rays.len().div_ceil(FEW))?;
            parts.resize_with(rays.len().div_ceil(FEW), || None);
            let tasks = rays.par_chunks(FEW).zip(&mut parts).enumerate();
            tasks.try_for_each(|(task, (rays, out))| {
                let _state = Standard::set();
                *out = Some(batch.cross(rays, task * FEW, lists)?);
                asking.advance(rays.len());
                asking.check()
            })?;
            let crossings = parts.iter().flatten().map(|(part, _)| part.crossings.len()).sum();
            make_room(&mut all.crossings, crossings, &mut answer)?;
            parts.into_iter().flatten().try_for_each(|(part, _)| all.append(part))
        };
        let report =
            self.list_in_runs(wait, (rays.len(), part), query, asking, held, settle).await?;
        asking.check()?;
        all.report = report;
        Ok(all)
    }
}

impl<'a> Batch<'a> {
    /// The crossings of a few rays, which begin at `first` of a run.
    pub(super) fn cross(
        &self,
        rays: &[Ray],
        first: usize,
        lists: &Lists<'_>,
    ) -> Result<(AllHits, Share<'a>), QueryError> {
        let Batch { accelerator, options, asking, held } = *self;
        let (scene, query) = (accelerator.host_scene(), &options.query());
        let mut share = held.share();
        let mut part = AllHits::with_room(rays.len())?;
        let mut collector = Collector::default();
        for (place, ray) in rays.iter().enumerate() {
            let beside = part.bytes();
            let mut ended = share.hold(beside + collector.bytes());
            ended.clone()?;
            let mut go_on = |bytes| {
                ended = share.hold(beside + bytes).and_then(|()| asking.check());
                ended.is_ok()
            };
            scene.visit(lists.of(first + place), ray, query, |ray, corners, triangle| {
                collector.test_while(ray, corners, triangle, options.culling, &mut go_on)
            });
            ended?;
            share.hold(beside + collector.bytes() + collector.growth(&part.crossings))?;
            collector.finish(&mut part.crossings)?;
            part.starts.push(part.crossings.len());
        }
        share.hold(part.bytes())?;
        Ok((part, share))
    }
}

/// Makes room for more crossings: for twice as many as there are, or where that is more than allowed, for as many as are
/// needed.
fn make_room(
    crossings: &mut Vec<Crossing>,
    more: usize,
    share: &mut Share<'_>,
) -> Result<(), QueryError> {
    let (room, needed) = (crossings.capacity(), crossings.len() + more);
    if needed <= room {
        return Ok(());
    }
    // Until the old memory is freed both are held.
    let bytes = |new: usize| ((room + new) * size_of::<Crossing>()) as u64;
    let mut new = needed.max(2 * room);
    if share.hold(bytes(new)).is_err() {
        new = needed;
        share.hold(bytes(new))?;
    }
    let refused = |_| splitplane_core::error::refused(bytes(new));
    crossings.try_reserve_exact(new - crossings.len()).map_err(refused)?;
    share.hold((crossings.capacity() * size_of::<Crossing>()) as u64)
}
