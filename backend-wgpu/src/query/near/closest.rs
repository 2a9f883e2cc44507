//! Closest points: the device lists the triangles that may have them, the host decides between these as the core does.

use rayon::prelude::*;
use splitplane_core::error::{QueryError, refused};
use splitplane_core::kernel::NearKernel;
use splitplane_core::layout::NearBatch;
use splitplane_core::query::closest_point::{
    ClosestPoint, ClosestPointOptions, Search, check_accuracy, check_lengths, closest_point,
};
use splitplane_core::report::QueryReport;
use splitplane_float_state::Standard;

use super::super::accelerator::WgpuAccelerator;
use super::super::settle::Asking;
use super::batch::{Asked, Rows};
use super::unit::unit_at;
use crate::device::host;

/// Points of a task of the host.
const FEW: usize = 64;
/// Words of a point's answer: a number, a distance, and triangles.
const ROOM: usize = 2 + NearBatch::CLOSEST as usize;
/// No triangle is as far away, in the unit of a point.
const FARTHEST: f32 = 4.0;

/// What is left of a point after the device has answered.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Left {
    /// The device cannot measure there, or has too little room for what may be closest.
    Open,
    /// The driver did not let it finish.
    Unfinished,
}

/// How far away triangles count, in a unit: no less than `limit`.
fn reach_of(limit: f32, unit: f32) -> f32 {
    let exact = f64::from(limit) * f64::from(unit);
    if exact >= f64::from(FARTHEST) { FARTHEST } else { (exact as f32).next_up() }
}

