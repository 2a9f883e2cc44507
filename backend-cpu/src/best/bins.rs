//! The least split of a large node: bins bound the cost, sweeps decide.
//!
//! A reference that starts in a bin before k starts before every plane in bin k, and one that ends in a
//! bin behind k ends behind them. So the counts of bins bound the numbers of references on either side of
//! any plane in a bin, and the bin's borders bound the areas.

use rayon::prelude::*;
use splitplane_core::backend::BuildError;
use splitplane_core::layout::Reference;

use super::cost::{Best, Cell, Costs, LOWER, Split};
use super::ledger::Ledger;
use super::small::Small;
use super::sweep::{Event, Face, event, sweep};
use super::wide::for_every_set;
use crate::lookout::Lookout;
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

/// References that one task counts or looks through.
const CHUNK: usize = 16_384;

/// Faces by word of a reference and bin: three words of lower faces, one that is none, three of upper
/// faces, one that is none.
type Faces = [[u32; MOST]; 8];

/// Scratch of one thread.
#[derive(Debug)]
pub(super) struct Bins {
    faces: Faces,
    /// Lower bounds of the costs in a bin; infinite where there is no face.
    least: [[f64; MOST]; 3],
    /// References that start in bins before this one.
    started: [[u32; MOST]; 3],
    /// References that do not end in bins before this one.
    unfinished: [[u32; MOST]; 3],
    /// Where the events of a bin end so far; [`CLOSED`] for bins that cannot hold the least split.
    ends: Ends,
    /// The bins that can hold it.
    open: Vec<Open>,
    /// Their events.
    events: Vec<Event>,
    /// For nodes that are too small for bins.
    pub small: Small,
}

type Ends = [[u32; MOST]; 3];

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
            small: Small::default(),
        }
    }
}

/// The split of least (cost, axis, position) that costs less than `limit`.
///
/// # Errors
/// More memory than the limit allows.
#[allow(clippy::too_many_arguments, reason = "a bundle of them would be made for each node")]
pub(super) fn best_split(
    set: InstructionSet,
    costs: &Costs,
    cell: &Cell,
    references: &[Reference],
    limit: f64,
    bins: &mut Bins,
    ledger: &Ledger,
    look: &Lookout<'_>,
) -> Result<Option<Split>, BuildError> {
    let count = (references.len() / PER_BIN).next_power_of_two().clamp(LEAST, MOST);
    let grid = Grid::new(cell, count);
    let parallel = references.len() > 2 * CHUNK;
    for faces in &mut bins.faces {
        faces[..count].fill(0);
    }
    if parallel {
        bins.faces = references
            .par_chunks(CHUNK)
            .map(|chunk| {
                let mut faces = [[0; MOST]; 8];
                if !look.worked(chunk.len() as u64) {
                    count_faces(set, &grid, chunk, &mut faces);
                }
                faces
            })
            .reduce(|| [[0; MOST]; 8], sum);
    } else {
        count_faces(set, &grid, references, &mut bins.faces);
    }
    look.check()?;
    let events = bound(set, bins, costs, cell, &grid, references.len() as u32, limit);
    if bins.open.is_empty() {
        return Ok(None);
    }
    if bins.events.len() < events {
        let more = events - bins.events.len();
        ledger.reserve(&mut bins.events, more)?;
        bins.events.resize(events, 0);
    }
    if parallel {
        let ends = &bins.ends;
        let found: Vec<Vec<Reference>> = references
            .par_chunks(CHUNK)
            .map(|chunk| {
                let mut found = Vec::new();
                ledger.reserve(&mut found, chunk.len())?;
                if !look.worked(chunk.len() as u64) {
                    in_open_bins(set, &grid, chunk, ends, &mut found);
                }
                Ok(found)
            })
            .collect::<Result<_, BuildError>>()?;
        for list in found {
            if !look.worked(list.len() as u64) {
                gather(set, &grid, &list, &mut bins.ends, &mut bins.events);
            }
            ledger.give((list.capacity() * size_of::<Reference>()) as u64);
        }
    } else {
        gather(set, &grid, references, &mut bins.ends, &mut bins.events);
    }
    look.check()?;
    Ok(bins.search(costs, cell, limit, look))
}

fn sum(mut one: Faces, other: Faces) -> Faces {
    for (one, other) in one.as_flattened_mut().iter_mut().zip(other.as_flattened()) {
        *one += other;
    }
    one
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

    /// The borders of an axis's bins.
    #[inline(always)]
    fn borders(&self, cell: &Cell, axis: usize) -> Borders {
        let (lo, hi) = (cell.axes[axis].lo, cell.axes[axis].hi);
        // Without a scale all is in the first bin.
        let scale = self.scale[axis];
        let width = if scale == 0.0 { hi - lo } else { 2.0 / f64::from(scale) };
        let slack = if scale == 0.0 { hi - lo } else { SLACK * (hi - lo) };
        Borders { lo, hi, width, slack }
    }
}

/// Between which positions all those of a bin lie.
struct Borders {
    lo: f64,
    hi: f64,
    width: f64,
    slack: f64,
}

impl Borders {
    #[inline(always)]
    fn of(&self, bin: usize) -> [f64; 2] {
        let bin = f64::from(bin as i32);
        let low = self.lo + (bin - 0.5) * self.width - self.slack;
        let high = self.lo + (bin + 0.5) * self.width + self.slack;
        [if low > self.lo { low } else { self.lo }, if high < self.hi { high } else { self.hi }]
    }
}

impl Bins {
    /// Bytes of its lists.
    pub fn bytes(&self) -> u64 {
        let open = self.open.capacity() * size_of::<Open>();
        (open + self.events.capacity() * size_of::<Event>()) as u64
    }

