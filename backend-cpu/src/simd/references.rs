//! What the builder does to 16 values at once: the SIMD module of the build.
//!
//! [`Lanes`] names the operations, [`Plain`] says what they mean in loops that compilers turn into vector
//! instructions where they can, [`Avx512`] does the same by intrinsics. The tests below hold them to each
//! other on every processor that has both.

use splitplane_core::aabb::{max, min};
use splitplane_core::split::{goes_left, goes_right};

use super::columns::Columns;
use super::cut::{Cut, TILE};

/// Values done at once.
pub(crate) const WIDTH: usize = 16;

/// Bounds of up to 64 references on one axis.
#[derive(Clone, Debug)]
pub(crate) struct Faces {
    /// Lower faces.
    pub lo: [f32; 64],
    /// Upper faces.
    pub hi: [f32; 64],
}

impl Faces {
    /// All zero.
    pub const NONE: Faces = Faces { lo: [0.0; 64], hi: [0.0; 64] };
}

/// Places in a tile, and room for a whole store behind them.
pub(crate) type Places = [u32; TILE + WIDTH];

/// Candidate planes of a node on one axis: some of its faces, and room for a whole store behind them.
pub(crate) type Planes = [f32; 2 * 64 + WIDTH];

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

/// The operations, on one instruction set.
pub(crate) trait Lanes {
    /// The masks of a plane: which of the first `count` references go left, which right.
    fn sides(faces: &Faces, count: usize, plane: f32) -> [u64; 2];

    /// Moves the faces that a mask names to the front of `out`, in order, and to `planes` those that lie
    /// strictly between `low` and `high`; of planes that follow each other closely and are the same, some
    /// are left out. Returns the number of planes. Faces behind the moved ones may be overwritten.
    fn gather(
        faces: &Faces,
        mask: u64,
        low: f32,
        high: f32,
        out: &mut Faces,
        planes: &mut Planes,
    ) -> usize;

    /// Counts, for each plane, the references that go left and those that end at or before it: all others
    /// go right.
    fn count(faces: &Faces, count: usize, planes: &[f32; WIDTH]) -> [[u32; WIDTH]; 2];

    /// The outermost faces of the references that a mask names.
    fn outermost(faces: &Faces, mask: u64) -> Outermost;

    /// Lists the places of references from `lo` to `hi` that a plane crosses, in order. At most [`TILE`]
    /// references. Returns how many there are; what stands behind them is of no use.
    fn crossing(lo: &[f32], hi: &[f32], plane: f32, out: &mut Places) -> usize;

    /// Divides a tile of references by a plane, whose crossing references have been cut: the left ones
    /// move to `left`, in place, the right ones to `right`. Returns how many go to either side.
    ///
    /// `tile` is the first reference of the tile and at least `left`; `right` is at least [`WIDTH`] beyond the
    /// end of the tile, and there is room for [`TILE`] and [`WIDTH`] references from it.
    fn divide(
        columns: &mut Columns,
        cut: &Cut,
        tile: usize,
        count: usize,
        left: usize,
        right: usize,
    ) -> [usize; 2];
}

/// By loops.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plain;

