//! What the builders do to references, 16 at a time: dividing a node by a plane, and counting the sides of planes.
//!
//! These operations are whole loops, not single vector instructions. AVX-512 compresses by masks, AVX2 permutes by a
//! table, and elsewhere the fastest loops are scalar code that compilers vectorise: no vocabulary of single
//! instructions expresses all three. So [`ReferenceOps`] has the loops as default methods.

use splitplane_core::aabb::{max, min};
use splitplane_core::build::split::{goes_left, goes_right};

use super::WIDTH;
use super::columns::{Columns, ReferenceRow};

/// References divided at a time: their cuts stay in cache.
pub(crate) const TILE: usize = 1024;
/// Space for whole stores after them.
pub(crate) const TILE_ROOM: usize = TILE + WIDTH;

/// Bounds of up to 64 references on one axis.
#[derive(Clone, Debug)]
pub(crate) struct AxisFaces {
    /// Lower faces.
    pub lo: [f32; 64],
    /// Upper faces.
    pub hi: [f32; 64],
}

impl AxisFaces {
    /// All zero.
    pub(crate) const NONE: AxisFaces = AxisFaces { lo: [0.0; 64], hi: [0.0; 64] };
}

/// Places in a tile, and space for a whole store after them.
pub(crate) type TilePlaces = [u32; TILE_ROOM];

/// Candidate planes of a node on one axis: some of its faces, and space for a whole store after
/// them.
pub(crate) type PlaneList = [f32; 2 * 64 + WIDTH];

/// The outermost faces of some references on one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Outermost {
    /// Least lower face.
    pub lowest: f32,
    /// Greatest upper face.
    pub highest: f32,
    /// Least upper face.
    pub first_end: f32,
}

/// What is left on either side of the references of a tile that a plane crosses, in their order.
#[derive(Debug)]
pub(crate) struct CutParts {
    /// Axis of the plane.
    pub axis: usize,
    /// Its position.
    pub plane: f32,
    /// Faces by side of the plane, by other axis (the next one, the one after it), lower and upper.
    pub faces: [[[[f32; TILE_ROOM]; 2]; 2]; 2],
    /// By side: all bits of a byte where something is left there, else none.
    pub kept: [[u8; TILE_ROOM]; 2],
}

impl CutParts {
    /// Nothing cut yet.
    pub(crate) const NONE: CutParts = CutParts {
        axis: 0,
        plane: 0.0,
        faces: [[[[0.0; TILE_ROOM]; 2]; 2]; 2],
        kept: [[0; TILE_ROOM]; 2],
    };

    /// Both parts of the crossing reference of this number, and whether there is anything in them.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn parts(
        &self,
        reference: &ReferenceRow,
        number: usize,
    ) -> [(ReferenceRow, bool); 2] {
        let others = [(self.axis + 1) % 3, (self.axis + 2) % 3];
        let mut parts = [(*reference, true); 2];
        parts[0].0.faces[3 + self.axis] = self.plane;
        parts[1].0.faces[self.axis] = self.plane;
        for (side, (part, kept)) in parts.iter_mut().enumerate() {
            for (other, axis) in others.into_iter().enumerate() {
                for end in 0..2 {
                    part.faces[3 * end + axis] = self.faces[side][other][end][number];
                }
            }
            *kept = self.kept[side][number] != 0;
        }
        parts
    }
}

