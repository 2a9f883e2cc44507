//! Outputs of a frame that come back together with its counters, in one buffer.

use crate::kernel::Buffer;
use crate::layout::Counters;
use crate::plan::Plan;
use std::ops::Range;

/// Bytes of the counters, which come first.
pub(super) const COUNTERS: u64 = size_of::<Counters>() as u64;

/// The outputs that a plan has been asked for, and where each lies behind the counters.
pub(super) fn outputs(plan: &Plan) -> impl Iterator<Item = (Buffer, Range<u64>)> + use<> {
    let wanted = plan.outputs();
    let all = [
        (wanted.pixels, Buffer::Pixels),
        (wanted.radiance, Buffer::Radiance),
        (wanted.first_hits, Buffer::FirstHits),
        (wanted.first_costs, Buffer::FirstCosts),
    ];
    let plan = *plan;
    let mut at = COUNTERS;
    all.into_iter().filter(|(wanted, _)| *wanted).map(move |(_, buffer)| {
        let start = at;
        at += plan.bytes(buffer);
        (buffer, start..at)
    })
}

/// Bytes of counters and outputs.
pub(super) fn bytes(plan: &Plan) -> u64 {
    outputs(plan).last().map_or(COUNTERS, |(_, place)| place.end)
}

/// What the last frame brought along, in memory that is used again.
#[derive(Debug, Default)]
pub(super) struct Brought {
    words: Vec<u32>,
    plan: Option<Plan>,
}

impl Brought {
    /// Nothing was brought along.
    pub(super) fn clear(&mut self) {
        self.plan = None;
    }

    /// Takes over what came back: counters and all outputs of a plan.
    pub(super) fn take(&mut self, plan: &Plan, bytes: &[u8]) {
        self.words.clear();
        let (words, _) = bytes.as_chunks::<4>();
        self.words.extend(words.iter().map(|word| u32::from_ne_bytes(*word)));
        self.plan = Some(*plan);
    }

    /// The words of an output; `None` where it did not come along.
    pub(super) fn words(&self, buffer: Buffer) -> Option<&[u32]> {
        let plan = self.plan.as_ref()?;
        let (_, place) = outputs(plan).find(|(held, _)| *held == buffer)?;
        self.words.get(place.start as usize / 4..place.end as usize / 4)
    }
}