impl Lanes for Plain {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sides(faces: &Faces, count: usize, plane: f32) -> [u64; 2] {
        let (mut left, mut right) = (0, 0);
        for j in 0..count.min(64) {
            left |= u64::from(goes_left(faces.lo[j], faces.hi[j], plane)) << j;
            right |= u64::from(goes_right(faces.hi[j], plane)) << j;
        }
        [left, right]
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn gather(
        faces: &Faces,
        mask: u64,
        low: f32,
        high: f32,
        out: &mut Faces,
        planes: &mut Planes,
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

    #[cfg_attr(not(unoptimised), inline(always))]
    fn count(faces: &Faces, count: usize, planes: &[f32; WIDTH]) -> [[u32; WIDTH]; 2] {
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

    #[cfg_attr(not(unoptimised), inline(always))]
    fn outermost(faces: &Faces, mask: u64) -> Outermost {
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

    #[cfg_attr(not(unoptimised), inline(always))]
    fn crossing(lo: &[f32], hi: &[f32], plane: f32, out: &mut Places) -> usize {
        let mut crossing = 0;
        for (i, (&lo, &hi)) in lo.iter().zip(hi).enumerate() {
            out[crossing] = i as u32;
            crossing += usize::from((lo < plane) & (plane < hi));
        }
        crossing
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn divide(
        columns: &mut Columns,
        cut: &Cut,
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

/// By AVX-512. Only functions compiled for it may be instantiated with this type: its operations are
/// inlined into them.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx512;

#[cfg(target_arch = "x86_64")]
impl Lanes for Avx512 {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sides(faces: &Faces, count: usize, plane: f32) -> [u64; 2] {
        use core::arch::x86_64::*;
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
        faces: &Faces,
        mask: u64,
        low: f32,
        high: f32,
        out: &mut Faces,
        planes: &mut Planes,
    ) -> usize {
        use core::arch::x86_64::*;
        // Stores are whole: the last one may begin at the 48th face at most, so it goes by way of this.
        let mut moved = [[0.0f32; 64 + WIDTH]; 2];
        let (mut kept, mut found) = (0, 0);
        // SAFETY: as above. `kept` counts set bits of `mask` below the part at hand, so it is at most 48
        // when 16 floats are stored there; `found` at most 16 for each of 8 vectors, so it is at most 112
        // when 16 are stored there.
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
    fn count(faces: &Faces, count: usize, planes: &[f32; WIDTH]) -> [[u32; WIDTH]; 2] {
        use core::arch::x86_64::*;
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
    fn outermost(faces: &Faces, mask: u64) -> Outermost {
        use core::arch::x86_64::*;
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
    fn crossing(lo: &[f32], hi: &[f32], plane: f32, out: &mut Places) -> usize {
        use core::arch::x86_64::*;
        let count = lo.len().min(hi.len());
        assert!(count <= TILE);
        let mut crossing = 0;
        // SAFETY: the processor has AVX-512 by the type's contract. Loads are masked beyond the ends. At most
        // TILE places are listed, and there is room for a whole store behind them.
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
        cut: &Cut,
        tile: usize,
        count: usize,
        left: usize,
        right: usize,
    ) -> [usize; 2] {
        use core::arch::x86_64::*;
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

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::cached::columns::Row;
    use crate::every_set::for_every_set;
    use crate::query::InstructionSet;
    use splitplane_core::arithmetic::Strict;
    use splitplane_core::triangle::Triangle;
    use splitplane_test_support::random::Random;

    /// Numbers of a coarse grid, so that faces coincide and references are planar.
    struct Numbers(Random);

    impl Numbers {
        fn next(&mut self) -> f32 {
            self.0.below(256) as f32 / 16.0
        }

        fn faces(&mut self) -> Faces {
            let mut faces = Faces::NONE;
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

    fn avx512() -> bool {
        InstructionSet::available().contains(&InstructionSet::Avx512)
    }

    /// Gathered faces, and planes in order, without repeats.
    fn gathered<L: Lanes>(faces: &Faces, mask: u64, low: f32, high: f32) -> Vec<Vec<f32>> {
        let (mut out, mut planes) = (Faces::NONE, [f32::NAN; 2 * 64 + WIDTH]);
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
                assert_eq!(Avx512::sides(&faces, count, plane), Plain::sides(&faces, count, plane));
                let planes = core::array::from_fn(|_| numbers.next());
                assert_eq!(Avx512::count(&faces, count, &planes), Plain::count(&faces, count, &planes));
                assert_eq!(Avx512::outermost(&faces, mask), Plain::outermost(&faces, mask));
                let (low, high) = (numbers.next(), numbers.next());
                let expected = gathered::<Plain>(&faces, mask, low, high);
                assert_eq!(gathered::<Avx512>(&faces, mask, low, high), expected);
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
        if avx512() {
            small_operations(InstructionSet::Avx512);
        }
    }

    /// What a node of these references becomes: the left rows, then the right ones.
    fn divided<L: Lanes>(
        references: &[Row],
        triangles: Option<&[Triangle]>,
        axis: usize,
        plane: f32,
    ) -> [Vec<Row>; 2] {
        let count = references.len();
        let right_first = count + WIDTH;
        let mut columns = Columns::default();
        columns.lengthen(right_first + count + TILE + WIDTH).expect("memory");
        for (i, row) in references.iter().enumerate() {
            columns.set(i, row);
        }
        let mut cut = Box::new(Cut::new());
        (cut.axis, cut.plane) = (axis, plane);
        let mut sides = [0; 2];
        for tile in (0..count).step_by(TILE) {
            let rows = TILE.min(count - tile);
            cut.tile::<Strict, L>(&columns, tile, rows, triangles);
            let to = right_first + sides[1];
            let more = L::divide(&mut columns, &cut, tile, rows, sides[0], to);
            sides = [sides[0] + more[0], sides[1] + more[1]];
        }
        let rows = |first: usize, count: usize| (first..first + count).map(|i| columns.get(i));
        [rows(0, sides[0]).collect(), rows(right_first, sides[1]).collect()]
    }

    /// The same by core's functions, one reference after the other.
    fn by_core(
        references: &[Row],
        triangles: Option<&[Triangle]>,
        axis: usize,
        plane: f32,
    ) -> [Vec<Row>; 2] {
        use splitplane_core::aabb::Aabb;
        let mut sides = [vec![], vec![]];
        for row in references {
            let [lx, ly, lz, hx, hy, hz] = row.faces;
            let bounds = Aabb { lo: [lx, ly, lz], hi: [hx, hy, hz] };
            let mut parts = [bounds; 2];
            let mut goes = [
                goes_left(bounds.lo[axis], bounds.hi[axis], plane),
                goes_right(bounds.hi[axis], plane),
            ];
            if goes == [true; 2] {
                parts[0].hi[axis] = plane;
                parts[1].lo[axis] = plane;
                if let Some(triangles) = triangles {
                    let corners = &triangles[row.triangle as usize];
                    parts =
                        splitplane_core::triangle::clip::<Strict>(corners, &bounds, axis, plane);
                    goes = parts.map(|part| !part.is_empty());
                }
            }
            for side in 0..2 {
                if goes[side] {
                    let Aabb { lo: [lx, ly, lz], hi: [hx, hy, hz] } = parts[side];
                    let faces = [lx, ly, lz, hx, hy, hz];
                    sides[side].push(Row { faces, triangle: row.triangle });
                }
            }
        }
        sides
    }

    for_every_set! {
        fn divide_by_avx512<S>(
            references: &[Row],
            triangles: Option<&[Triangle]>,
            axis: usize,
            plane: f32,
        ) -> [Vec<Row>; 2] {
            divided::<Avx512>(references, triangles, axis, plane)
        }
    }

    /// References of triangles of all kinds, some of them clipped before, divided at ordinary and extreme
    /// scales by planes that cross many, few and none.
    #[test]
    fn divided_as_core_divides() {
        let mut numbers = Numbers(Random::new(5));
        let mut lost = 0;
        for scale in [1.0f32, 1e-36, 1e-30, 1e30, 2e37] {
            for count in [1, 15, 16, 17, 100, 1023, 1024, 1025, 2100] {
                let triangles: Vec<Triangle> = (0..count)
                    .map(|_| {
                        let centre = [(); 3].map(|()| numbers.next() * 2.0 - 16.0);
                        let size = if numbers.next() < 1.0 { 1.0 } else { 0.1 };
                        [(); 3]
                            .map(|()| centre.map(|x| (x + size * (numbers.next() - 8.0)) * scale))
                    })
                    .collect();
                let mut references: Vec<Row> = (0u32..)
                    .zip(&triangles)
                    .map(|(triangle, corners)| {
                        let bounds = splitplane_core::aabb::Aabb::of_points(corners);
                        let ([lx, ly, lz], [hx, hy, hz]) = (bounds.lo, bounds.hi);
                        Row { faces: [lx, ly, lz, hx, hy, hz], triangle }
                    })
                    .collect();
                for turn in 0..6 {
                    let (axis, clip) = (turn % 3, turn < 4 || count % 2 == 0);
                    let plane = match turn {
                        0 => references[count / 2].faces[axis],
                        1 => references[count / 3].faces[3 + axis],
                        _ => (numbers.next() - 8.0) * scale,
                    };
                    let corners = clip.then_some(&triangles[..]);
                    let expected = by_core(&references, corners, axis, plane);
                    let found = divided::<Plain>(&references, corners, axis, plane);
                    assert_eq!(found, expected, "{scale} {count} {turn}");
                    if avx512() {
                        let set = InstructionSet::Avx512;
                        let found = divide_by_avx512(set, &references, corners, axis, plane);
                        assert_eq!(found, expected, "{scale} {count} {turn}");
                    }
                    let sides = expected.iter().map(Vec::len).sum::<usize>();
                    lost += references.len().saturating_sub(sides);
                    // On with the larger part, whose bounds are no longer those of the triangles.
                    let [left, right] = expected;
                    references = if left.len() > right.len() { left } else { right };
                    if references.is_empty() {
                        break;
                    }
                    let middle = references.len() / 2;
                    if turn > 2 {
                        // Bounds that hold more than the triangle, which clipping finds out.
                        references[middle].faces[3] += scale;
                    }
                }
            }
        }
        // A reference may go nowhere; it seldom does.
        assert!(lost < 100, "{lost}");
    }
}