/// The operations, as loops that compilers turn into the vector instructions they may use. A set overrides what
/// intrinsics do better; the tests hold each to these loops.
pub(crate) trait ReferenceOps {
    /// The masks of a plane: which of the first `count` references go left, which right.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sides(faces: &AxisFaces, count: usize, plane: f32) -> [u64; 2] {
        let (mut left, mut right) = (0, 0);
        for j in 0..count.min(64) {
            left |= u64::from(goes_left(faces.lo[j], faces.hi[j], plane)) << j;
            right |= u64::from(goes_right(faces.hi[j], plane)) << j;
        }
        [left, right]
    }

    /// Moves the faces that a mask names to the front of `out`, in order, and to `planes` those
    /// that lie strictly between `low` and `high`; of planes that follow each other closely and are
    /// the same, some are left out. Returns the number of planes. Faces after the moved ones may be
    /// overwritten.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn gather(
        faces: &AxisFaces,
        mask: u64,
        low: f32,
        high: f32,
        out: &mut AxisFaces,
        planes: &mut PlaneList,
    ) -> usize {
        let mut found = 0;
        let mut last = [low; 2];
        let mut rest = mask;
        for k in 0..mask.count_ones() as usize {
            let i = rest.trailing_zeros() as usize & 63;
            rest &= rest.wrapping_sub(1);
            let here = [faces.lo[i], faces.hi[i]];
            [out.lo[k & 63], out.hi[k & 63]] = here;
            for side in 0..2 {
                let face = here[side];
                planes[found] = face;
                found += usize::from((low < face) & (face < high) & (face != last[side]));
            }
            last = here;
        }
        found
    }

    /// Counts, for each plane, the references that go left and those that end at or before it: all others
    /// go right.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn count(faces: &AxisFaces, count: usize, planes: &[f32; WIDTH]) -> [[u32; WIDTH]; 2] {
        let (mut left, mut ended) = ([0u32; WIDTH], [0u32; WIDTH]);
        for j in 0..count.min(64) {
            let (lo, hi) = (faces.lo[j], faces.hi[j]);
            for k in 0..WIDTH {
                left[k] += u32::from(goes_left(lo, hi, planes[k]));
                ended[k] += u32::from(!goes_right(hi, planes[k]));
            }
        }
        [left, ended]
    }

    /// The outermost faces of the references that a mask names.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn outermost(faces: &AxisFaces, mask: u64) -> Outermost {
        let mut out = Outermost { lowest: f32::MAX, highest: -f32::MAX, first_end: f32::MAX };
        let mut rest = mask;
        while rest != 0 {
            let i = rest.trailing_zeros() as usize & 63;
            rest &= rest - 1;
            out.lowest = min(out.lowest, faces.lo[i]);
            out.highest = max(out.highest, faces.hi[i]);
            out.first_end = min(out.first_end, faces.hi[i]);
        }
        out
    }

    /// Lists the places of references from `lo` to `hi` that a plane crosses, in order. At most
    /// [`TILE`] references. Returns how many there are; the entries after them are undefined.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn crossing(lo: &[f32], hi: &[f32], plane: f32, out: &mut TilePlaces) -> usize {
        let mut crossing = 0;
        for (i, (&lo, &hi)) in lo.iter().zip(hi).enumerate() {
            out[crossing] = i as u32;
            crossing += usize::from((lo < plane) & (plane < hi));
        }
        crossing
    }

    /// Divides a tile of references by a plane, whose crossing references have been cut: the left ones
    /// move to `left`, in place, the right ones to `right`. Returns how many go to either side.
    ///
    /// `tile` is the first reference of the tile and at least `left`; `right` is at least [`WIDTH`] beyond the
    /// end of the tile, and there is room for [`TILE`] and [`WIDTH`] references from it.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn divide(
        columns: &mut Columns,
        cut: &CutParts,
        tile: usize,
        count: usize,
        left: usize,
        right: usize,
    ) -> [usize; 2] {
        let (mut lefts, mut rights, mut crossing) = (0, 0, 0);
        for index in tile..tile + count {
            let reference = columns.get(index);
            let (lo, hi) = (reference.faces[cut.axis], reference.faces[3 + cut.axis]);
            if lo < cut.plane && cut.plane < hi {
                let parts = cut.parts(&reference, crossing & (TILE - 1));
                crossing += 1;
                columns.set(left + lefts, &parts[0].0);
                lefts += usize::from(parts[0].1);
                columns.set(right + rights, &parts[1].0);
                rights += usize::from(parts[1].1);
            } else {
                columns.set(left + lefts, &reference);
                lefts += usize::from(goes_left(lo, hi, cut.plane));
                columns.set(right + rights, &reference);
                rights += usize::from(goes_right(hi, cut.plane));
            }
        }
        [lefts, rights]
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::simd::every_set::for_every_set;
    use crate::simd::instruction_set::InstructionSet;
    use crate::simd::portable::Portable;
    use splitplane_test_support::random::Random;

    /// Numbers of a coarse grid, so that faces coincide and references are planar.
    struct Numbers(Random);

    impl Numbers {
        fn next(&mut self) -> f32 {
            self.0.below(256) as f32 / 16.0
        }

        fn faces(&mut self) -> AxisFaces {
            let mut faces = AxisFaces::NONE;
            for i in 0..64 {
                faces.lo[i] = self.next();
                faces.hi[i] = faces.lo[i] + (self.next() / 4.0 - 1.0).max(0.0);
            }
            faces
        }

        fn mask(&mut self) -> u64 {
            let bits = (0..8).fold(0u64, |bits, _| bits << 8 | (self.next() * 16.0) as u64);
            if self.next() < 8.0 { bits } else { bits & bits >> 7 & bits << 9 }
        }
    }

    /// Gathered faces, and planes in order, without repeats.
    fn gathered<L: ReferenceOps>(
        faces: &AxisFaces,
        mask: u64,
        low: f32,
        high: f32,
    ) -> Vec<Vec<f32>> {
        let (mut out, mut planes) = (AxisFaces::NONE, [f32::NAN; 2 * 64 + WIDTH]);
        let found = L::gather(faces, mask, low, high, &mut out, &mut planes);
        let mut planes = planes[..found].to_vec();
        planes.sort_by(f32::total_cmp);
        planes.dedup();
        let count = mask.count_ones() as usize;
        vec![out.lo[..count].to_vec(), out.hi[..count].to_vec(), planes]
    }

    for_every_set! {
        fn small_operations<S>() -> () {
            let mut numbers = Numbers(Random::new(1));
            for _ in 0..2000 {
                let (faces, mask) = (numbers.faces(), numbers.mask());
                let (plane, count) = (numbers.next(), numbers.next() as usize * 4);
                assert_eq!(S::sides(&faces, count, plane), Portable::sides(&faces, count, plane));
                let planes = core::array::from_fn(|_| numbers.next());
                assert_eq!(S::count(&faces, count, &planes), Portable::count(&faces, count, &planes));
                assert_eq!(S::outermost(&faces, mask), Portable::outermost(&faces, mask));
                let (low, high) = (numbers.next(), numbers.next());
                let expected = gathered::<Portable>(&faces, mask, low, high);
                assert_eq!(gathered::<S>(&faces, mask, low, high), expected);
                // Against the rule itself: every face inside, once.
                let chosen = (0..64).filter(|i| mask >> i & 1 == 1);
                let mut all: Vec<f32> = chosen.flat_map(|i| [faces.lo[i], faces.hi[i]]).collect();
                all.retain(|&face| low < face && face < high);
                all.sort_by(f32::total_cmp);
                all.dedup();
                assert_eq!(expected[2], all);
            }
        }
    }

    #[test]
    fn small_operations_are_the_plain_ones() {
        let sets = InstructionSet::available();
        sets.into_iter().for_each(small_operations);
    }
}
