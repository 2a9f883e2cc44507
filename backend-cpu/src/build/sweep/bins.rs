//! The least split of a large node: bins bound the cost, sweeps decide.
//!
//! A reference that starts in a bin before k starts before every plane in bin k, and one that ends
//! in a bin after k ends behind them. So the counts of bins bound the numbers of references on
//! either side of any plane in a bin, and the bin's borders bound the areas.

mod bound;
mod open_events;

use core::sync::atomic::AtomicU64;
use core::sync::atomic::Ordering::Relaxed;

use splitplane_core::error::BuildError;
use splitplane_core::layout::Reference;

use self::bound::bound;
use self::open_events::{count_events, gather, place_events};
use super::atomic_memory::AtomicMemory;
use super::cost::{BestSplit, Cell, Split, SplitCosts};
use super::events::{Event, sweep};
use super::grid::{FaceBins, FaceCounts, Grid, MOST, count_faces};
use super::matches::Ranges;
use super::small::Small;
use crate::cancel::ProgressMeter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::simd::InstructionSet;
use crate::span;

/// References for each bin, roughly.
const PER_BIN: usize = 4;
/// Fewest bins of an axis.
const LEAST: usize = 16;
/// References that one task processes; nodes of more than four times as many have several tasks.
pub(super) const CHUNK: usize = 2048;

/// Scratch of one thread.
#[derive(Debug)]
pub(super) struct Bins {
    faces: FaceCounts,
    /// Lower bounds of the costs in a bin, in units of the cell's half area; infinite where there is no
    /// face.
    least: [[f32; MOST]; 3],
    /// References that start in bins before this one.
    started: [[u32; MOST + 1]; 3],
    /// References that do not end in bins before this one.
    unfinished: [[u32; MOST + 1]; 3],
    /// Where each bin is among the open ones; [`CLOSED`] for bins that cannot hold the least split.
    numbers: OpenNumbers,
    /// The bins that can hold it.
    open: Vec<Open>,
    /// Their events.
    events: Vec<Event>,
    /// The bins of each reference's faces.
    places: Vec<FaceBins>,
    /// The results of tasks on parts of many references.
    parts: Vec<BinPart>,
    /// Scratch for nodes that are too small for bins.
    pub small: Small,
}

/// By axis and bin.
type OpenNumbers = [[u32; MOST]; 3];

/// A bin that can hold the least split.
#[derive(Clone, Copy, Debug)]
struct Open {
    least: f64,
    axis: u32,
    bin: u32,
    /// Where its events begin, and where those end that are there so far.
    first: u32,
    end: u32,
}

const CLOSED: u32 = u32::MAX;

/// The result of one task.
#[derive(Debug)]
struct BinPart {
    faces: FaceCounts,
    /// Events in open bins, bin by bin.
    events: Vec<Event>,
    /// Where those of each open bin end.
    ends: Vec<u32>,
}

impl Default for Bins {
    fn default() -> Bins {
        Bins {
            faces: [[0; MOST]; 8],
            least: [[f32::INFINITY; MOST]; 3],
            started: [[0; MOST + 1]; 3],
            unfinished: [[0; MOST + 1]; 3],
            numbers: [[CLOSED; MOST]; 3],
            open: Vec::new(),
            events: Vec::new(),
            places: Vec::new(),
            parts: Vec::new(),
            small: Small::default(),
        }
    }
}

/// The input of a search.
struct BinSearch<'a> {
    set: InstructionSet,
    costs: &'a SplitCosts,
    cell: &'a Cell,
    references: &'a [Reference],
    grid: Grid,
    limit: f64,
    memory: &'a AtomicMemory,
    meter: &'a ProgressMeter<'a>,
}

