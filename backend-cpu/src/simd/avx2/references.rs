//! [`ReferenceOps`] by AVX2: comparisons give masks of 8 lanes, and a table says for each mask which lanes to permute
//! to the front, where AVX-512 compresses.
//!
//! [`outermost`](ReferenceOps::outermost) keeps its loop: it is asked for nodes of one block, so it has at most 8 of 64
//! references to look at.

use core::arch::x86_64::*;

use super::{Avx2, lanes_at};
use crate::simd::columns::Columns;
use crate::simd::references::{AxisFaces, CutParts, PlaneList, ReferenceOps, TILE, TilePlaces};
use crate::simd::{Simd, WIDTH};

/// Lanes of a vector.
const LANES: usize = 8;

/// For each mask of eight and each lane how many lanes below it are set: which one of consecutive values belongs there.
static PLACES_OF: [[u8; 8]; 256] = places_of();

const fn places_of() -> [[u8; 8]; 256] {
    let mut table = [[0; 8]; 256];
    let mut mask = 0;
    while mask < 256 {
        let mut lane = 0;
        while lane < 8 {
            table[mask][lane] = (mask as u32 & ((1 << lane) - 1)).count_ones() as u8;
            lane += 1;
        }
        mask += 1;
    }
    table
}

impl ReferenceOps for Avx2 {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sides(faces: &AxisFaces, count: usize, plane: f32) -> [u64; 2] {
        let mut masks = [0u64; 2];
        // SAFETY: the processor has AVX2 by the type's contract; loads are of 8 of 64 floats.
        unsafe {
            let plane = _mm256_set1_ps(plane);
            for first in (0..64).step_by(LANES) {
                let lo = _mm256_loadu_ps(faces.lo.as_ptr().add(first));
                let hi = _mm256_loadu_ps(faces.hi.as_ptr().add(first));
                let ends = _mm256_cmp_ps::<_CMP_LE_OQ>(hi, plane);
                let starts = _mm256_cmp_ps::<_CMP_LT_OQ>(lo, plane);
                let beyond = _mm256_cmp_ps::<_CMP_GT_OQ>(hi, plane);
                let left = _mm256_movemask_ps(_mm256_or_ps(starts, ends)) as u32;
                masks[0] |= u64::from(left) << first;
                masks[1] |= u64::from(_mm256_movemask_ps(beyond) as u32) << first;
            }
        }
        let first = if count >= 64 { u64::MAX } else { (1 << count) - 1 };
        masks.map(|mask| mask & first)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn gather(
        faces: &AxisFaces,
        mask: u64,
        low: f32,
        high: f32,
        out: &mut AxisFaces,
        planes: &mut PlaneList,
    ) -> usize {
        let (mut kept, mut found) = (0, 0);
        // SAFETY: as above. `kept` counts set bits of `mask` below the current part, so it is at most 56 when
        // 8 floats are stored there; `found` at most 8 for each of 16 vectors, so it is at most 120 when 8 are.
        unsafe {
            let (low, high) = (_mm256_set1_ps(low), _mm256_set1_ps(high));
            for first in (0..64).step_by(LANES) {
                let mine = u32::from((mask >> first) as u8);
                if mine == 0 {
                    continue;
                }
                let lanes = lanes_at(mine);
                let count = mine.count_ones();
                for (column, to) in [(&faces.lo, &mut out.lo), (&faces.hi, &mut out.hi)] {
                    let face = _mm256_loadu_ps(column.as_ptr().add(first));
                    let face = _mm256_permutevar8x32_ps(face, lanes);
                    _mm256_storeu_ps(to.as_mut_ptr().add(kept), face);
                    let inside = _mm256_and_ps(
                        _mm256_cmp_ps::<_CMP_LT_OQ>(low, face),
                        _mm256_cmp_ps::<_CMP_LT_OQ>(face, high),
                    );
                    let new = _mm256_andnot_ps(repeated(face), inside);
                    let new = _mm256_movemask_ps(new) as u32 & ((1 << count) - 1);
                    let listed = _mm256_permutevar8x32_ps(face, lanes_at(new));
                    _mm256_storeu_ps(planes.as_mut_ptr().add(found), listed);
                    found += new.count_ones() as usize;
                }
                kept += count as usize;
            }
        }
        found
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn count(faces: &AxisFaces, count: usize, planes: &[f32; WIDTH]) -> [[u32; WIDTH]; 2] {
        let mut out = [[0u32; WIDTH]; 2];
        // SAFETY: as above; loads and stores are of arrays of 16 words.
        unsafe {
            let planes = [0, LANES].map(|first| _mm256_loadu_ps(planes.as_ptr().add(first)));
            let mut left = [_mm256_setzero_si256(); 2];
            let mut ended = [_mm256_setzero_si256(); 2];
            for j in 0..count.min(64) {
                let (lo, hi) = (_mm256_set1_ps(faces.lo[j]), _mm256_set1_ps(faces.hi[j]));
                for half in 0..2 {
                    let ends = _mm256_cmp_ps::<_CMP_LE_OQ>(hi, planes[half]);
                    let starts = _mm256_cmp_ps::<_CMP_LT_OQ>(lo, planes[half]);
                    let goes = _mm256_castps_si256(_mm256_or_ps(starts, ends));
                    // A mask is -1.
                    left[half] = _mm256_sub_epi32(left[half], goes);
                    ended[half] = _mm256_sub_epi32(ended[half], _mm256_castps_si256(ends));
                }
            }
            for half in 0..2 {
                let to = |out: &mut [u32; WIDTH]| out.as_mut_ptr().add(LANES * half).cast();
                _mm256_storeu_si256(to(&mut out[0]), left[half]);
                _mm256_storeu_si256(to(&mut out[1]), ended[half]);
            }
        }
        out
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn crossing(lo: &[f32], hi: &[f32], plane: f32, out: &mut TilePlaces) -> usize {
        let count = lo.len().min(hi.len());
        assert!(count <= TILE);
        let whole = count - count % LANES;
        let mut crossing = 0;
        // SAFETY: the processor has AVX2 by the type's contract. Loads are of whole vectors before the ends. At most
        // TILE places are listed, and there is space for a whole store after them.
        unsafe {
            let at = _mm256_set1_ps(plane);
            let mut place = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            for start in (0..whole).step_by(LANES) {
                let lo = _mm256_loadu_ps(lo.as_ptr().add(start));
                let hi = _mm256_loadu_ps(hi.as_ptr().add(start));
                let both = _mm256_and_ps(
                    _mm256_cmp_ps::<_CMP_LT_OQ>(lo, at),
                    _mm256_cmp_ps::<_CMP_LT_OQ>(at, hi),
                );
                let both = _mm256_movemask_ps(both) as u32;
                let listed = _mm256_permutevar8x32_epi32(place, lanes_at(both));
                _mm256_storeu_si256(out.as_mut_ptr().add(crossing).cast(), listed);
                crossing += both.count_ones() as usize;
                place = _mm256_add_epi32(place, _mm256_set1_epi32(LANES as i32));
            }
        }
        for i in whole..count {
            out[crossing] = i as u32;
            crossing += usize::from((lo[i] < plane) & (plane < hi[i]));
        }
        crossing
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn divide(
        columns: &mut Columns,
        cut: &CutParts,
        tile: usize,
        count: usize,
        left: usize,
        right: usize,
    ) -> [usize; 2] {
        assert!(count <= TILE && left <= tile && tile + count + WIDTH <= right);
        assert!(right + TILE + WIDTH <= columns.room());
        let (axis, plane) = (cut.axis, cut.plane);
        let start = columns.pointers();
        let (mut lefts, mut rights, mut crossing) = (0, 0, 0);
        // SAFETY: the processor has AVX2 by the type's contract. Loads begin at a reference of the tile and reach
        // at most 7 beyond its end, so they stay within the columns' room by the assertions. A block is loaded
        // whole before anything of it is stored. `lefts` and `rights` are at most the number of references
        // before the block, so stores to the left end at the end of a whole block or before it, which is before
        // `right`, and those to the right within the room. `crossing` is at most the number of references before
        // the block, and cuts have room for TILE + WIDTH.
        unsafe {
            let at = _mm256_set1_ps(plane);
            let mut block = 0;
            while block < count {
                let valid =
                    if count - block >= LANES { 0xff } else { (1u32 << (count - block)) - 1 };
                let mut face = [_mm256_setzero_ps(); 6];
                for (row, face) in face.iter_mut().enumerate() {
                    *face = _mm256_loadu_ps(start.0[row].add(tile + block));
                }
                let triangle = _mm256_loadu_si256(start.1.add(tile + block).cast());
                let (lo, hi) = (face[axis], face[3 + axis]);
                let starts = _mm256_cmp_ps::<_CMP_LT_OQ>(lo, at);
                let ends = _mm256_cmp_ps::<_CMP_LE_OQ>(hi, at);
                let beyond = _mm256_cmp_ps::<_CMP_GT_OQ>(hi, at);
                let goes_left = _mm256_movemask_ps(_mm256_or_ps(starts, ends)) as u32;
                let mut sides = [goes_left, _mm256_movemask_ps(beyond) as u32].map(|s| s & valid);
                let both = _mm256_movemask_ps(_mm256_and_ps(starts, beyond)) as u32 & valid;
                let mut parts = [face, face];
                if both != 0 {
                    let crosses = Avx2::mask(both);
                    let places = PLACES_OF[both as usize].as_ptr();
                    let places = _mm256_cvtepu8_epi32(_mm_loadl_epi64(places.cast()));
                    for side in 0..2 {
                        for other in 0..2 {
                            for end in 0..2 {
                                let column = &cut.faces[side][other][end];
                                let cut = _mm256_loadu_ps(column.as_ptr().add(crossing));
                                let cut = _mm256_permutevar8x32_ps(cut, places);
                                let row = (axis + 1 + other) % 3 + 3 * end;
                                parts[side][row] = _mm256_blendv_ps(parts[side][row], cut, crosses);
                            }
                        }
                        let kept = _mm_loadl_epi64(cut.kept[side].as_ptr().add(crossing).cast());
                        let kept = _mm256_castsi256_ps(_mm256_cvtepi8_epi32(kept));
                        let kept = _mm256_movemask_ps(_mm256_permutevar8x32_ps(kept, places));
                        sides[side] &= !both | kept as u32;
                    }
                    parts[0][3 + axis] = _mm256_blendv_ps(parts[0][3 + axis], at, crosses);
                    parts[1][axis] = _mm256_blendv_ps(parts[1][axis], at, crosses);
                    crossing += both.count_ones() as usize;
                }
                for (side, to) in [left + lefts, right + rights].into_iter().enumerate() {
                    if sides[side] == 0 {
                        continue;
                    }
                    let lanes = lanes_at(sides[side]);
                    for row in 0..6 {
                        let packed = _mm256_permutevar8x32_ps(parts[side][row], lanes);
                        _mm256_storeu_ps(start.0[row].add(to), packed);
                    }
                    let packed = _mm256_permutevar8x32_epi32(triangle, lanes);
                    _mm256_storeu_si256(start.1.add(to).cast(), packed);
                }
                lefts += sides[0].count_ones() as usize;
                rights += sides[1].count_ones() as usize;
                block += LANES;
            }
        }
        [lefts, rights]
    }
}

/// All bits of the lanes whose face one of the four lanes before them has: neighbours share corners, so it is no
/// new plane.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn repeated(face: __m256) -> __m256 {
    // SAFETY: the caller's contract.
    unsafe {
        // The lanes one, two, three and four further, and nothing equal before the first.
        let none = _mm256_set1_ps(f32::NAN);
        let one = _mm256_permutevar8x32_ps(face, _mm256_setr_epi32(0, 0, 1, 2, 3, 4, 5, 6));
        let two = _mm256_permutevar8x32_ps(face, _mm256_setr_epi32(0, 0, 0, 1, 2, 3, 4, 5));
        let three = _mm256_permutevar8x32_ps(face, _mm256_setr_epi32(0, 0, 0, 0, 1, 2, 3, 4));
        let four = _mm256_permute2f128_ps::<0x08>(face, face);
        let equal = |other| _mm256_cmp_ps::<_CMP_EQ_OQ>(face, other);
        let near = _mm256_or_ps(
            equal(_mm256_blend_ps::<0b1>(one, none)),
            equal(_mm256_blend_ps::<0b11>(two, none)),
        );
        let far = _mm256_or_ps(
            equal(_mm256_blend_ps::<0b111>(three, none)),
            equal(_mm256_blend_ps::<0b1111>(four, none)),
        );
        _mm256_or_ps(near, far)
    }
}