impl WgpuAccelerator {
    /// The closest point of the mesh to each point, as the core's search finds it: least (squared distance, triangle), in its `f64` or exactly. The device's bounds
    /// are of true distances and wider than either.
    ///
    /// The host searches where the device's bounds do not hold (no self-test has found that it rounds as the CPU does), where it cannot measure, and
    /// where more triangles may be closest than it keeps.
    pub(in super::super) fn find_closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [ClosestPoint],
        options: &ClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        check_lengths(points.len(), closest.len())?;
        check_accuracy(options.accuracy)?;
        let asking = &Asking::new(options.watch, points.len());
        asking.check()?;
        let mut report = QueryReport::default();
        if !self.queries.is_certain() || self.tree.bounds.is_empty() {
            self.closest_on_host(points, closest, options, asking)?;
            report.answered_by_cpu = points.len() as u64;
            return Ok(report);
        }
        let left = self.closest_on_device(points, closest, options, asking, &mut report)?;
        report.answered_by_cpu = left.len() as u64;
        // In a list of their own, so that all threads have some of them.
        let refused = |_| refused((left.len() * size_of::<ClosestPoint>()) as u64);
        let (mut own, mut answers) = (Vec::new(), Vec::new());
        own.try_reserve_exact(left.len()).map_err(refused)?;
        answers.try_reserve_exact(left.len()).map_err(refused)?;
        own.extend(left.iter().map(|&place| points[place]));
        answers.resize(left.len(), ClosestPoint::NONE);
        self.closest_on_host(&own, &mut answers, options, asking)?;
        for (&place, answer) in left.iter().zip(answers) {
            closest[place] = answer;
        }
        Ok(report)
    }

    /// The core's search through the host copy.
    fn closest_on_host(
        &self,
        points: &[[f32; 3]],
        closest: &mut [ClosestPoint],
        options: &ClosestPointOptions<'_>,
        asking: &Asking<'_>,
    ) -> Result<(), QueryError> {
        let tree = &self.tree.view();
        points.par_chunks(FEW).zip(closest.par_chunks_mut(FEW)).try_for_each(
            |(points, closest)| {
                let _state = Standard::set();
                asking.check()?;
                for (&point, closest) in points.iter().zip(closest) {
                    *closest = closest_point(tree, &self.triangles[..], point, options)?;
                }
                asking.advance(points.len());
                Ok::<(), QueryError>(())
            },
        )?;
        asking.check()
    }

    /// Returns the places of the points that are left to the host, in ascending order.
    fn closest_on_device(
        &self,
        points: &[[f32; 3]],
        closest: &mut [ClosestPoint],
        options: &ClosestPointOptions<'_>,
        asking: &Asking<'_>,
        report: &mut QueryReport,
    ) -> Result<Vec<usize>, QueryError> {
        let kernel = NearKernel::ClosestTriangles;
        let asked =
            Asked { kernel, room: ROOM as u32, rows: 2, ignore: options.ignore, any: false };
        let row = |point: [f32; 3]| {
            let nothing = [[0.0; 4], [-1.0, 0.0, 0.0, 0.0]];
            let Some(search) = Search::new(point, &self.tree.bounds, options) else {
                return nothing;
            };
            let [x, y, z] = search.point();
            let Some(unit) = unit_at([x, y, z], &self.tree.bounds, 0.0) else { return nothing };
            [[x, y, z, unit], [reach_of(options.max_distance, unit), 0.0, 0.0, 0.0]]
        };
        let rows = |range: std::ops::Range<usize>| {
            let mut queries = host::room(2 * range.len(), "points to send")?;
            queries.extend(points[range].iter().flat_map(|&point| row(point)));
            Ok(Rows { queries, more: Vec::new() })
        };
        let mut left = Vec::new();
        self.ask_near(points.len(), &asked, asking, rows, |range, bytes| {
            let own = &mut closest[range.clone()];
            let open: Vec<(usize, Left)> = own
                .par_iter_mut()
                .zip(bytes.par_chunks(4 * ROOM))
                .zip(range.clone())
                .filter_map(|((closest, bytes), place)| {
                    let _state = Standard::set();
                    let decided = self.decide(points[place], bytes, options);
                    match decided {
                        Ok(answer) => {
                            *closest = answer;
                            None
                        }
                        Err(left) => Some((place, left)),
                    }
                })
                .collect();
            left.try_reserve(open.len()).map_err(|_| refused(8 * open.len() as u64))?;
            asking.advance(range.len() - open.len());
            report.unfinished +=
                open.iter().filter(|(_, left)| *left == Left::Unfinished).count() as u64;
            left.extend(open.into_iter().map(|(place, _)| place));
            Ok(())
        })?;
        Ok(left)
    }

    /// The closest point of the triangles that the device has listed, where no other triangle can have it.
    fn decide(
        &self,
        point: [f32; 3],
        bytes: &[u8],
        options: &ClosestPointOptions<'_>,
    ) -> Result<ClosestPoint, Left> {
        let Some(mut search) = Search::new(point, &self.tree.bounds, options) else {
            return Ok(ClosestPoint::NONE);
        };
        let unit = unit_at(search.point(), &self.tree.bounds, 0.0).ok_or(Left::Open)?;
        let words: [u32; ROOM] = bytemuck::pod_read_unaligned(bytes);
        let (count, cut, listed) = (words[0], f32::from_bits(words[1]), &words[2..]);
        if count == NearBatch::ENDED_EARLY {
            return Err(Left::Unfinished);
        }
        let listed = listed.get(..count as usize).ok_or(Left::Open)?;
        for &triangle in listed {
            // What no device should say.
            let corners = self.triangles.get(triangle as usize).ok_or(Left::Open)?;
            search.test(corners, triangle);
        }
        let best = search.best();
        // All others are farther away than this.
        let cut = f64::from(cut);
        let beyond = cut / f64::from(unit);
        let is_certain = match best.is_some() {
            true => search.farthest_squared() <= beyond * beyond * (1.0 - 1e-12),
            false => beyond >= f64::from(options.max_distance) || cut >= f64::from(FARTHEST) / 2.0,
        };
        if is_certain { Ok(best) } else { Err(Left::Open) }
    }
}
