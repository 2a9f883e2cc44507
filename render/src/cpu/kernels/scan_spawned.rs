//! Scans the numbers of rays that chunks ask for.

use super::begin_slice::add;
use crate::kernel::{Counter, Overflow};
use crate::layout::{Counters, Frame, Spawned};

pub(crate) fn run(frame: &Frame, spawned: &mut [Spawned], counters: &mut Counters) {
    let mut before = Spawned::default();
    for chunk in spawned {
        let here = *chunk;
        *chunk = before;
        before.shadow_rays += here.shadow_rays;
        before.next_paths += here.next_paths;
    }
    if before.next_paths > frame.path_room {
        counters[Counter::Overflow] |= Overflow::Paths as u32;
    }
    if before.shadow_rays > frame.shadow_room {
        counters[Counter::Overflow] |= Overflow::ShadowRays as u32;
    }
    let shadow_rays = before.shadow_rays.min(frame.shadow_room);
    let next_paths = before.next_paths.min(frame.path_room);
    counters[Counter::ShadowRays] = shadow_rays;
    counters[Counter::NextPaths] = next_paths;
    add(counters, Counter::TotalPathsLow, Counter::TotalPathsHigh, next_paths);
    add(counters, Counter::TotalShadowRaysLow, Counter::TotalShadowRaysHigh, shadow_rays);
}
