//! [`ReferenceOps`] by AVX-512: comparisons give masks, and masks compress.

use core::arch::x86_64::*;

use super::Avx512;
use crate::simd::WIDTH;
use crate::simd::columns::Columns;
use crate::simd::references::{
    AxisFaces, CutParts, Outermost, PlaneList, ReferenceOps, TILE, TilePlaces,
};

impl ReferenceOps for Avx512 {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sides(faces: &AxisFaces, count: usize, plane: f32) -> [u64; 2] {
        let mut masks = [0u64; 2];
        // SAFETY: the processor has AVX-512 by the type's contract; loads are of 16 of 64 floats.
        unsafe {
            let plane = _mm512_set1_ps(plane);
            for part in 0..4 {
                let lo = _mm512_loadu_ps(faces.lo.as_ptr().add(WIDTH * part));
                let hi = _mm512_loadu_ps(faces.hi.as_ptr().add(WIDTH * part));
                let ends = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(hi, plane);
                let starts = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(lo, plane);
                let beyond = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(hi, plane);
                masks[0] |= u64::from(starts | ends) << (WIDTH * part);
                masks[1] |= u64::from(beyond) << (WIDTH * part);
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
        // Stores are whole: the last one may begin at the 48th face at most, so it goes by way of this.
        let mut moved = [[0.0f32; 64 + WIDTH]; 2];
        let (mut kept, mut found) = (0, 0);
        // SAFETY: as above. `kept` counts set bits of `mask` below the current part, so it is at
        // most 48 when 16 floats are stored there; `found` at most 16 for each of 8 vectors, so it
        // is at most 112 when 16 are stored there.
        unsafe {
            let (low, high) = (_mm512_set1_ps(low), _mm512_set1_ps(high));
            for part in 0..4 {
                let mine = (mask >> (WIDTH * part)) as u16;
                if mine == 0 {
                    continue;
                }
                for (side, column) in [&faces.lo, &faces.hi].into_iter().enumerate() {
                    let face = _mm512_loadu_ps(column.as_ptr().add(WIDTH * part));
                    let face = _mm512_maskz_compress_ps(mine, face);
                    _mm512_storeu_ps(moved[side].as_mut_ptr().add(kept), face);
                    let mut inside = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(low, face)
                        & _mm512_cmp_ps_mask::<_CMP_LT_OQ>(face, high)
                        & ((1u32 << mine.count_ones()) - 1) as u16;
                    // Neighbours share corners: a face that one of the four before it has is not new.
                    let bits = _mm512_castps_si512(face);
                    let zero = _mm512_setzero_si512();
                    inside &=
                        !(_mm512_cmpeq_epi32_mask(bits, _mm512_alignr_epi32::<15>(bits, zero))
                            & !1);
                    inside &=
                        !(_mm512_cmpeq_epi32_mask(bits, _mm512_alignr_epi32::<14>(bits, zero))
                            & !3);
                    inside &=
                        !(_mm512_cmpeq_epi32_mask(bits, _mm512_alignr_epi32::<13>(bits, zero))
                            & !7);
                    inside &=
                        !(_mm512_cmpeq_epi32_mask(bits, _mm512_alignr_epi32::<12>(bits, zero))
                            & !15);
                    let new = _mm512_maskz_compress_ps(inside, face);
                    _mm512_storeu_ps(planes.as_mut_ptr().add(found), new);
                    found += inside.count_ones() as usize;
                }
                kept += mine.count_ones() as usize;
            }
        }
        out.lo.copy_from_slice(&moved[0][..64]);
        out.hi.copy_from_slice(&moved[1][..64]);
        found
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn count(faces: &AxisFaces, count: usize, planes: &[f32; WIDTH]) -> [[u32; WIDTH]; 2] {
        let mut out = [[0u32; WIDTH]; 2];
        // SAFETY: as above; loads and stores are of arrays of 16 words.
        unsafe {
            let planes = _mm512_loadu_ps(planes.as_ptr());
            let one = _mm512_set1_epi32(1);
            let (mut left, mut ended) = (_mm512_setzero_si512(), _mm512_setzero_si512());
            for j in 0..count.min(64) {
                let (lo, hi) = (_mm512_set1_ps(faces.lo[j]), _mm512_set1_ps(faces.hi[j]));
                let ends = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(hi, planes);
                let starts = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(lo, planes);
                left = _mm512_mask_add_epi32(left, starts | ends, left, one);
                ended = _mm512_mask_add_epi32(ended, ends, ended, one);
            }
            _mm512_storeu_si512(out[0].as_mut_ptr().cast(), left);
            _mm512_storeu_si512(out[1].as_mut_ptr().cast(), ended);
        }
        out
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn outermost(faces: &AxisFaces, mask: u64) -> Outermost {
        // SAFETY: as above; loads are of 16 of 64 floats.
        unsafe {
            let most = _mm512_set1_ps(f32::MAX);
            let (mut lowest, mut first_end) = (most, most);
            let mut highest = _mm512_set1_ps(-f32::MAX);
            for part in 0..4 {
                let mine = (mask >> (WIDTH * part)) as u16;
                let lo = _mm512_loadu_ps(faces.lo.as_ptr().add(WIDTH * part));
                let hi = _mm512_loadu_ps(faces.hi.as_ptr().add(WIDTH * part));
                lowest = _mm512_mask_min_ps(lowest, mine, lowest, lo);
                first_end = _mm512_mask_min_ps(first_end, mine, first_end, hi);
                highest = _mm512_mask_max_ps(highest, mine, highest, hi);
            }
            Outermost {
                lowest: _mm512_reduce_min_ps(lowest),
                highest: _mm512_reduce_max_ps(highest),
                first_end: _mm512_reduce_min_ps(first_end),
            }
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn crossing(lo: &[f32], hi: &[f32], plane: f32, out: &mut TilePlaces) -> usize {
        let count = lo.len().min(hi.len());
        assert!(count <= TILE);
        let mut crossing = 0;
        // SAFETY: the processor has AVX-512 by the type's contract. Loads are masked beyond the
        // ends. At most TILE places are listed, and there is space for a whole store after them.
        unsafe {
            let plane = _mm512_set1_ps(plane);
            let mut place = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
            for start in (0..count).step_by(WIDTH) {
                let left = count - start;
                let valid = if left >= WIDTH { u16::MAX } else { (1 << left) - 1 };
                let lo = _mm512_maskz_loadu_ps(valid, lo.as_ptr().add(start));
                let hi = _mm512_maskz_loadu_ps(valid, hi.as_ptr().add(start));
                let starts = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(valid, lo, plane);
                let both = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(starts, plane, hi);
                let listed = _mm512_maskz_compress_epi32(both, place);
                _mm512_storeu_si512(out.as_mut_ptr().add(crossing).cast(), listed);
                crossing += both.count_ones() as usize;
                place = _mm512_add_epi32(place, _mm512_set1_epi32(WIDTH as i32));
            }
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
        // SAFETY: the processor has AVX-512 by the type's contract. Loads begin at a reference of the tile
        // and reach at most 15 beyond its end, so they stay within the columns' room by the assertions. A
        // block is loaded whole before anything of it is stored. `lefts` and `rights` are at most the number
        // of references before the block, so stores to the left end at the end of a whole block or before
        // it, which is before `right`, and those to the right within the room. `crossing` is at most the number
        // of references before the block, and cuts have room for TILE + WIDTH.
        unsafe {
            let at = _mm512_set1_ps(plane);
            let mut block = 0;
            while block < count {
                let valid = if count - block >= WIDTH {
                    u16::MAX
                } else {
                    ((1u32 << (count - block)) - 1) as u16
                };
                let mut face = [_mm512_setzero_ps(); 6];
                for (row, face) in face.iter_mut().enumerate() {
                    *face = _mm512_loadu_ps(start.0[row].add(tile + block));
                }
                let triangle = _mm512_loadu_si512(start.1.add(tile + block).cast());
                let (lo, hi) = (face[axis], face[3 + axis]);
                let starts = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(lo, at);
                let ends = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(hi, at);
                let beyond = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(hi, at);
                let both = starts & beyond & valid;
                let mut sides = [(starts | ends) & valid, beyond & valid];
                let mut parts = [face, face];
                if both != 0 {
                    let others = [(axis + 1) % 3, (axis + 2) % 3];
                    for side in 0..2 {
                        for (other, row) in others.into_iter().enumerate() {
                            for end in 0..2 {
                                let column = &cut.faces[side][other][end];
                                let cut = _mm512_loadu_ps(column.as_ptr().add(crossing));
                                let row = row + 3 * end;
                                parts[side][row] =
                                    _mm512_mask_expand_ps(parts[side][row], both, cut);
                            }
                        }
                        let kept = _mm_loadu_si128(cut.kept[side].as_ptr().add(crossing).cast());
                        let kept = _pdep_u32(u32::from(_mm_movepi8_mask(kept)), u32::from(both));
                        sides[side] &= !both | kept as u16;
                    }
                    parts[0][3 + axis] = _mm512_mask_mov_ps(parts[0][3 + axis], both, at);
                    parts[1][axis] = _mm512_mask_mov_ps(parts[1][axis], both, at);
                    crossing += both.count_ones() as usize;
                }
                for (side, to) in [left + lefts, right + rights].into_iter().enumerate() {
                    if sides[side] == 0 {
                        continue;
                    }
                    for row in 0..6 {
                        let packed = _mm512_maskz_compress_ps(sides[side], parts[side][row]);
                        _mm512_storeu_ps(start.0[row].add(to), packed);
                    }
                    let packed = _mm512_maskz_compress_epi32(sides[side], triangle);
                    _mm512_storeu_si512(start.1.add(to).cast(), packed);
                }
                lefts += sides[0].count_ones() as usize;
                rights += sides[1].count_ones() as usize;
                block += WIDTH;
            }
        }
        [lefts, rights]
    }
}
