//! Overlaps: the device lists the triangles that a volume may meet, and says of which it is certain; the host decides the others exactly.

use std::ops::Range;

use rayon::prelude::*;
use splitplane_core::error::{QueryError, check_bytes, refused};
use splitplane_core::kernel::NearKernel;
use splitplane_core::layout::NearBatch;
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::query::overlap::{OverlapOptions, Overlaps, Region, Volume, add, overlapping};
use splitplane_core::report::QueryReport;
use splitplane_float_state::Standard;

use super::super::accelerator::WgpuAccelerator;
use super::super::settle::Asking;
use super::batch::{Asked, Rows};
use super::volume::{not_asked, nothing, to_send};
use crate::device::host;
use crate::error::GpuError;

/// Volumes of one task of the host.
const FEW: usize = 64;
/// Volumes whose lists are held together.
const MANY: usize = 1 << 15;
/// Words of a volume's first answer: a number, and triangles.
const ROOM: u32 = 16;
/// Most words of a run of longer answers, and of one of them.
const MOST_WORDS: usize = 1 << 20;

/// What the device has said of a volume.
#[derive(Clone, Debug, PartialEq)]
enum Said {
    /// All that it meets, in ascending order; any one of them where one is enough.
    Triangles(Vec<u32>),
    /// This many words would take all that it may meet.
    Longer(usize),
    /// The host has to look.
    Open,
    /// The driver did not let it finish.
    Unfinished,
}

