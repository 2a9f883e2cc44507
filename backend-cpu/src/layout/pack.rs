//! Packing: the triangles of leaves put together to blocks ([`super::packed_block`]).
//!
//! Which corners are the same is found by a small table of where a corner with the same hash was seen
//! last. A corner whose place in the table another one has taken is stored twice: that is rare, costs three
//! words, and needs neither chains nor branches that no predictor gets right. What a corner is compared with
//! is read from the list of all corners, never from what was just decided: so the processor can compare many at a time.

use core::hint::select_unpredictable;

use splitplane_core::aabb::{Aabb, max, min};
use splitplane_core::triangle::Triangle;

use super::packed_block::{LANES_TO_WRITE_OUT, PackedBlock, WRITES_OUT};
use crate::simd::{MOST_LANES, prefetch};

/// Places in the table of corners: many times the corners of a block.
const SLOTS: usize = 1 << SLOT_BITS;
const SLOT_BITS: u32 = 10;
/// Most corners of a block, the same ones counted each time; a power of two, so that a mask keeps an index inside.
const MOST_CORNERS: usize = (3 * MOST_LANES).next_power_of_two();
/// Triangles that are asked for ahead: they are all over the mesh.
const AHEAD: usize = 24;
/// Most words that a block may take.
pub(crate) const MOST_WORDS: usize = {
    let (shared, written) = (
        PackedBlock::words(MOST_LANES, 2 * MOST_LANES),
        PackedBlock::written_words(LANES_TO_WRITE_OUT),
    );
    if shared > written { shared } else { written }
};

/// Packs triangles into blocks of at most `lanes`.
pub(crate) struct Packer<'a> {
    /// Triangles of a block.
    lanes: usize,
    /// Whether blocks say that their triangles are large.
    large: bool,
    /// Whether corners are written out.
    written: bool,
    /// The corners of the mesh's triangles.
    triangles: &'a [Triangle],
    /// By hash: the number of the corner seen last, over all blocks.
    seen: [u64; SLOTS],
    /// The number of the block's first corner.
    start: u64,
    /// The block's corners: x and y, z, and their places.
    xy: [u64; MOST_CORNERS],
    z: [u32; MOST_CORNERS],
    places: [u8; MOST_CORNERS],
    /// The different ones among them.
    different: [u8; MOST_CORNERS],
}

/// What was made of a leaf, or of some of its triangles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PackedSize {
    /// Triangles in the block.
    pub count: usize,
    /// Words of the block, whole units.
    pub words: usize,
    /// Bounds of the triangles.
    pub bounds: Aabb,
}

