//! `scan_middle`: one workgroup.
//!
//! Reads: what the middle roots have counted. Writes: the places of their leaves and references; the lengths of both lists.

use splitplane_core::build::reference::kernels as reference;
use splitplane_core::config::BuildConfig;
use splitplane_core::layout::{Counters, MiddleRoot};

/// Runs the kernel.
pub(crate) fn run(config: &BuildConfig, middle_roots: &mut [MiddleRoot], counters: &mut Counters) {
    reference::scan_middle(config, middle_roots, counters);
}
