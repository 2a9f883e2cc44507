//! Bins of a cell: where the faces of references lie, roughly.

use splitplane_core::layout::Reference;

use super::cost::Cell;
use crate::simd::every_set::for_every_set;

/// Most bins of an axis; a power of two.
pub(super) const MOST: usize = 256;
/// 2^23: a float from 0 on below it, added to this, has its nearest integer in the low bits.
const ROUND: f32 = 8_388_608.0;
/// Least half extent that is cut into bins; thinner cells have one.
const LEAST_EXTENT: f32 = 7.888_609e-31; // 2^-100
/// How far the borders of a bin are widened, relative to the cell's extent. A position in bins
/// accumulates two roundings of 2^-24 of its distance from the lower side, a border in `f32` three.
const SLACK: f32 = 1.0 / 524_288.0; // 2^-19

/// Faces by word of a reference and bin: three words of lower faces, one that is none, three of upper
/// faces, one that is none.
pub(super) type FaceCounts = [[u32; MOST]; 8];

/// The bins of a reference's faces, by word.
pub(super) type FaceBins = [u8; 8];

/// Bins of a cell. Words are those of a [`Reference`]: three lower faces, the triangle, three upper
/// faces, padding; the two that are no faces get arbitrary bins, unused.
#[derive(Debug)]
pub(super) struct Grid {
    /// Bins of each axis.
    pub bins: usize,
    half_lo: [f32; 8],
    scale: [f32; 8],
}

impl Grid {
    pub(super) fn new(cell: &Cell, bins: usize) -> Grid {
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

    /// The bins of a reference's faces, by word: non-decreasing with the position.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn bins_of(&self, reference: &Reference) -> [u32; 8] {
        let words: &[f32; 8] = bytemuck::cast_ref(reference);
        let mut bins = [0; 8];
        for word in 0..8 {
            // Halved, so that nothing overflows. A bin holds what rounds to its number.
            let place = (0.5 * words[word] - self.half_lo[word]) * self.scale[word];
            bins[word] = (place + ROUND).to_bits() & (MOST as u32 - 1);
        }
        bins
    }

    /// How the borders of an axis's bins are found.
    pub(super) fn borders(&self, axis: usize) -> Borders {
        // Without a scale all is in the first bin.
        if self.scale[axis] == 0.0 {
            return Borders { width: 0.0, slack: 1.0 };
        }
        Borders { width: 1.0 / (self.bins - 1) as f32, slack: SLACK }
    }
}

/// The positions between which all positions of a bin lie, in parts of the cell's extent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Borders {
    width: f32,
    slack: f32,
}

impl Borders {
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn of(&self, bin: usize) -> [f32; 2] {
        let bin = bin as i32 as f32;
        let low = (bin - 0.5) * self.width - self.slack;
        let high = (bin + 0.5) * self.width + self.slack;
        [if low > 0.0 { low } else { 0.0 }, if high < 1.0 { high } else { 1.0 }]
    }
}

for_every_set! {
    /// Counts the faces in every bin, and notes where each reference's are.
    pub(super) fn count_faces<S>(
        grid: &Grid,
        references: &[Reference],
        faces: &mut FaceCounts,
        places: &mut [FaceBins],
    ) -> () {
        let [x, y, z, _, far_x, far_y, far_z, _] = faces;
        for (reference, place) in references.iter().zip(places) {
            let bins = grid.bins_of(reference);
            for word in 0..8 {
                place[word] = bins[word] as u8;
            }
            let bins = bins.map(|bin| bin as usize);
            x[bins[0]] += 1;
            y[bins[1]] += 1;
            z[bins[2]] += 1;
            far_x[bins[4]] += 1;
            far_y[bins[5]] += 1;
            far_z[bins[6]] += 1;
        }
    }
}
