//! Takes the next slice of the picture.

use crate::kernel::{CHUNK, Counter};
use crate::layout::{Counters, Frame};

pub(crate) fn run(frame: &Frame, counters: &mut Counters) {
    let left = counters[Counter::PixelsLeft];
    let taken = left.min(frame.slice_pixels);
    let paths = taken * frame.samples;
    counters[Counter::FirstPixel] = counters[Counter::Pixels] - left;
    counters[Counter::PixelsLeft] = left - taken;
    counters[Counter::Wave] = 0;
    counters[Counter::Paths] = paths;
    counters[Counter::PathChunks] = paths.div_ceil(CHUNK);
    counters[Counter::NextPaths] = 0;
    counters[Counter::ShadowRays] = 0;
    add(counters, Counter::TotalPathsLow, Counter::TotalPathsHigh, paths);
}

/// Adds to a sum of two words.
pub(crate) fn add(counters: &mut Counters, low: Counter, high: Counter, number: u32) {
    let (sum, carry) = counters[low].overflowing_add(number);
    counters[low] = sum;
    counters[high] += u32::from(carry);
}