/// The split of least (cost, axis, position) that costs less than `limit`.
///
/// # Errors
/// More memory than the limit allows.
#[allow(clippy::too_many_arguments, reason = "a bundle of them would be made for each node")]
pub(super) fn best_split(
    set: InstructionSet,
    costs: &SplitCosts,
    cell: &Cell,
    references: &[Reference],
    limit: f64,
    bins: &mut Bins,
    memory: &AtomicMemory,
    meter: &ProgressMeter<'_>,
) -> Result<Option<Split>, BuildError> {
    let count = (references.len() / PER_BIN).next_power_of_two().clamp(LEAST, MOST);
    let grid = Grid::new(cell, count);
    let search = BinSearch { set, costs, cell, references, grid, limit, memory, meter };
    let parallel = references.len() > 4 * CHUNK;
    lengthen(memory, &mut bins.places, references.len(), [0; 8])?;
    if parallel {
        search.count_parts(bins)?;
    } else {
        for faces in &mut bins.faces {
            faces[..count].fill(0);
        }
        count_faces(set, &search.grid, references, &mut bins.faces, &mut bins.places);
    }
    meter.check()?;
    // Any bin may turn out to be open.
    bins.open.clear();
    memory.reserve(&mut bins.open, 3 * count)?;
    let events = bound(set, bins, costs, cell, &search.grid, references.len() as u32, limit);
    if bins.open.is_empty() {
        return Ok(None);
    }
    lengthen(memory, &mut bins.events, events, 0)?;
    let split = if parallel { search.sweep_parts(bins, events)? } else { search.sweep(bins) };
    meter.check()?;
    Ok(split)
}

/// Makes a list at least `length` long.
fn lengthen<T: Copy>(
    memory: &AtomicMemory,
    list: &mut Vec<T>,
    length: usize,
    filler: T,
) -> Result<(), BuildError> {
    if list.len() < length {
        memory.reserve_exactly(list, length - list.len())?;
        list.resize(list.capacity(), filler);
    }
    Ok(())
}

impl BinSearch<'_> {
    /// Counts faces, part by part.
    fn count_parts(&self, bins: &mut Bins) -> Result<(), BuildError> {
        let parts = self.references.len().div_ceil(CHUNK);
        if bins.parts.len() < parts {
            let more = parts - bins.parts.len();
            self.memory.reserve(&mut bins.parts, more)?;
            let part = || BinPart { faces: [[0; MOST]; 8], events: Vec::new(), ends: Vec::new() };
            bins.parts.resize_with(parts, part);
        }
        let parts = &mut bins.parts[..parts];
        let chunks = self.references.par_chunks(CHUNK).zip(bins.places.par_chunks_mut(CHUNK));
        let counting = span::pieces_of(1);
        parts.par_iter_mut().zip(chunks).for_each(|(part, (references, places))| {
            let _piece = span::piece();
            for faces in &mut part.faces {
                faces[..self.grid.bins].fill(0);
            }
            if !self.meter.record_work(references.len() as u64) {
                count_faces(self.set, &self.grid, references, &mut part.faces, places);
            }
        });
        drop(counting);
        let _loop = span::pieces_of(1);
        bins.faces.par_iter_mut().enumerate().for_each(|(word, faces)| {
            let _piece = span::piece();
            faces.fill(0);
            for part in &*parts {
                for bin in 0..self.grid.bins {
                    faces[bin] += part.faces[word][bin];
                }
            }
        });
        Ok(())
    }

    /// Collects the events in open bins and sweeps these, the most promising one first, as long as they
    /// may hold something better.
    fn sweep(&self, bins: &mut Bins) -> Option<Split> {
        let Bins { numbers, open, events, places, .. } = bins;
        let places = &places[..self.references.len()];
        let ranges = ranges(open);
        gather(self.set, &ranges, self.references, places, numbers, open, events);
        let mut first = 0;
        for (i, open) in bins.open.iter().enumerate() {
            if open.least < bins.open[first].least {
                first = i;
            }
        }
        bins.open.swap(0, first);
        let mut best = BestSplit::below(self.limit);
        for open in &bins.open {
            if open.least > best.cost {
                continue;
            }
            if self.meter.is_cancelled() {
                break;
            }
            let events = &mut bins.events[open.first as usize..open.end as usize];
            let counts = counts(&bins.started, &bins.unfinished, open);
            sweep(self.costs, self.cell, open.axis as usize, events, counts, &mut best);
        }
        best.split
    }

    /// The same by many tasks: first one a part of the references, then one an open bin.
    fn sweep_parts(&self, bins: &mut Bins, all: usize) -> Result<Option<Split>, BuildError> {
        let parts = &mut bins.parts[..self.references.len().div_ceil(CHUNK)];
        let (numbers, open) = (&bins.numbers, &bins.open);
        let ranges = ranges(open);
        let chunks = self.references.par_chunks(CHUNK).zip(bins.places.par_chunks(CHUNK));
        let collecting = span::pieces_of(1);
        parts.par_iter_mut().zip(chunks).try_for_each(|(part, (references, places))| {
            let _piece = span::piece();
            if self.meter.record_work(references.len() as u64) {
                return Ok(());
            }
            let places = &places[..references.len()];
            self.collect(part, references, places, numbers, open.len(), &ranges)
        })?;
        self.meter.check()?;
        drop(collecting);
        let mut events = &mut bins.events[..];
        let mut lists = self.memory.temporary(open.len())?;
        for (number, open) in open.iter().enumerate() {
            let end = bins.open.get(number + 1).map_or(all, |next| next.first as usize);
            let (list, rest) = events.split_at_mut(end - open.first as usize);
            lists.push((number, open, list));
            events = rest;
        }
        let parts = &*parts;
        let (started, unfinished) = (&bins.started, &bins.unfinished);
        // The result of another task; a hint that affects only how long the search takes.
        let least = AtomicU64::new(self.limit.to_bits());
        let _loop = span::pieces_of(1);
        let best = lists.par_iter_mut().with_max_len(1).reduce(
            BestSplit::below(self.limit),
            |(number, open, list)| {
                let _piece = span::piece();
                let mut best = BestSplit::below(self.limit);
                if open.least > f64::from_bits(least.load(Relaxed)) {
                    return best;
                }
                let mut end = 0;
                for part in parts {
                    let events = part.of(*number);
                    list[end..end + events.len()].copy_from_slice(events);
                    end += events.len();
                }
                if !self.meter.record_work(4 * end as u64) {
                    let counts = counts(started, unfinished, open);
                    let axis = open.axis as usize;
                    sweep(self.costs, self.cell, axis, &mut list[..end], counts, &mut best);
                    // Costs are not negative, so their bits compare as they do.
                    least.fetch_min(best.cost.to_bits(), Relaxed);
                }
                best
            },
            |best, other| {
                if let Some(split) = other.split {
                    best.offer(split);
                }
            },
        );
        Ok(best.split)
    }

    /// The events of a part in open bins, bin by bin.
    fn collect(
        &self,
        part: &mut BinPart,
        references: &[Reference],
        places: &[FaceBins],
        numbers: &OpenNumbers,
        open: usize,
        ranges: &Ranges,
    ) -> Result<(), BuildError> {
        lengthen(self.memory, &mut part.ends, open, 0)?;
        part.ends[..open].fill(0);
        let all = count_events(self.set, ranges, places, numbers, &mut part.ends[..open]);
        lengthen(self.memory, &mut part.events, all as usize, 0)?;
        let mut first = 0;
        for end in &mut part.ends[..open] {
            first += core::mem::replace(end, first);
        }
        let BinPart { events, ends, .. } = part;
        place_events(self.set, ranges, references, places, numbers, ends, events);
        Ok(())
    }
}

