//! The least split of a large node: bins bound the cost, sweeps decide.
//!
//! A reference that starts in a bin before k starts before every plane in bin k, and one that ends in a
//! bin behind k ends behind them. So the counts of bins bound the numbers of references on either side of
//! any plane in a bin, and the bin's borders bound the areas.

use splitplane_core::backend::BuildError;
use splitplane_core::layout::Reference;

use super::cost::{Best, Cell, Costs, Split};
use super::ledger::Ledger;
use super::sweep::{Event, Face, event, sweep};
use crate::query::InstructionSet;

/// Most bins of an axis; a power of two.
const MOST: usize = 256;
/// References for each bin, roughly.
const PER_BIN: usize = 4;
/// Fewest bins of an axis.
const LEAST: usize = 16;
/// 2^23: a float from 0 on below it, added to this, has its nearest integer in the low bits.
const ROUND: f32 = 8_388_608.0;
/// Least half extent that is cut into bins; thinner cells have one.
const LEAST_EXTENT: f32 = 7.888_609e-31; // 2^-100
/// What the borders of a bin are widened by, of the cell's extent. A position in bins collects two
/// roundings of 2^-24 of its distance from the lower side.
const SLACK: f64 = 1.0 / 1_048_576.0; // 2^-20
/// A lower bound is lowered by this much of itself: the blocks that may lie on either side are given to
/// the cheaper one, which is least in real numbers only.
const LOWER: f64 = 1.0 - 1.0 / 1_099_511_627_776.0; // 2^-40

/// Scratch of one thread.
#[derive(Debug)]
pub(super) struct Bins {
    /// Faces by word of a reference and bin: lower faces, a word unused, upper faces, a word unused.
    faces: [[u32; MOST]; 8],
    /// Lower bounds of the costs in a bin; infinite where there is no face.
    least: [[f64; MOST]; 3],
    /// References that start in bins before this one.
    started: [[u32; MOST]; 3],
    /// References that do not end in bins before this one.
    unfinished: [[u32; MOST]; 3],
    /// Where the events of a bin end so far; `CLOSED` for bins that cannot hold the least split.
    ends: [[u32; MOST]; 3],
    /// The bins that can hold it.
    open: Vec<Open>,
    /// Their events.
    events: Vec<Event>,
}

/// A bin that can hold the least split.
#[derive(Clone, Copy, Debug)]
struct Open {
    least: f64,
    axis: u32,
    bin: u32,
    first: u32,
}

const CLOSED: u32 = u32::MAX;

impl Default for Bins {
    fn default() -> Bins {
        Bins {
            faces: [[0; MOST]; 8],
            least: [[f64::INFINITY; MOST]; 3],
            started: [[0; MOST]; 3],
            unfinished: [[0; MOST]; 3],
            ends: [[CLOSED; MOST]; 3],
            open: Vec::new(),
            events: Vec::new(),
        }
    }
}