impl<'a> Packer<'a> {
    /// For vectors of `lanes` lanes.
    /// With corners `written` out or shared, for all blocks of a layout alike ([`super::corners::are_written_out`]).
    pub(crate) fn new(lanes: usize, written: bool, triangles: &'a [Triangle]) -> Packer<'a> {
        Packer {
            lanes,
            large: false,
            written,
            triangles,
            seen: [0; SLOTS],
            start: 0,
            xy: [0; MOST_CORNERS],
            z: [0; MOST_CORNERS],
            places: [0; MOST_CORNERS],
            different: [0; MOST_CORNERS],
        }
    }

    /// The same for large triangles, in blocks that say so.
    pub(crate) fn large(lanes: usize, written: bool, triangles: &'a [Triangle]) -> Packer<'a> {
        Packer { large: true, ..Packer::new(lanes, written, triangles) }
    }

    /// Packs as many as fit of the first `left` of some references, one at least, into a block. The
    /// references after those are packed next; `out` has space for [`MOST_WORDS`].
    #[inline(never)]
    pub(crate) fn block(&mut self, references: &[u32], left: usize, out: &mut [u32]) -> PackedSize {
        // Asked of the constant too, so that a browser's part has no such code.
        if WRITES_OUT && self.written {
            return self.write_out(references, left.min(self.lanes), out);
        }
        let mut count = left.min(self.lanes);
        let different = loop {
            match self.place(references, count, out) {
                Ok(different) => break different,
                Err(fit) => count = fit,
            }
        };
        self.bring_first_corners_forward(count, different, out);
        let before = PackedBlock::before_coordinates(count);
        out[0] = PackedBlock::header(count, different, self.large);
        let words = PackedBlock::words(count, different);
        let (_, coordinates) = out[..words].split_at_mut(before);
        let (x, yz) = coordinates.split_at_mut(different);
        let (y, z) = yz.split_at_mut(different);
        let mut bounds = Aabb::EMPTY;
        for (place, &corner) in self.different[..different].iter().enumerate() {
            let corner = corner as usize % MOST_CORNERS;
            let words = [self.xy[corner] as u32, (self.xy[corner] >> 32) as u32, self.z[corner]];
            (x[place], y[place], z[place]) = (words[0], words[1], words[2]);
            for (axis, word) in words.into_iter().enumerate() {
                bounds.lo[axis] = min(f32::from_bits(word), bounds.lo[axis]);
                bounds.hi[axis] = max(f32::from_bits(word), bounds.hi[axis]);
            }
        }
        z[different..].fill(0);
        PackedSize { count, words, bounds }
    }

    /// Writes a block of `count` triangles with corners written out.
    fn write_out(&self, references: &[u32], count: usize, out: &mut [u32]) -> PackedSize {
        let words = PackedBlock::written_words(count);
        let (before, coordinates) = out[..words].split_at_mut(1 + count);
        before[0] = PackedBlock::written_header(count, self.large);
        before[1..].copy_from_slice(&references[..count]);
        coordinates[9 * count..].fill(0);
        let mut bounds = Aabb::EMPTY;
        for (index, &triangle) in references[..count].iter().enumerate() {
            self.ask_for(references.get(index + AHEAD));
            for (corner, at) in self.triangles[triangle as usize].iter().enumerate() {
                for axis in 0..3 {
                    coordinates[(3 * axis + corner) * count + index] = at[axis].to_bits();
                    bounds.lo[axis] = min(at[axis], bounds.lo[axis]);
                    bounds.hi[axis] = max(at[axis], bounds.hi[axis]);
                }
            }
        }
        PackedSize { count, words, bounds }
    }

    /// Prefetches a triangle that is packed later.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn ask_for(&self, reference: Option<&u32>) {
        if let Some(&next) = reference {
            let corners = self.triangles.as_ptr().wrapping_add(next as usize).cast::<u8>();
            prefetch(corners);
            prefetch(corners.wrapping_add(size_of::<Triangle>() - 1));
        }
    }

    /// Writes indices and places of the corners for a block of `count` triangles, and says how many
    /// different corners there are; or how many triangles fit where these have too many.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn place(&mut self, references: &[u32], count: usize, out: &mut [u32]) -> Result<usize, usize> {
        // The table's entries of earlier blocks come after the first corner.
        self.start += MOST_CORNERS as u64;
        let start = self.start;
        let place_words = (3 * count).div_ceil(4);
        let (places, indices) = out[1..].split_at_mut(place_words);
        places[place_words - 1] = 0;
        let places: &mut [u8] = bytemuck::cast_slice_mut(places);
        let (first, places) = places.split_at_mut(count);
        let (second, third) = places.split_at_mut(count);
        let mut different = 0;
        for (index, &triangle) in references[..count].iter().enumerate() {
            // Room for three corners is asked for even where some are known: it makes hardly a block more.
            if different + 3 > 2 * self.lanes {
                return Err(index);
            }
            self.ask_for(references.get(index + AHEAD));
            indices[index] = triangle;
            let corners = &self.triangles[triangle as usize];
            for (k, row) in [&mut *first, &mut *second, &mut *third].into_iter().enumerate() {
                let [x, y, z] = corners[k].map(f32::to_bits);
                let xy = u64::from(x) | u64::from(y) << 32;
                let corner = (3 * index + k) % MOST_CORNERS;
                (self.xy[corner], self.z[corner]) = (xy, z);
                let slot = slot(xy, z);
                let like = (self.seen[slot].max(start) - start) as usize % MOST_CORNERS;
                self.seen[slot] = start + corner as u64;
                let known = (like != corner) & (self.xy[like] == xy) & (self.z[like] == z);
                let place = select_unpredictable(known, self.places[like], different as u8);
                self.places[corner] = place;
                self.different[different % MOST_CORNERS] = corner as u8;
                different += usize::from(!known);
                row[index] = place;
            }
        }
        Ok(different)
    }

