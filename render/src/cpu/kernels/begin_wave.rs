//! Makes the next wave the current one; the executor exchanges the lists.

use crate::kernel::{CHUNK, Counter};
use crate::layout::Counters;

pub(crate) fn run(counters: &mut Counters) {
    let paths = counters[Counter::NextPaths];
    counters[Counter::Paths] = paths;
    counters[Counter::PathChunks] = paths.div_ceil(CHUNK);
    counters[Counter::NextPaths] = 0;
    counters[Counter::ShadowRays] = 0;
    counters[Counter::Wave] += 1;
}
