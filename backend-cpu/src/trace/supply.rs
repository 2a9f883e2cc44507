//! Where the lanes of a batch get their rays: prepared by vectors, and traced in packets where they are coherent.

use splitplane_core::ray::{Accuracy, Hit, Ray, Rays};

use super::batch::{Answers, RayBatch};
use super::leaves::IndexedLeaves;
use super::packet::Packet;
use super::packet::bounds::ranges;
#[cfg(not(target_family = "wasm"))]
use super::packet::exact::TraceExactly;
use super::prepare::{CHUNK, PreparedRays, RECORD, numbers};
use super::ray_state::{RayState, ScalarOutcome};
use super::sieve::Reach;
use super::{exact, reference};
use crate::simd::{Simd, prefetch};

/// Whether exact rays take turns at all. In a browser each goes by itself in `f64` from the root on: what vectors take for it is more than a
/// part may weigh.
pub(super) const EXACT_IN_TURN: bool = !cfg!(target_family = "wasm");

/// Where lanes get their rays: prepared 32 at a time.
pub(super) struct Supply<'a> {
    pub batch: RayBatch<'a>,
    /// The first ray not yet prepared.
    pub next: usize,
    pub ready: &'a mut PreparedRays,
    pub ray_states: &'a mut [RayState; CHUNK],
    /// Rays of `ready` not yet handed out.
    pub left: u32,
    /// Those that the core has prepared.
    pub moved: u32,
    /// Of the others, the errors of the sieve ([`Reach::errors`]) where the accuracy is `exact`.
    pub errors: [[f32; 2]; 2],
    pub packet: &'a mut Packet,
}