    /// Gives the triangles' first corners places below the number of lanes, in exchange with corners that are nobody's first.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn bring_first_corners_forward(&mut self, count: usize, different: usize, out: &mut [u32]) {
        if different <= self.lanes {
            return;
        }
        let places: &mut [u8] = bytemuck::cast_slice_mut(&mut out[1..]);
        let firsts = places[..count].iter().fold(0u64, |all, &place| all | 1 << (place % 64));
        let below = (1 << self.lanes) - 1;
        let (mut beyond, mut free) = (firsts & !below, below & !firsts);
        if beyond == 0 {
            return;
        }
        let mut to: [u8; MOST_CORNERS] = core::array::from_fn(|place| place as u8);
        while beyond != 0 {
            // There is one free for each: all places below are taken, and no more are firsts' than there are triangles.
            let from = beyond.trailing_zeros() as usize % MOST_CORNERS;
            let other = free.trailing_zeros() as usize % MOST_CORNERS;
            (beyond, free) = (beyond & (beyond - 1), free & free.wrapping_sub(1));
            (to[from], to[other]) = (other as u8, from as u8);
            self.different.swap(from, other);
        }
        for place in &mut places[..3 * count] {
            *place = to[*place as usize % MOST_CORNERS];
        }
    }
}

/// A place in the table for a corner.
#[cfg_attr(not(unoptimised), inline(always))]
fn slot(xy: u64, z: u32) -> usize {
    let mixed = (xy ^ u64::from(z).rotate_left(20)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed >> (64 - SLOT_BITS)) as usize
}

#[cfg(test)]
mod tests {
    use splitplane_test_support::random::Random;

    use super::*;
    use crate::layout::packed_block::UNIT_WORDS;

    /// Triangles whose corners are among this many points: all coordinates are from a few, so that
    /// points often differ in only one.
    fn mesh(count: usize, points: usize, random: &mut Random) -> Vec<Triangle> {
        let coordinates = [0.0, 1.0, -1.0, 0.5, 1e-30, 3e30];
        let mut coordinate = || random.pick(&coordinates);
        let points: Vec<_> = (0..points).map(|_| [(); 3].map(|()| coordinate())).collect();
        (0..count).map(|_| [(); 3].map(|()| random.pick(&points))).collect()
    }

    fn different(triangles: &[Triangle]) -> usize {
        let mut corners: Vec<_> =
            triangles.as_flattened().iter().map(|p| p.map(f32::to_bits)).collect();
        corners.sort_unstable();
        corners.dedup();
        corners.len()
    }

