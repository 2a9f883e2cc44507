//! Batches of points that are answered along a curve: neighbours one after the other find nodes in cache, and begin with a guess from the
//! one before. It changes no answer, and answers come in the caller's order.

use rayon::prelude::*;
use splitplane_core::error::{QueryError, refused};
use splitplane_float_state::Standard;

use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::points::order::along_curve;

/// Fewer points are answered as they come.
const AT_LEAST: usize = 1 << 10;
/// Most points that are put in order at a time: some milliseconds.
const CHUNK: usize = 1 << 16;

/// How a batch is divided.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Parts {
    /// Points of one task, at least.
    pub(crate) task: usize,
    /// Points that `answer` gets at a time, between two checks of the watch.
    pub(crate) few: usize,
}

/// Answers a batch, on all threads of the pool: `answer` gets a few points at a time, and room for their answers,
/// which are `none` so far.
pub(crate) fn answer_in_order<T: Copy + Send + Sync>(
    points: &[[f32; 3]],
    (answers, none): (&mut [T], T),
    Parts { task, few }: Parts,
    meter: &ProgressMeter<'_>,
    answer: impl Fn(&[[f32; 3]], &mut [T]) -> Result<(), QueryError> + Sync,
) -> Result<(), QueryError> {
    let done = |count: usize| {
        meter.advance(count as u64);
        meter.record_work(WORK_BETWEEN_CHECKS);
    };
    if points.len() < AT_LEAST {
        let tasks = points.par_chunks(task).zip(answers.par_chunks_mut(task));
        return tasks.try_for_each(|(points, answers)| {
            let _state = Standard::set();
            for (points, answers) in points.chunks(few).zip(answers.chunks_mut(few)) {
                if meter.is_cancelled() {
                    break;
                }
                answers.fill(none);
                answer(points, answers)?;
                done(points.len());
            }
            Ok(())
        });
    }
    let threads = rayon::current_num_threads();
    let parts = if threads == 1 { 1 } else { 4 * threads };
    let chunk = points.len().div_ceil(parts).clamp(task, CHUNK);
    points.par_chunks(chunk).zip(answers.par_chunks_mut(chunk)).try_for_each(|(points, answers)| {
        let _state = Standard::set();
        if meter.is_cancelled() {
            return Ok(());
        }
        let bytes = points.len() * 16 + few * (size_of::<T>() + size_of::<[f32; 3]>());
        let refused = |_| refused(bytes as u64);
        let (mut keys, mut spare) = (Vec::new(), Vec::new());
        let (mut near, mut found) = (Vec::new(), Vec::new());
        keys.try_reserve_exact(points.len()).map_err(refused)?;
        spare.try_reserve_exact(points.len()).map_err(refused)?;
        near.try_reserve_exact(few).map_err(refused)?;
        found.try_reserve_exact(few).map_err(refused)?;
        let (lower, upper) = bounds(points);
        along_curve(points, lower, upper, &mut keys, &mut spare);
        for some in keys.chunks(few) {
            if meter.is_cancelled() {
                break;
            }
            let places = || some.iter().map(|&key| key as u32 as usize);
            near.clear();
            near.extend(places().map(|place| points[place]));
            found.clear();
            found.resize(some.len(), none);
            answer(&near, &mut found)?;
            for (place, &own) in places().zip(&found) {
                answers[place] = own;
            }
            done(some.len());
        }
        Ok(())
    })
}

/// The box of the points that are finite.
fn bounds(points: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let (mut lower, mut upper) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for point in points.iter().filter(|point| point.iter().all(|x| x.is_finite())) {
        for axis in 0..3 {
            lower[axis] = lower[axis].min(point[axis]);
            upper[axis] = upper[axis].max(point[axis]);
        }
    }
    (lower, upper)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::UNWATCHED;

    #[test]
    fn each_point_has_its_own_answer_and_neighbours_come_together() {
        let mut points: Vec<[f32; 3]> = (0..5000u32)
            .map(|i| [i.wrapping_mul(2_654_435_761) >> 8, i * 37 % 1000, i].map(|x| x as f32))
            .collect();
        points[7] = [f32::NAN, 0.0, f32::INFINITY];
        for count in [0, 5, AT_LEAST - 1, AT_LEAST, 5000] {
            for few in [1, 32, 1024] {
                let points = &points[..count];
                let mut answers = vec![[0u32; 3]; count];
                let parts = Parts { task: 1024, few };
                answer_in_order(
                    points,
                    (&mut answers, [1; 3]),
                    parts,
                    &UNWATCHED,
                    |near, found| {
                        assert!(near.len() <= few && near.len() == found.len());
                        for (point, found) in near.iter().zip(found) {
                            assert_eq!(*found, [1; 3]);
                            *found = point.map(f32::to_bits);
                        }
                        Ok(())
                    },
                )
                .unwrap();
                let expected: Vec<[u32; 3]> =
                    points.iter().map(|point| point.map(f32::to_bits)).collect();
                assert_eq!(answers, expected);
            }
        }
        let error = Err(QueryError::Unsupported { query: "nothing" });
        let mut answers = vec![0u8; 5000];
        let parts = Parts { task: 64, few: 8 };
        let ended =
            answer_in_order(&points, (&mut answers, 0), parts, &UNWATCHED, |_, _| error.clone());
        assert_eq!(ended, error);
    }
}