impl Supply<'_> {
    /// The next ray that needs a lane, and whether the core has prepared it. Rays that miss the bounds, and those left to the scalar code,
    /// are answered on the way.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn next<S: Simd>(
        &mut self,
        answers: &mut Answers<'_>,
    ) -> Option<(&RayState, bool)> {
        while self.left == 0 {
            let RayBatch { scene, rays, options, query, .. } = self.batch;
            if self.next >= rays.len() {
                return None;
            }
            let start = self.next;
            let count = CHUNK.min(rays.len() - start);
            let rest = rays.part(start..rays.len());
            let (numbers, each) = numbers(&rest);
            for line in 0..CHUNK * RECORD * size_of::<f32>() / 64 {
                // Prefetch the rays after the next ones: batches are long, and read only once. (Of rows these are some more.)
                let rays = numbers.as_ptr().wrapping_add(2 * CHUNK * each);
                prefetch(rays.cast::<u8>().wrapping_add(64 * line));
            }
            // SAFETY: the caller's contract.
            unsafe { self.ready.fill::<S>(rest, scene, start, query) };
            self.next += count;
            let ready = &*self.ready;
            let shifts = u32::from(EXACT_IN_TURN && options.accuracy == Accuracy::Exact);
            let (mut special, mut alive) = (0, 0);
            for lane in 0..CHUNK {
                let within = u32::from(ready.enter[lane] <= ready.exit[lane]);
                special |= (ready.special[lane] | (ready.shifted[lane] & shifts)) << lane;
                alive |= (ready.alive[lane] & within) << lane;
            }
            let there = u32::MAX >> (CHUNK - count);
            self.left = alive & !special;
            self.moved = 0;
            let mut missing = there & !alive & !special;
            while missing != 0 {
                let lane = missing.trailing_zeros() as usize;
                missing &= missing - 1;
                answers.set(start + lane, Hit::MISS);
            }
            // SAFETY: the caller's contract.
            unsafe { self.packets::<S>(start, rest, answers) };
            if self.left != 0 {
                if shifts != 0 {
                    // SAFETY: the caller's contract.
                    self.errors = Reach::errors(unsafe { self.reach::<S>() });
                }
                // SAFETY: the caller's contract.
                unsafe { self.ready.ray_states::<S>(self.ray_states) };
            }
            special &= there;
            while special != 0 {
                let lane = special.trailing_zeros() as usize;
                special &= special - 1;
                match self.prepare_by_core(&rest.ray(lane)) {
                    ScalarOutcome::Traced(ray_state) => {
                        self.ray_states[lane] =
                            RayState { index: (start + lane) as u32, ..ray_state };
                        self.left |= 1 << lane;
                        self.moved |= 1 << lane;
                    }
                    ScalarOutcome::Answer(hit) => answers.set(start + lane, hit),
                }
            }
        }
        let lane = self.left.trailing_zeros() as usize;
        self.left &= self.left - 1;
        Some((&self.ray_states[lane], self.moved >> lane & 1 != 0))
    }

    /// The greatest distance along an axis of an origin of the rays that are left to any triangle, and to any that is not large.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn reach<S: Simd>(&self) -> [f32; 2] {
        let RayBatch { layout, scene, .. } = self.batch;
        // SAFETY: the caller's contract; rows have the lanes.
        let [least, most] = unsafe {
            let mut least = [S::splat(0.0); 3];
            for (axis, least) in least.iter_mut().enumerate() {
                *least = S::splat(scene.bounds.lo[axis]);
            }
            let mut most = least;
            for first in (0..CHUNK).step_by(S::N) {
                let left = S::mask(self.left >> first & (u32::MAX >> (32 - S::N)));
                for axis in 0..3 {
                    let row = S::load(self.ready.origin[axis].as_ptr().add(first));
                    // Of those that are not left anything may be there.
                    let origin = S::select(left, row, S::splat(scene.bounds.lo[axis]));
                    (least[axis], most[axis]) =
                        (S::min(least[axis], origin), S::max(most[axis], origin));
                }
            }
            ranges::<S, 3>(least, most)
        };
        let mut farthest = [0.0f32; 2];
        for axis in 0..3 {
            for (farthest, bounds) in farthest.iter_mut().zip([&scene.bounds, &layout.large.others])
            {
                let reach = (bounds.hi[axis] - least.0[axis]).max(most.0[axis] - bounds.lo[axis]);
                *farthest = farthest.max(reach);
            }
        }
        farthest
    }

    /// Answers the prepared rays that go the same way: all together, or as many as a vector has
    /// lanes.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn packets<S: Simd>(
        &mut self,
        start: usize,
        given: Rays<'_>,
        answers: &mut Answers<'_>,
    ) {
        let RayBatch { layout, scene, options, query, .. } = self.batch;
        let exactly = EXACT_IN_TURN && options.accuracy == Accuracy::Exact;
        #[cfg(target_family = "wasm")]
        let _ = given;
        // Packets test blocks in their stored form.
        if IndexedLeaves::of(layout).is_some() {
            return;
        }
        if exactly && !S::SPECIALISED || !exactly && !self.packet.is_worth_it::<S>() {
            return;
        }
        let sizes = if self.packet.keeps_together() { &[CHUNK, S::N][..] } else { &[S::N] };
        for &lanes in sizes {
            for first in (0..CHUNK).step_by(lanes) {
                let rays = self.left & (u32::MAX >> (CHUNK - lanes)) << first;
                let groups = first / S::N..(first + lanes) / S::N;
                let (start, mut group) = (start + first, groups.start);
                // SAFETY: the caller's contract; rays left to the scalar code are not in `left`.
                unsafe {
                    if !self.packet.take_coherent::<S>(self.ready, groups, rays, scene) {
                        continue;
                    }
                    #[cfg(not(target_family = "wasm"))]
                    if S::SPECIALISED && exactly {
                        S::call(TraceExactly {
                            packet: &mut *self.packet,
                            layout,
                            ready: &*self.ready,
                            ray_states: &mut *self.ray_states,
                            given,
                            groups: lanes / S::N,
                            bounds: [scene.bounds, layout.large.others],
                            options,
                            query,
                        });
                    }
                    let ready = (&*self.ready, &mut *self.ray_states);
                    match lanes / S::N {
                        _ if exactly => {}
                        2 if S::WIDE => self.packet.trace::<S, 2>(layout, ready, options, query),
                        4 if !S::WIDE => self.packet.trace::<S, 4>(layout, ready, options, query),
                        _ => self.packet.trace::<S, 1>(layout, ready, options, query),
                    }
                }
                self.left &= !rays;
                for start in (start..start + lanes).step_by(S::N) {
                    let here = (rays >> (group * S::N)) & (u32::MAX >> (32 - S::N));
                    // SAFETY: the caller's contract; the rays are the group's.
                    unsafe {
                        let group = (&*self.packet, group);
                        answers.set_group::<S>(start, here, group, options.accuracy);
                    }
                    group += 1;
                }
            }
        }
    }

    /// Prepares a ray that vectors did not prepare. The core moves one that starts far away, which is then traced like all
    /// others; the few that are left are traced alone.
    #[cold]
    fn prepare_by_core(&self, ray: &Ray) -> ScalarOutcome {
        let RayBatch { layout, scene, options, query, .. } = self.batch;
        RayState::prepare_by_core(ray, scene, options.accuracy, query).unwrap_or_else(|| {
            ScalarOutcome::Answer(if options.accuracy == Accuracy::Exact {
                exact::trace_in_f64(layout, &scene.bounds, ray, options, query)
            } else {
                reference::trace(layout, scene, ray, options, query)
            })
        })
    }
}
