//! A batch of rays, and where its answers go.

use splitplane_core::query::intersect::SceneScale;
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Rays};

use super::packet::Packet;
use crate::layout::tree_layout::TreeLayout;
use crate::simd::Simd;

/// The tree and the settings by which a batch is traced.
#[derive(Clone, Copy)]
pub(crate) struct RayBatch<'a> {
    pub layout: &'a TreeLayout,
    pub scene: &'a SceneScale,
    pub rays: Rays<'a>,
    pub options: &'a QueryOptions<'a>,
    pub query: Query,
}

/// Where the answers of a batch go, ray by ray.
pub(crate) enum Answers<'a> {
    Hits(&'a mut [Hit]),
    /// Whether there is one.
    Any(&'a mut [bool]),
}

impl Answers<'_> {
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn set(&mut self, index: usize, hit: Hit) {
        match self {
            Answers::Hits(hits) => hits[index] = hit,
            Answers::Any(any) => any[index] = hit.is_hit(),
        }
    }
}

impl Answers<'_> {
    /// Sets the answers of some rays of a packet's group, the first of which is at `start`.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn set_group<S: Simd>(
        &mut self,
        start: usize,
        mut rays: u32,
        (packet, group): (&Packet, usize),
        accuracy: Accuracy,
    ) {
        let all = rays == u32::MAX >> (32 - S::N);
        match self {
            Answers::Hits(answers) => {
                // SAFETY: the caller's contract.
                let hits = unsafe { packet.hits::<S>(group, accuracy) };
                if all {
                    answers[start..start + S::N].copy_from_slice(&hits[..S::N]);
                    return;
                }
                while rays != 0 {
                    let lane = rays.trailing_zeros() as usize;
                    rays &= rays - 1;
                    answers[start + lane] = hits[lane];
                }
            }
            Answers::Any(answers) => {
                if all {
                    let answers = &mut answers[start..start + S::N];
                    for (lane, answer) in answers.iter_mut().enumerate() {
                        *answer = packet.is_hit(group, lane);
                    }
                    return;
                }
                while rays != 0 {
                    let lane = rays.trailing_zeros() as usize;
                    rays &= rays - 1;
                    answers[start + lane] = packet.is_hit(group, lane);
                }
            }
        }
    }
}
