//! Batches: what is asked for in parts, and what answers are counted.

use library::{QueryReport, Ray, Rays, Watch};

use crate::buffer::{Given, Wanted, filled};
use crate::progress::{Caller, watch};
use crate::ray::{CHUNK, View};
use crate::status::Failure;

/// How a batch was answered. All 0 for the CPU backend.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Rays or points of which a device left something undecided; the CPU decided it.
    pub undecided: u64,
    /// Rays that a device's driver did not follow to their end; the CPU answered them.
    pub unfinished: u64,
    /// Rays or points that the CPU answered alone for a device.
    pub answered_by_cpu: u64,
    /// Rays through scenes that the CPU took from instance to instance, for a device that does not hold the scene: it answers in each.
    pub placed_by_cpu: u64,
}

impl Report {
    pub(crate) fn add(&mut self, report: &QueryReport) {
        self.undecided += report.undecided;
        self.unfinished += report.unfinished;
        self.answered_by_cpu += report.answered_by_cpu;
    }
}

/// Answers rays with one record each.
pub(crate) fn rays<T: Copy + Send>(
    rays: &View<'_>,
    wanted: &mut Wanted<'_, T>,
    blank: T,
    caller: Option<Caller>,
    ask: impl Fn(&[Ray], &mut [T], Option<&dyn Watch>) -> Result<QueryReport, Failure> + Sync,
) -> Result<Report, Failure> {
    let (total, mut sum) = (rays.len(), Report::default());
    rays.in_parts(|rays, first| {
        let part = caller.map(|caller| caller.part(first, total));
        sum.add(&into(wanted, first, rays.len(), blank, |answers| {
            ask(rays, answers, watch(&part))
        })?);
        Ok(())
    })?;
    Ok(sum)
}

/// The same, by what also reads rows as they lie.
pub(crate) fn rays_of<T: Copy + Send>(
    rays: &View<'_>,
    wanted: &mut Wanted<'_, T>,
    blank: T,
    caller: Option<Caller>,
    ask: impl Fn(Rays<'_>, &mut [T], Option<&dyn Watch>) -> Result<QueryReport, Failure> + Sync,
) -> Result<Report, Failure> {
    let Some(rows) = rays.rows() else {
        return self::rays(rays, wanted, blank, caller, |rays, answers, watch| {
            ask(Rays::Records(rays), answers, watch)
        });
    };
    let (total, mut sum) = (rows.len(), Report::default());
    let part = caller.map(|caller| caller.part(0, total));
    sum.add(&into(wanted, 0, total, blank, |answers| ask(rows, answers, watch(&part)))?);
    Ok(sum)
}

/// Answers points with one record each.
pub(crate) fn points<T: Copy + Send>(
    points: &Given<'_, [f32; 3]>,
    wanted: &mut Wanted<'_, T>,
    blank: T,
    caller: Option<Caller>,
    ask: impl Fn(&[[f32; 3]], &mut [T], Option<&dyn Watch>) -> Result<QueryReport, Failure> + Sync,
) -> Result<Report, Failure> {
    let (total, mut sum) = (points.len(), Report::default());
    in_parts(points, |points, first| {
        let part = caller.map(|caller| caller.part(first, total));
        let ask = |answers: &mut [T]| ask(points, answers, watch(&part));
        sum.add(&into(wanted, first, points.len(), blank, ask)?);
        Ok(())
    })?;
    Ok(sum)
}

/// Shows points, some at a time, each part with the place of its first.
pub(crate) fn in_parts(
    points: &Given<'_, [f32; 3]>,
    mut show: impl FnMut(&[[f32; 3]], usize) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let total = points.len();
    if total == 0 {
        return show(&[], 0);
    }
    let mut copy = Vec::new();
    for first in (0..total).step_by(CHUNK) {
        let here = first..total.min(first + CHUNK);
        match points.packed() {
            Some(packed) => show(&packed[here], first)?,
            None => {
                copy.clear();
                crate::buffer::reserve(&mut copy, here.len())?;
                copy.extend(here.map(|place| points.at(place)));
                show(&copy, first)?;
            }
        }
    }
    Ok(())
}

/// Has answers written to their places: there, where nothing lies between them, else by way of records of ours.
fn into<T: Copy, R>(
    wanted: &mut Wanted<'_, T>,
    first: usize,
    count: usize,
    blank: T,
    ask: impl FnOnce(&mut [T]) -> Result<R, Failure>,
) -> Result<R, Failure> {
    if let Some(packed) = wanted.packed() {
        return ask(&mut packed[first..first + count]);
    }
    let mut records = filled(count, blank)?;
    let done = ask(&mut records)?;
    for (place, record) in records.into_iter().enumerate() {
        wanted.set(first + place, record);
    }
    Ok(done)
}