impl WgpuAccelerator {
    /// The triangles that each volume meets: the core's answers.
    pub(in super::super) fn find_overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &OverlapOptions<'_>,
    ) -> Result<Overlaps, QueryError> {
        let asking = &Asking::new(options.watch, volumes.len());
        asking.check()?;
        let mut all = Overlaps::default();
        for volumes in volumes.chunks(many(options)) {
            let left = options.max_memory.map(|most| most.saturating_sub(all.bytes()));
            let within_left = OverlapOptions { max_memory: left, ..*options };
            let (mut lists, unfinished) = self.lists_of(volumes, &within_left, asking)?;
            all.report.unfinished += unfinished;
            // The host answers the rest, a few at a time.
            for (volumes, lists) in volumes.chunks(FEW).zip(lists.chunks_mut(FEW)) {
                asking.check()?;
                let found: Vec<Result<Option<Vec<u32>>, QueryError>> = volumes
                    .par_iter()
                    .zip(&*lists)
                    .map(|(volume, list)| match list {
                        Some(_) => Ok(None),
                        None => self.on_host(volume, false, options, asking).map(Some),
                    })
                    .collect();
                for (found, list) in found.into_iter().zip(lists) {
                    let found = found?;
                    all.report.answered_by_cpu += u64::from(found.is_some());
                    let own = found.or_else(|| list.take()).unwrap_or_default();
                    all.push(own, options.max_memory)?;
                }
                asking.advance(volumes.len());
            }
        }
        asking.check()?;
        Ok(all)
    }

    /// Whether each volume meets any triangle.
    pub(in super::super) fn find_any_overlaps(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &OverlapOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        check_lengths(volumes.len(), found.len())?;
        let asking = &Asking::new(options.watch, volumes.len());
        asking.check()?;
        let mut report = QueryReport::default();
        let many = many(options);
        for (volumes, found) in volumes.chunks(many).zip(found.chunks_mut(many)) {
            let mut said = open(volumes.len())?;
            if self.may_ask() {
                let asked = asked(ROOM, true, options);
                let said = (&mut said[..], &mut 0);
                self.ask_volumes(volumes, &asked, None, options, asking, said)?;
            }
            let counts: Result<Vec<[u64; 2]>, QueryError> = volumes
                .par_chunks(FEW)
                .zip(found.par_chunks_mut(FEW))
                .zip(said.par_chunks(FEW))
                .map(|((volumes, found), said)| {
                    let _state = Standard::set();
                    let mut counts = [0; 2];
                    asking.check()?;
                    for ((volume, found), said) in volumes.iter().zip(found).zip(said) {
                        *found = match said {
                            Said::Triangles(triangles) => !triangles.is_empty(),
                            _ => {
                                counts[0] += 1;
                                counts[1] += u64::from(*said == Said::Unfinished);
                                !self.on_host(volume, true, options, asking)?.is_empty()
                            }
                        };
                    }
                    asking.advance(volumes.len());
                    Ok(counts)
                })
                .collect();
            for [host, unfinished] in counts? {
                report.answered_by_cpu += host;
                report.unfinished += unfinished;
            }
        }
        asking.check()?;
        Ok(report)
    }

    /// Whether the device's bounds hold, and there is anything to be met.
    fn may_ask(&self) -> bool {
        self.queries.is_certain() && !self.tree.bounds.is_empty()
    }

    /// The core's search through the host copy.
    fn on_host(
        &self,
        volume: &Volume<'_>,
        any: bool,
        options: &OverlapOptions<'_>,
        asking: &Asking<'_>,
    ) -> Result<Vec<u32>, QueryError> {
        let _state = Standard::set();
        let options = &OverlapOptions { watch: asking.watch(), ..*options };
        let found = overlapping(&self.tree.view(), &self.triangles[..], volume, any, options);
        found.map_err(|error| asking.of_whole(error))
    }

    /// What each volume meets, by the device's lists; `None` for those that are left to the host. Besides, how many the driver did not let finish.
    #[expect(clippy::type_complexity, reason = "lists, and a number")]
    fn lists_of(
        &self,
        volumes: &[Volume<'_>],
        options: &OverlapOptions<'_>,
        asking: &Asking<'_>,
    ) -> Result<(Vec<Option<Vec<u32>>>, u64), QueryError> {
        let mut said = open(volumes.len())?;
        if self.may_ask() {
            // Bytes of all lists.
            let mut held = 0;
            let first = asked(ROOM, false, options);
            let all = (&mut said[..], &mut held);
            self.ask_volumes(volumes, &first, None, options, asking, all)?;
            // Then those with longer lists, in runs of lists that are about as long.
            let most = self.most_words(options);
            let mut longer: Vec<(usize, usize)> = Vec::new();
            longer.try_reserve_exact(said.len()).map_err(|_| refused(16 * said.len() as u64))?;
            longer.extend(said.iter().enumerate().filter_map(|(place, said)| match *said {
                Said::Longer(words) if words <= most => Some((words, place)),
                _ => None,
            }));
            longer.sort_unstable();
            let mut next = 0;
            while next < longer.len() {
                let mut end = next + 1;
                while end < longer.len() && (end + 1 - next) * longer[end].0 <= most {
                    end += 1;
                }
                let run = &longer[next..end];
                let places: Vec<usize> = run.iter().map(|&(_, place)| place).collect();
                let again = asked(run[run.len() - 1].0 as u32, false, options);
                let all = (&mut said[..], &mut held);
                self.ask_volumes(volumes, &again, Some(&places), options, asking, all)?;
                next = end;
            }
        }
        let unfinished = said.iter().filter(|said| **said == Said::Unfinished).count() as u64;
        let lists = said.into_iter().map(|said| match said {
            Said::Triangles(list) => Some(list),
            _ => None,
        });
        Ok((lists.collect(), unfinished))
    }

    /// Most words of a run of lists.
    fn most_words(&self, options: &OverlapOptions<'_>) -> usize {
        let by_caller = options.max_memory.map_or(u64::MAX, |most| most / 16);
        let by_device = self.queries.buffer_limit() / 4;
        (MOST_WORDS as u64).min(by_caller).min(by_device) as usize
    }

    /// Asks the device about volumes, all of them or those at some places, and decides what it leaves open of their triangles. `held` counts the bytes of
    /// lists.
    fn ask_volumes(
        &self,
        volumes: &[Volume<'_>],
        asked: &Asked,
        places: Option<&[usize]>,
        options: &OverlapOptions<'_>,
        asking: &Asking<'_>,
        (said, held): (&mut [Said], &mut u64),
    ) -> Result<(), QueryError> {
        let place = |number: usize| places.map_or(number, |places| places[number]);
        let rows = |range: Range<usize>| self.rows_of(range.map(|number| &volumes[place(number)]));
        let count = places.map_or(volumes.len(), <[usize]>::len);
        self.ask_near(count, asked, asking, rows, |range, bytes| {
            let answers: Vec<Result<Said, QueryError>> = range
                .clone()
                .into_par_iter()
                .zip(bytes.par_chunks(4 * asked.room as usize))
                .map(|(number, bytes)| self.read(&volumes[place(number)], asked, bytes, options))
                .collect();
            for (number, answer) in range.zip(answers) {
                let answer = answer?;
                if let Said::Triangles(list) = &answer {
                    // The answers to all volumes have no fewer.
                    *held += size_of_val(&list[..]) as u64;
                    check_bytes(*held, options.max_memory)?;
                }
                said[place(number)] = answer;
            }
            Ok(())
        })
    }

    /// What is sent of volumes.
    fn rows_of<'v>(
        &self,
        volumes: impl ExactSizeIterator<Item = &'v Volume<'v>>,
    ) -> Result<Rows, GpuError> {
        let mut rows =
            Rows { queries: host::room(4 * volumes.len(), "volumes")?, more: Vec::new() };
        for volume in volumes {
            let sent = match Region::new(volume) {
                Ok(None) => nothing(),
                Ok(Some(region)) => {
                    to_send(volume, &region, &self.tree.bounds).unwrap_or_else(not_asked)
                }
                Err(_) => not_asked(),
            };
            rows.queries.extend(sent.rows(rows.more.len()));
            rows.more.extend(sent.planes());
        }
        Ok(rows)
    }

    /// What an answer of the device says of a volume.
    fn read(
        &self,
        volume: &Volume<'_>,
        asked: &Asked,
        bytes: &[u8],
        options: &OverlapOptions<'_>,
    ) -> Result<Said, QueryError> {
        let _state = Standard::set();
        let word = |at: usize| bytemuck::pod_read_unaligned::<u32>(&bytes[4 * at..4 * at + 4]);
        let count = word(0);
        match count {
            NearBatch::ENDED_EARLY => return Ok(Said::Unfinished),
            NearBatch::OVERFULL => return Ok(Said::Open),
            // Any one will do.
            NearBatch::MET if asked.any => return Ok(Said::Triangles(vec![0])),
            _ => {}
        }
        let (room, count) = (asked.room as usize - 1, count as usize);
        let is_longer = count > room;
        if is_longer && !asked.any {
            // What no device should say: each reference is listed once at most.
            let most = self.tree.references.len();
            return Ok(if count <= most { Said::Longer(count + 1) } else { Said::Open });
        }
        let (mut found, mut region) = (Vec::new(), None);
        for at in 1..=count.min(room) {
            let (listed, is_certain) =
                (word(at) & !NearBatch::CERTAIN, word(at) & NearBatch::CERTAIN);
            let Some(corners) = self.triangles.get(listed as usize) else { return Ok(Said::Open) };
            let meets = is_certain != 0 || {
                if region.is_none() {
                    region = Region::new(volume)?;
                }
                region.as_ref().is_some_and(|region| region.meets(corners))
            };
            if meets {
                add(&mut found, listed, options.max_memory)?;
                if asked.any {
                    return Ok(Said::Triangles(found));
                }
            }
        }
        found.sort_unstable();
        found.dedup();
        found.shrink_to_fit();
        Ok(if is_longer { Said::Open } else { Said::Triangles(found) })
    }
}

/// How many volumes are asked about together: what is sent and read back of each is 256 bytes, twice.
fn many(options: &OverlapOptions<'_>) -> usize {
    options.max_memory.map_or(MANY, |most| (most / 512).clamp(1, MANY as u64) as usize)
}

fn asked(room: u32, any: bool, options: &OverlapOptions<'_>) -> Asked {
    let kernel = NearKernel::OverlappedTriangles;
    let rows = NearBatch::VOLUME_ROWS as usize;
    Asked { kernel, room, rows, ignore: options.ignore, any }
}

/// Nothing is known of so many volumes.
fn open(volumes: usize) -> Result<Vec<Said>, QueryError> {
    let mut said = Vec::new();
    let bytes = (volumes * size_of::<Said>()) as u64;
    said.try_reserve_exact(volumes).map_err(|_| refused(bytes))?;
    said.resize(volumes, Said::Open);
    Ok(said)
}