    /// Sweeps the open bins, the most promising one first, as long as they may hold something better.
    #[inline(always)]
    fn search(
        &mut self,
        costs: &Costs,
        cell: &Cell,
        limit: f64,
        look: &Lookout<'_>,
    ) -> Option<Split> {
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
            if look.is_over() {
                break;
            }
            let (axis, bin) = (open.axis as usize, open.bin as usize);
            let events = &mut self.events[open.first as usize..self.ends[axis][bin] as usize];
            let counts = [self.started[axis][bin], self.unfinished[axis][bin]];
            sweep(costs, cell, axis, events, counts, &mut best);
        }
        best.split
    }
}

for_every_set! {
    /// Counts the faces in every bin.
    fn count_faces(grid: &Grid, references: &[Reference], faces: &mut Faces) -> () {
        let [x, y, z, _, far_x, far_y, far_z, _] = faces;
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
}

for_every_set! {
    /// Bounds the costs in every bin, and opens those that may hold the least split. Returns how many
    /// events they may have.
    fn bound(
        bins: &mut Bins,
        costs: &Costs,
        cell: &Cell,
        grid: &Grid,
        count: u32,
        limit: f64,
    ) -> usize {
        let mut most = limit;
        let all = costs.blocks(count);
        for axis in 0..3 {
            let (started, unfinished) = (&mut bins.started[axis], &mut bins.unfinished[axis]);
            let (starts, ends) = (&bins.faces[axis], &bins.faces[axis + 4]);
            let (mut left, mut right) = (0, count);
            for bin in 0..grid.bins {
                (started[bin], unfinished[bin]) = (left, right);
                left += starts[bin];
                right -= ends[bin];
            }
            let areas = &cell.axes[axis];
            let least = &mut bins.least[axis];
            let borders = grid.borders(cell, axis);
            // Without branches, to be turned into vector instructions.
            for bin in 0..grid.bins {
                let faces = starts[bin] + ends[bin];
                let [low, high] = borders.of(bin);
                // At least these are left and right of any plane in the bin, and all are somewhere.
                let (left, right) = (started[bin], unfinished[bin] - ends[bin]);
                let blocks = [costs.blocks(left), costs.blocks(right)];
                let rest = [all - blocks[1], all - blocks[0]];
                let most_blocks = [
                    if rest[0] > blocks[0] { rest[0] } else { blocks[0] },
                    if rest[1] > blocks[1] { rest[1] } else { blocks[1] },
                ];
                let small = [areas.below(low), areas.above(high)];
                // What is expected is concave: least where all that may be on either side is on one.
                let fewest = blocks.map(|n| costs.expected(n));
                let most_expected = most_blocks.map(|n| costs.expected(n));
                let all_left = [most_expected[0], fewest[1]];
                let all_right = [fewest[0], most_expected[1]];
                let all_left = costs.blocks_cost(cell.step, small, all_left);
                let all_right = costs.blocks_cost(cell.step, small, all_right);
                let cost = if all_left < all_right { all_left } else { all_right } * LOWER;
                let cost = if left == 0 || right == 0 { cost * costs.empty } else { cost };
                least[bin] = if faces > 0 { cost } else { f64::INFINITY };
                // The outermost bins may hold nothing but the sides of the cell.
                let inner = faces > 0 && bin > 0 && bin + 1 < grid.bins;
                let large = [areas.below(high), areas.above(low)];
                let blocks =
                    [costs.blocks(started[bin] + starts[bin]), costs.blocks(unfinished[bin])];
                let cost = costs.blocks_cost(cell.step, large, blocks.map(|n| costs.expected(n)));
                let cost = if inner { cost } else { f64::INFINITY };
                most = if cost < most { cost } else { most };
            }
        }
        bins.open.clear();
        let mut events = 0;
        for axis in 0..3 {
            for bin in 0..grid.bins {
                let least = bins.least[axis][bin];
                if least <= most && least < f64::INFINITY {
                    let first = events;
                    bins.ends[axis][bin] = first;
                    bins.open.push(Open { least, axis: axis as u32, bin: bin as u32, first });
                    events += bins.faces[axis][bin] + bins.faces[axis + 4][bin];
                } else {
                    bins.ends[axis][bin] = CLOSED;
                }
            }
        }
        events as usize
    }
}

for_every_set! {
    /// Collects the references that have a face in an open bin.
    fn in_open_bins(
        grid: &Grid,
        references: &[Reference],
        ends: &Ends,
        found: &mut Vec<Reference>,
    ) -> () {
        for reference in references {
            let bins = grid.bins_of(reference);
            let open = (0..3).any(|axis| {
                ends[axis][bins[axis]] != CLOSED || ends[axis][bins[axis + 4]] != CLOSED
            });
            if open {
                found.push(*reference);
            }
        }
    }
}

for_every_set! {
    /// Collects the events in open bins, bin by bin.
    fn gather(
        grid: &Grid,
        references: &[Reference],
        ends: &mut Ends,
        events: &mut [Event],
    ) -> () {
        for reference in references {
            let bins = grid.bins_of(reference);
            for axis in 0..3 {
                let (lo, hi) = (reference.lo[axis], reference.hi[axis]);
                let start = &mut ends[axis][bins[axis]];
                if *start != CLOSED {
                    let face = if lo == hi { Face::Planar } else { Face::Start };
                    events[*start as usize] = event(lo, face);
                    *start += 1;
                }
                let end = &mut ends[axis][bins[axis + 4]];
                if *end != CLOSED && lo != hi {
                    events[*end as usize] = event(hi, Face::End);
                    *end += 1;
                }
            }
        }
    }
}