    #[test]
    fn blocks_hold_the_triangles_they_were_given() {
        let mut random = Random::new(1);
        let (mut stored, mut needed, mut cut) = (0, 0, 0);
        for round in 0..3_000 {
            let lanes = [8, MOST_LANES][round % 2];
            let points = [2, 9, 40, 200][round / 2 % 4];
            let triangles = mesh(60, points, &mut random);
            let mut packer = Packer::new(lanes, false, &triangles);
            let references: Vec<u32> = (0..50).map(|_| random.below(60) as u32).collect();
            let mut left = 1 + random.below(references.len());
            let mut from = 0;
            while left > 0 {
                let mut words = vec![u32::MAX; MOST_WORDS];
                let packed = packer.block(&references[from..], left, &mut words);
                let record = PackedBlock::at(&words, 0);
                let expected: Vec<Triangle> = references[from..][..packed.count]
                    .iter()
                    .map(|&triangle| triangles[triangle as usize])
                    .collect();
                assert!(0 < packed.count && packed.count <= left.min(lanes));
                assert_eq!(record.count(), packed.count);
                for (index, corners) in expected.iter().enumerate() {
                    assert_eq!(record.triangle(index), references[from + index]);
                    assert_eq!(record.corners(index), *corners);
                }
                assert_eq!(record.units() as usize * UNIT_WORDS, packed.words);
                assert!(words[packed.words..].iter().all(|&word| word == u32::MAX));
                assert_eq!(packed.bounds, Aabb::of_points(expected.as_flattened()));
                assert_eq!(packed.bounds, record.bounds());
                assert!(record.corner_count() <= 2 * lanes);
                for index in 0..record.count() {
                    // SAFETY: a triangle of the block.
                    let [first, ..] = unsafe { record.places_of(index) };
                    assert!(first < lanes, "{first}");
                }
                // It ends early only where one more triangle might have too many corners.
                if packed.count < left.min(lanes) {
                    assert!(record.corner_count() + 3 > 2 * lanes);
                    cut += 1;
                }
                stored += record.corner_count();
                needed += different(&expected);
                from += packed.count;
                left -= packed.count;
            }
        }
        // Some corners are stored twice, but few.
        assert!(stored >= needed && stored * 100 <= needed * 102, "{stored} for {needed}");
        assert!(cut > 100, "{cut}");
    }

    /// Rows are read as vectors, so what a row holds where is looked at word by word, beside what the readers of one triangle say.
    #[test]
    fn blocks_of_written_corners_hold_nine_rows_of_all_their_triangles() {
        let mut random = Random::new(2);
        let mut coordinate = || random.between(-1.0, 1.0) as f32;
        let triangles: Vec<Triangle> =
            (0..300).map(|_| [(); 3].map(|()| [(); 3].map(|()| coordinate()))).collect();
        let references: Vec<u32> = (0..300).map(|_| random.below(300) as u32).collect();
        let lanes = LANES_TO_WRITE_OUT;
        for large in [false, true] {
            let mut packer = Packer { large, ..Packer::new(lanes, true, &triangles) };
            for left in 1..=2 * lanes {
                let from = random.below(250);
                let mut words = vec![u32::MAX; MOST_WORDS];
                let packed = packer.block(&references[from..], left, &mut words);
                let count = left.min(lanes);
                let record = PackedBlock::at(&words, 0);
                assert!(record.is_written());
                assert_eq!(
                    [packed.count, record.count(), record.corner_count()],
                    [count, count, 3 * count]
                );
                assert_eq!(record.is_large(), large);
                assert_eq!(record.units() as usize * UNIT_WORDS, packed.words);
                assert_eq!(packed.words, (1 + 10 * count).next_multiple_of(UNIT_WORDS));
                assert!(words[packed.words..].iter().all(|&word| word == u32::MAX));
                assert!(words[1 + 10 * count..packed.words].iter().all(|&word| word == 0));
                assert_eq!(packed.bounds, record.bounds());
                let own = &references[from..][..count];
                assert_eq!(words[1..=count], *own);
                for (index, &triangle) in own.iter().enumerate() {
                    let expected = triangles[triangle as usize];
                    for (axis, corner) in (0..3).flat_map(|axis| [(axis, 0), (axis, 1), (axis, 2)])
                    {
                        let word = words[1 + count + (3 * axis + corner) * count + index];
                        assert_eq!(word, expected[corner][axis].to_bits());
                    }
                    assert_eq!(
                        (record.triangle(index), record.corners(index)),
                        (triangle, expected)
                    );
                }
            }
        }
    }
}
