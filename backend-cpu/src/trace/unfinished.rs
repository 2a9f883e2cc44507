//! Exact closest hits of a batch that are certain, until there are enough of them for their numbers to be found in vectors.

use splitplane_core::ray::Rays;

use super::batch::Answers;
#[cfg(not(target_family = "wasm"))]
use super::exact_hits::{FirstLanes, Meetings};
use super::sieve::CertainHit;
#[cfg(not(target_family = "wasm"))]
use crate::simd::MOST_LANES;
use crate::simd::Simd;

/// Certain hits without their numbers. A page would load what finds these in vectors: there it is done one by one.
pub(super) struct Unfinished {
    #[cfg(not(target_family = "wasm"))]
    of: Kept,
}

/// Those that wait.
#[cfg(not(target_family = "wasm"))]
struct Kept {
    count: usize,
    meetings: Meetings,
    /// The rays' places in the batch, and the triangles.
    indices: [usize; MOST_LANES],
    triangles: [u32; MOST_LANES],
}

#[cfg(target_family = "wasm")]
impl Unfinished {
    /// None.
    pub(super) fn new() -> Unfinished {
        Unfinished {}
    }

    /// Answers a ray.
    ///
    /// # Safety
    /// None is needed.
    pub(super) unsafe fn add<S: Simd>(
        &mut self,
        rays: &Rays<'_>,
        index: usize,
        hit: CertainHit<'_>,
        answers: &mut Answers<'_>,
    ) {
        answers.set(index, hit.hit(&rays.ray(index)));
    }

    /// Answers those that are left: none.
    ///
    /// # Safety
    /// None is needed.
    pub(super) unsafe fn finish<S: Simd>(&mut self, _: &mut Answers<'_>) {}
}

#[cfg(not(target_family = "wasm"))]
impl Unfinished {
    /// None.
    pub(super) fn new() -> Unfinished {
        let (indices, triangles) = ([0; MOST_LANES], [0; MOST_LANES]);
        Unfinished { of: Kept { count: 0, meetings: Meetings::NONE, indices, triangles } }
    }

    /// Takes the hit of a ray. Answers are set when there are enough of them.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn add<S: Simd>(
        &mut self,
        rays: &Rays<'_>,
        index: usize,
        hit: CertainHit<'_>,
        answers: &mut Answers<'_>,
    ) {
        let Kept { count, meetings, indices, triangles } = &mut self.of;
        let lane = *count % MOST_LANES;
        meetings.set(lane, &rays.ray(index), hit.corners);
        (indices[lane], triangles[lane]) = (index, hit.triangle);
        *count += 1;
        if *count == MOST_LANES {
            // SAFETY: the caller's contract.
            unsafe { self.finish::<S>(answers) };
        }
    }

    /// Answers those that are left.
    ///
    /// # Safety
    /// The processor must have the set.
    pub(super) unsafe fn finish<S: Simd>(&mut self, answers: &mut Answers<'_>) {
        use splitplane_core::ray::Hit;

        let Kept { count, meetings, indices, triangles } = &mut self.of;
        let count = core::mem::take(count);
        if count == 0 {
            return;
        }
        // SAFETY: the caller's contract.
        let numbers = unsafe { S::call(FirstLanes::<MOST_LANES>(meetings)) };
        for lane in 0..count {
            let triangle = triangles[lane];
            let hit = if numbers.known >> lane & 1 != 0 {
                Hit { t: numbers.t[lane], triangle, u: numbers.u[lane], v: numbers.v[lane] }
            } else {
                let (ray, corners) = meetings.of(lane);
                CertainHit { corners: &corners, triangle }.hit(&ray)
            };
            answers.set(indices[lane], hit);
        }
    }
}
