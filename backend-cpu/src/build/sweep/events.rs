//! The sweep over sorted events (Wald and Havran 2006, Section 4.3).

use splitplane_core::arithmetic::ordered_bits;

use super::cost::{BestSplit, Cell, SplitCosts};

/// An event: a face of a reference's bounds. Sorts by position, then by kind.
pub(super) type Event = u64;

/// What a face is, in the order of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub(super) enum Face {
    /// The upper face.
    End = 0,
    /// Both faces of a reference without extent on the axis.
    Planar = 1,
    /// The lower face.
    Start = 2,
}

/// The event of a face.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn event(position: f32, face: Face) -> Event {
    u64::from(ordered_bits(position)) << 2 | face as u64
}

/// Where an event lies.
#[cfg_attr(not(unoptimised), inline(always))]
fn position(event: Event) -> f32 {
    let ordered = (event >> 2) as u32;
    f32::from_bits(if ordered >> 31 == 1 { ordered & 0x7fff_ffff } else { !ordered })
}

/// Sorts the events of a range of an axis and considers the plane of each. `started` references start
/// before the range, `unfinished` ones do not end before it; both count those planar.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn sweep(
    costs: &SplitCosts,
    cell: &Cell,
    axis: usize,
    events: &mut [Event],
    [mut started, mut unfinished]: [u32; 2],
    best: &mut BestSplit,
) {
    events.sort_unstable();
    let mut i = 0;
    while i < events.len() {
        let place = events[i] >> 2;
        let mut faces = [0; 4];
        while i < events.len() && events[i] >> 2 == place {
            faces[(events[i] & 3) as usize] += 1;
            i += 1;
        }
        let [ends, planar, starts, _] = faces;
        unfinished -= ends + planar;
        let position = position(events[i - 1]);
        if cell.contains(axis, position) {
            best.consider(costs, cell, axis, position, [started, planar, unfinished]);
        }
        started += starts + planar;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_sort_by_position_then_kind() {
        let sorted = [
            event(-2.0, Face::Start),
            event(-1.0, Face::End),
            event(-1.0, Face::Planar),
            event(-1.0, Face::Start),
            event(0.0, Face::End),
            event(3.0, Face::End),
        ];
        assert!(sorted.windows(2).all(|pair| pair[0] < pair[1]));
        for x in [-f32::MAX, -1.5, 0.0, f32::MIN_POSITIVE, 7.25, f32::MAX] {
            assert_eq!(position(event(x, Face::Planar)), x);
        }
    }
}