impl BinPart {
    /// The events of an open bin.
    fn of(&self, number: usize) -> &[Event] {
        let first = number.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.events[first as usize..self.ends[number] as usize]
    }
}

/// The references that start before an open bin, and those that do not end before it.
fn counts(
    started: &[[u32; MOST + 1]; 3],
    unfinished: &[[u32; MOST + 1]; 3],
    open: &Open,
) -> [u32; 2] {
    let (axis, bin) = (open.axis as usize, open.bin as usize);
    [started[axis][bin], unfinished[axis][bin]]
}

/// The range of open bins on each axis.
fn ranges(open: &[Open]) -> Ranges {
    let mut axes = [None; 3];
    for open in open {
        let bin = open.bin as u8;
        let [first, last] = axes[open.axis as usize].get_or_insert([bin; 2]);
        (*first, *last) = ((*first).min(bin), (*last).max(bin));
    }
    Ranges::new(axes)
}

impl Bins {
    /// Frees its lists.
    pub(super) fn give_back(&mut self) {
        let Bins { open, events, places, parts, .. } = self;
        (*open, *events, *places, *parts) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    }

    /// Bytes of its lists.
    pub(super) fn bytes(&self) -> u64 {
        let open = self.open.capacity() * size_of::<Open>();
        let events = self.events.capacity() * size_of::<Event>();
        let places = self.places.capacity() * size_of::<FaceBins>();
        let part = |part: &BinPart| {
            (part.events.capacity() * size_of::<Event>() + part.ends.capacity() * 4) as u64
        };
        let parts = (self.parts.capacity() * size_of::<BinPart>()) as u64;
        (open + events + places) as u64 + parts + self.parts.iter().map(part).sum::<u64>()
    }
}

#[cfg(test)]
mod tests;
