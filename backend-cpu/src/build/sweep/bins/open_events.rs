//! The events in open bins: counted, and put where those of each bin belong.

use splitplane_core::layout::Reference;

use super::{Open, OpenNumbers};
use crate::build::sweep::events::{Event, Face, event};
use crate::build::sweep::grid::FaceBins;
use crate::build::sweep::matches::Ranges;
use crate::simd::every_set::for_every_set;

/// In place of the upper face of a planar reference: sorted after all events.
const NOTHING: Event = Event::MAX;

/// The event of a reference's face, by word; none for the upper face of one that is planar.
#[cfg_attr(not(unoptimised), inline(always))]
fn event_of(reference: &Reference, word: usize) -> Option<Event> {
    let axis = word % 4;
    let (lo, hi) = (reference.lo[axis], reference.hi[axis]);
    if word < 4 {
        Some(event(lo, if lo == hi { Face::Planar } else { Face::Start }))
    } else {
        (lo != hi).then(|| event(hi, Face::End))
    }
}

for_every_set! {
    /// Collects the events in open bins, bin by bin.
    pub(super) fn gather<S>(
        ranges: &Ranges,
        references: &[Reference],
        places: &[FaceBins],
        numbers: &OpenNumbers,
        open: &mut [Open],
        events: &mut [Event],
    ) -> () {
        ranges.search::<S>(places, |reference, word| {
            let number = numbers[word % 4][usize::from(places[reference][word])];
            if let Some(open) = open.get_mut(number as usize)
                && let Some(event) = event_of(&references[reference], word)
            {
                events[open.end as usize] = event;
                open.end += 1;
            }
        });
    }
}

for_every_set! {
    /// Counts the events in each open bin. Returns how many there are in all.
    pub(super) fn count_events<S>(
        ranges: &Ranges,
        places: &[FaceBins],
        numbers: &OpenNumbers,
        counts: &mut [u32],
    ) -> u32 {
        let mut all = 0;
        ranges.search::<S>(places, |reference, word| {
            let number = numbers[word % 4][usize::from(places[reference][word])];
            if let Some(count) = counts.get_mut(number as usize) {
                *count += 1;
                all += 1;
            }
        });
        all
    }
}

for_every_set! {
    /// Puts the events in open bins where those of each bin end so far.
    pub(super) fn place_events<S>(
        ranges: &Ranges,
        references: &[Reference],
        places: &[FaceBins],
        numbers: &OpenNumbers,
        ends: &mut [u32],
        events: &mut [Event],
    ) -> () {
        ranges.search::<S>(places, |reference, word| {
            let number = numbers[word % 4][usize::from(places[reference][word])];
            if let Some(end) = ends.get_mut(number as usize) {
                // Both faces of a planar reference are one event.
                events[*end as usize] = event_of(&references[reference], word).unwrap_or(NOTHING);
                *end += 1;
            }
        });
    }
}
