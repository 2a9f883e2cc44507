//! The nearest points, as a device finds them.

use rayon::prelude::*;
use splitplane_core::error::{QueryError, refused};
use splitplane_core::kernel::PointQueryKernel;
use splitplane_core::layout::PointBatch;
use splitplane_core::points::nearest::{NearestOptions, Neighbour, first_stop, nearest};
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::report::QueryReport;
use splitplane_float_state::{Standard, standard};

use super::super::settle::Asking;
use super::batch::Asked;
use super::tree::WgpuPointTree;

/// Most points that a device keeps for a query; the host answers where more are asked for.
pub(super) const MOST_NEAREST: usize = 1024;
/// Most points of a query whose keys are put in order in less room.
const FEW_NEAREST: usize = 16;
/// Queries of a task of the host.
const FEW: usize = 16;

impl<const N: usize> WgpuPointTree<N> {
    /// The k nearest points of each query, as [`CpuPointTree`](https://docs.rs/splitplane-cpu) gives them: k records each, least (distance,
    /// index) first; [`Neighbour::NONE`] where there is no further one. After an error `found` holds the answers to some of the
    /// queries, and nothing says which.
    ///
    /// The host answers queries farther than 2^62 units of the tree, more than 1024 points, and a filter that is to be asked for few
    /// queries: a device gets the filter's answers for all points.
    ///
    /// # Errors
    /// `found` not of k times as many records as there are queries, more memory than allowed or than the system has, a watch that
    /// cancels the batch, or a device that fails.
    pub fn nearest(
        &self,
        queries: &[[f32; N]],
        found: &mut [Neighbour],
        options: &NearestOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let _state = Standard::set();
        let k = options.k;
        check_lengths(queries.len().saturating_mul(k), found.len())?;
        let asking = &Asking::new(options.watch, queries.len());
        asking.check()?;
        let mut report = QueryReport::default();
        let stop = first_stop(self.tree().unit(), [0.0; N], options.max_distance);
        let room = k.min(self.tree().len());
        if stop == 0 || room == 0 || queries.is_empty() {
            found.fill(Neighbour::NONE);
            asking.advance(queries.len());
            return asking.check().map(|()| report);
        }
        let left = match room <= MOST_NEAREST && self.filter_is_worth_it(queries.len(), options) {
            true => {
                self.nearest_on_device(queries, found, options, (stop, room), asking, &mut report)?
            }
            false => all_places(queries.len())?,
        };
        report.answered_by_cpu = left.len() as u64;
        self.nearest_on_host(queries, found, options, &left, asking)?;
        asking.check()?;
        Ok(report)
    }

    /// Returns the places of the queries that are left to the host.
    fn nearest_on_device(
        &self,
        queries: &[[f32; N]],
        found: &mut [Neighbour],
        options: &NearestOptions<'_>,
        (stop, room): (u64, usize),
        asking: &Asking<'_>,
        report: &mut QueryReport,
    ) -> Result<Vec<usize>, QueryError> {
        let allowed = self.allowed(options)?;
        let asked = Asked {
            kernel: PointQueryKernel::nearest(room),
            room: room as u32,
            reach: (stop >> 32) as u32,
            allowed: allowed.as_ref(),
        };
        let k = options.k;
        let mut left = Vec::new();
        self.ask_slices(queries, &asked, options.max_memory, asking, |range, bytes| {
            let records = &mut found[range.start * k..range.end * k];
            let of_queries = records.par_chunks_mut(k).zip(bytes.par_chunks(8 * room));
            let open: Vec<(usize, bool)> = of_queries
                .zip(range.clone())
                .filter_map(|((records, bytes), place)| {
                    let _state = Standard::set();
                    let own = queries[place];
                    if !own.iter().all(|x| x.is_finite()) {
                        records.fill(Neighbour::NONE);
                        return None;
                    }
                    if self.on_device(own).is_none() {
                        return Some((place, false));
                    }
                    (!self.settle(bytes, records)).then_some((place, true))
                })
                .collect();
            left.try_reserve(open.len()).map_err(|_| refused(8 * open.len() as u64))?;
            asking.advance(range.len() - open.len());
            report.unfinished += open.iter().filter(|(_, unfinished)| *unfinished).count() as u64;
            left.extend(open.into_iter().map(|(place, _)| place));
            Ok(())
        })?;
        Ok(left)
    }

    /// Puts the keys of a query in order. False where the device did not finish it, or says what no device should.
    fn settle(&self, bytes: &[u8], records: &mut [Neighbour]) -> bool {
        // Clearing room for the most would take longer than most queries do.
        match bytes.len() / 8 {
            0..=FEW_NEAREST => self.settle_in(&mut [0; FEW_NEAREST], bytes, records),
            _ => self.settle_in(&mut [0; MOST_NEAREST], bytes, records),
        }
    }

    fn settle_in(&self, keys: &mut [u64], bytes: &[u8], records: &mut [Neighbour]) -> bool {
        let mut count = 0;
        let given = self.tree().report().points;
        for pair in bytes.chunks_exact(8) {
            let [squared, index] = words_of(pair);
            if squared == PointBatch::ENDED_EARLY {
                return false;
            }
            if index == u32::MAX {
                continue;
            }
            if index >= given {
                return false;
            }
            keys[count] = u64::from(squared) << 32 | u64::from(index);
            count += 1;
        }
        let keys = &mut keys[..count];
        keys.sort_unstable();
        for (record, &key) in records.iter_mut().zip(&*keys) {
            *record = Neighbour::of(self.tree().unit(), key);
        }
        records[count..].fill(Neighbour::NONE);
        true
    }

    /// The reference answers the queries at these places.
    fn nearest_on_host(
        &self,
        queries: &[[f32; N]],
        found: &mut [Neighbour],
        options: &NearestOptions<'_>,
        left: &[usize],
        asking: &Asking<'_>,
    ) -> Result<(), QueryError> {
        let k = options.k;
        // By runs, so that all threads have some, and a few at a time are held. These share the limit.
        let run = FEW * rayon::current_num_threads();
        let max_memory = options.max_memory.map(|most| most / run as u64);
        let options = &NearestOptions { watch: None, max_memory, ..*options };
        for some in left.chunks(run) {
            asking.check()?;
            let answers: Vec<Result<Vec<Neighbour>, QueryError>> = some
                .par_iter()
                .map(|&at| standard(|| nearest(self.tree(), queries[at], options)))
                .collect();
            for (&place, answer) in some.iter().zip(answers) {
                let answer = answer?;
                let records = &mut found[place * k..][..k];
                records[..answer.len()].copy_from_slice(&answer);
                records[answer.len()..].fill(Neighbour::NONE);
            }
            asking.advance(some.len());
        }
        Ok(())
    }
}

/// The two words of a key.
pub(super) fn words_of(bytes: &[u8]) -> [u32; 2] {
    bytemuck::pod_read_unaligned(&bytes[..8])
}

/// The places of all queries.
fn all_places(queries: usize) -> Result<Vec<usize>, QueryError> {
    let mut places = Vec::new();
    places.try_reserve_exact(queries).map_err(|_| refused(8 * queries as u64))?;
    places.extend(0..queries);
    Ok(places)
}
