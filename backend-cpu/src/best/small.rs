//! The least split of a small node: every face of every reference, against all references, 16 planes at
//! a time.

use splitplane_core::layout::Reference;

use super::cost::{Best, Cell, Costs, Split};
use crate::query::InstructionSet;

/// Most references that are searched this way.
pub(super) const MOST: usize = 64;
/// Planes at a time.
const BLOCK: usize = 16;

/// The split of least (cost, axis, position) that costs less than `limit`. At most [`MOST`] references.
pub(super) fn best_split(
    set: InstructionSet,
    costs: &Costs,
    cell: &Cell,
    references: &[Reference],
    limit: f64,
) -> Option<Split> {
    match set {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: only sets that the processor has come here.
        InstructionSet::Avx512 => unsafe { best_16(costs, cell, references, limit) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        InstructionSet::Avx2 => unsafe { best_8(costs, cell, references, limit) },
        _ => best::<Loops>(costs, cell, references, limit),
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
) -> Option<Split> {
    best::<Avx512>(costs, cell, references, limit)
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
) -> Option<Split> {
    best::<Loops>(costs, cell, references, limit)
}

#[inline(always)]
fn best<C: CountSides>(
    costs: &Costs,
    cell: &Cell,
    references: &[Reference],
    limit: f64,
) -> Option<Split> {
    let references = &references[..references.len().min(MOST)];
    let count = references.len() as u32;
    let mut best = Best::below(limit);
    for axis in 0..3 {
        let mut faces = Faces { lo: [0.0; MOST], hi: [0.0; MOST] };
        // Planes strictly inside, and what comes of rounding their number up to whole blocks.
        let mut planes = [0.0; 2 * MOST + BLOCK];
        let mut inside = 0;
        for (i, reference) in references.iter().enumerate() {
            let (lo, hi) = (reference.lo[axis], reference.hi[axis]);
            (faces.lo[i], faces.hi[i]) = (lo, hi);
            planes[inside] = lo;
            inside += usize::from(cell.contains(axis, lo));
            planes[inside] = hi;
            inside += usize::from(cell.contains(axis, hi) && hi != lo);
        }
        for block in planes.as_chunks::<BLOCK>().0.iter().take(inside.div_ceil(BLOCK)) {
            let [left, right, either] = C::count(&faces, references.len(), block);
            let valid = inside.min(BLOCK);
            inside -= valid;
            // What neither starts before a plane nor ends behind it is planar in it.
            let planar = either.map(|n| count - n);
            let mut least = [0.0; BLOCK];
            // Without branches, to be turned into vector instructions.
            for k in 0..BLOCK {
                let areas = cell.axes[axis].at(f64::from(block[k]));
                let low = costs.split(cell.step, areas, [left[k] + planar[k], right[k]]);
                let high = costs.split(cell.step, areas, [left[k], right[k] + planar[k]]);
                least[k] = if high < low { high } else { low };
            }
            for k in 0..valid {
                if least[k] <= best.cost {
                    best.consider(costs, cell, axis, block[k], [left[k], planar[k], right[k]]);
                }
            }
        }
    }
    best.split
}

/// The bounds of a node's references on one axis, side by side.
struct Faces {
    lo: [f32; MOST],
    hi: [f32; MOST],
}

/// Counts, for each of [`BLOCK`] planes, the references that start before it, those that end behind it,
/// and those that do either.
trait CountSides {
    fn count(faces: &Faces, count: usize, planes: &[f32; BLOCK]) -> [[u32; BLOCK]; 3];
}

/// By loops that a compiler may turn into vector instructions.
struct Loops;

impl CountSides for Loops {
    #[inline(always)]
    fn count(faces: &Faces, count: usize, planes: &[f32; BLOCK]) -> [[u32; BLOCK]; 3] {
        let [mut left, mut right, mut either] = [[0u32; BLOCK]; 3];
        for j in 0..count {
            let (lo, hi) = (faces.lo[j], faces.hi[j]);
            for k in 0..BLOCK {
                let (before, behind) = (lo < planes[k], hi > planes[k]);
                left[k] += u32::from(before);
                right[k] += u32::from(behind);
                either[k] += u32::from(before | behind);
            }
        }
        [left, right, either]
    }
}

/// By AVX-512: [`best_16`] alone uses it.
#[cfg(target_arch = "x86_64")]
struct Avx512;

#[cfg(target_arch = "x86_64")]
impl CountSides for Avx512 {
    #[inline(always)]
    fn count(faces: &Faces, count: usize, planes: &[f32; BLOCK]) -> [[u32; BLOCK]; 3] {
        use core::arch::x86_64::*;
        let mut out = [[0u32; BLOCK]; 3];
        // SAFETY: only `best_16` is instantiated with this type, and it demands AVX-512; loads and
        // stores are of arrays of 16 words.
        unsafe {
            let planes = _mm512_loadu_ps(planes.as_ptr());
            let one = _mm512_set1_epi32(1);
            let zero = _mm512_setzero_si512();
            let (mut left, mut right, mut either) = (zero, zero, zero);
            for j in 0..count {
                let (lo, hi) = (_mm512_set1_ps(faces.lo[j]), _mm512_set1_ps(faces.hi[j]));
                let before = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(lo, planes);
                let behind = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(hi, planes);
                left = _mm512_mask_add_epi32(left, before, left, one);
                right = _mm512_mask_add_epi32(right, behind, right, one);
                either = _mm512_mask_add_epi32(either, before | behind, either, one);
            }
            _mm512_storeu_si512(out[0].as_mut_ptr().cast(), left);
            _mm512_storeu_si512(out[1].as_mut_ptr().cast(), right);
            _mm512_storeu_si512(out[2].as_mut_ptr().cast(), either);
        }
        out
    }
}