/// The split of least (cost, axis, position) that costs less than `limit`.
///
/// # Errors
/// More memory than the limit allows.
pub(super) fn best_split(
    set: InstructionSet,
    costs: &Costs,
    cell: &Cell,
    references: &[Reference],
    limit: f64,
    bins: &mut Bins,
    ledger: &Ledger,
) -> Result<Option<Split>, BuildError> {
    match set {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: only sets that the processor has come here.
        InstructionSet::Avx512 => unsafe { best_16(costs, cell, references, limit, bins, ledger) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        InstructionSet::Avx2 => unsafe { best_8(costs, cell, references, limit, bins, ledger) },
        _ => best(costs, cell, references, limit, bins, ledger),
    }
}

/// [`best`], compiled for AVX-512.
///
/// # Safety
/// The processor must have it.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,bmi1,bmi2,popcnt")]
unsafe fn best_16(
    costs: &Costs,
    cell: &Cell,
    references: &[Reference],
    limit: f64,
    bins: &mut Bins,
    ledger: &Ledger,
) -> Result<Option<Split>, BuildError> {
    best(costs, cell, references, limit, bins, ledger)
}

/// [`best`], compiled for AVX2.
///
/// # Safety
/// The processor must have it.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
unsafe fn best_8(
    costs: &Costs,
    cell: &Cell,
    references: &[Reference],
    limit: f64,
    bins: &mut Bins,
    ledger: &Ledger,
) -> Result<Option<Split>, BuildError> {
    best(costs, cell, references, limit, bins, ledger)
}

#[inline(always)]
fn best(
    costs: &Costs,
    cell: &Cell,
    references: &[Reference],
    limit: f64,
    bins: &mut Bins,
    ledger: &Ledger,
) -> Result<Option<Split>, BuildError> {
    let count = (references.len() / PER_BIN).next_power_of_two().clamp(LEAST, MOST);
    let grid = Grid::new(cell, count);
    bins.count(&grid, references);
    let events = bins.bound(costs, cell, &grid, references.len() as u32, limit);
    if bins.open.is_empty() {
        return Ok(None);
    }
    if bins.events.len() < events {
        let more = events - bins.events.len();
        ledger.reserve(&mut bins.events, more)?;
        bins.events.resize(events, 0);
    }
    bins.gather(&grid, references);
    Ok(bins.search(costs, cell, limit))
}

/// Bins of a cell. Words are those of a [`Reference`]: three lower faces, the triangle, three upper
/// faces, padding; the two that are no faces land somewhere, unused.
struct Grid {
    bins: usize,
    half_lo: [f32; 8],
    scale: [f32; 8],
}

impl Grid {
    fn new(cell: &Cell, bins: usize) -> Grid {
        let (mut half_lo, mut scale) = ([0.0; 8], [0.0; 8]);
        for axis in 0..3 {
            let half = cell.bounds.half_extent(axis);
            let scale_here = if half < LEAST_EXTENT { 0.0 } else { (bins - 1) as f32 / half };
            for word in [axis, axis + 4] {
                half_lo[word] = 0.5 * cell.bounds.lo[axis];
                scale[word] = scale_here;
            }
        }
        Grid { bins, half_lo, scale }
    }

    /// The bins of a reference's faces, by word: never falling with the position.
    #[inline(always)]
    fn bins_of(&self, reference: &Reference) -> [usize; 8] {
        let words: &[f32; 8] = bytemuck::cast_ref(reference);
        let mut bins = [0; 8];
        for word in 0..8 {
            // Halved, so that nothing overflows. A bin holds what rounds to its number.
            let place = (0.5 * words[word] - self.half_lo[word]) * self.scale[word];
            bins[word] = ((place + ROUND).to_bits() & (MOST as u32 - 1)) as usize;
        }
        bins
    }

    /// Positions between which all those of a bin lie.
    #[inline(always)]
    fn borders(&self, cell: &Cell, axis: usize, bin: usize) -> [f64; 2] {
        let (lo, hi) = (cell.axes[axis].lo, cell.axes[axis].hi);
        if self.scale[axis] == 0.0 {
            return [lo, hi];
        }
        let width = 2.0 / f64::from(self.scale[axis]);
        let slack = SLACK * (hi - lo);
        let (below, above) = (bin as f64 - 0.5, bin as f64 + 0.5);
        let (low, high) = (lo + below * width - slack, lo + above * width + slack);
        [if low > lo { low } else { lo }, if high < hi { high } else { hi }]
    }
}

impl Bins {
    /// Bytes of its lists.
    pub fn bytes(&self) -> u64 {
        let open = self.open.capacity() * size_of::<Open>();
        (open + self.events.capacity() * size_of::<Event>()) as u64
    }

    /// Counts the faces in every bin.
    #[inline(always)]
    fn count(&mut self, grid: &Grid, references: &[Reference]) {
        for faces in &mut self.faces {
            faces[..grid.bins].fill(0);
        }
        let [x, y, z, _, far_x, far_y, far_z, _] = &mut self.faces;
        for reference in references {
            let bins = grid.bins_of(reference);
            x[bins[0]] += 1;
            y[bins[1]] += 1;
            z[bins[2]] += 1;
            far_x[bins[4]] += 1;
            far_y[bins[5]] += 1;
            far_z[bins[6]] += 1;
        }
    }

    /// Bounds the costs in every bin, and opens those that may hold the least split. Returns how many
    /// events they may have.
    #[inline(always)]
    fn bound(&mut self, costs: &Costs, cell: &Cell, grid: &Grid, count: u32, limit: f64) -> usize {
        let mut most = limit;
        let all = f64::from(costs.blocks(count));
        for axis in 0..3 {
            let (mut started, mut unfinished) = (0, count);
            for bin in 0..grid.bins {
                let (starts, ends) = (self.faces[axis][bin], self.faces[axis + 4][bin]);
                self.started[axis][bin] = started;
                self.unfinished[axis][bin] = unfinished;
                self.least[axis][bin] = f64::INFINITY;
                if starts + ends > 0 {
                    let [low, high] = grid.borders(cell, axis, bin);
                    let areas = &cell.axes[axis];
                    // At least these are left and right of any plane in the bin, and all are somewhere.
                    let (left, right) = (started, unfinished - ends);
                    let blocks = [left, right].map(|n| f64::from(costs.blocks(n)));
                    let free = all - blocks[0] - blocks[1];
                    let free = if free > 0.0 { free } else { 0.0 };
                    let small = [areas.below(low), areas.above(high)];
                    let blocks = if small[0] < small[1] {
                        [blocks[0] + free, blocks[1]]
                    } else {
                        [blocks[0], blocks[1] + free]
                    };
                    let cost = costs.blocks_cost(cell.step, small, blocks) * LOWER;
                    let empty = left == 0 || right == 0;
                    self.least[axis][bin] = if empty { cost * costs.empty } else { cost };
                    // The outermost bins may hold nothing but the sides of the cell.
                    if bin > 0 && bin + 1 < grid.bins {
                        let large = [areas.below(high), areas.above(low)];
                        let counts = [started + starts, unfinished].map(|n| costs.blocks(n));
                        let cost = costs.blocks_cost(cell.step, large, counts.map(f64::from));
                        most = if cost < most { cost } else { most };
                    }
                }
                started += starts;
                unfinished -= ends;
            }
        }
        self.open.clear();
        let mut events = 0;
        for axis in 0..3 {
            for bin in 0..grid.bins {
                let least = self.least[axis][bin];
                if least <= most && least < f64::INFINITY {
                    let first = events;
                    self.ends[axis][bin] = first;
                    self.open.push(Open { least, axis: axis as u32, bin: bin as u32, first });
                    events += self.faces[axis][bin] + self.faces[axis + 4][bin];
                } else {
                    self.ends[axis][bin] = CLOSED;
                }
            }
        }
        events as usize
    }

    /// Collects the events in open bins, bin by bin.
    #[inline(always)]
    fn gather(&mut self, grid: &Grid, references: &[Reference]) {
        for reference in references {
            let bins = grid.bins_of(reference);
            for axis in 0..3 {
                let (lo, hi) = (reference.lo[axis], reference.hi[axis]);
                let start = &mut self.ends[axis][bins[axis]];
                if *start != CLOSED {
                    let face = if lo == hi { Face::Planar } else { Face::Start };
                    self.events[*start as usize] = event(lo, face);
                    *start += 1;
                }
                let end = &mut self.ends[axis][bins[axis + 4]];
                if *end != CLOSED && lo != hi {
                    self.events[*end as usize] = event(hi, Face::End);
                    *end += 1;
                }
            }
        }
    }

    /// Sweeps the open bins, the most promising one first, as long as they may hold something better.
    #[inline(always)]
    fn search(&mut self, costs: &Costs, cell: &Cell, limit: f64) -> Option<Split> {
        let mut best = Best::below(limit);
        let mut first = 0;
        for (i, open) in self.open.iter().enumerate() {
            if open.least < self.open[first].least {
                first = i;
            }
        }
        self.open.swap(0, first);
        for open in &self.open {
            if open.least > best.cost {
                continue;
            }
            let (axis, bin) = (open.axis as usize, open.bin as usize);
            let events = &mut self.events[open.first as usize..self.ends[axis][bin] as usize];
            let counts = [self.started[axis][bin], self.unfinished[axis][bin]];
            sweep(costs, cell, axis, events, counts, &mut best);
        }
        best.split
    }
}
