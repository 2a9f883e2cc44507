//! Batches that are timed.

use crate::paper::timing::timed;
use crate::trade::TradeError;
use splitplane_core::backend::Accelerator;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::watch::Watch;

/// Milliseconds to trace rays, as one batch from and to host memory, and how many they are. `any` asks only whether
/// something is hit.
pub(super) fn trace(
    tree: &dyn Accelerator,
    rays: &[Ray],
    any: bool,
    accuracy: Accuracy,
    watch: &dyn Watch,
) -> Result<(f64, usize), TradeError> {
    let options = QueryOptions { accuracy, watch: Some(watch), ..QueryOptions::default() };
    let (traced, ms) = if any {
        let mut stopped = vec![false; rays.len()];
        timed(|| tree.any_hits(rays, &mut stopped, &options))
    } else {
        let mut hits = vec![Hit::MISS; rays.len()];
        timed(|| tree.closest_hits(rays, &mut hits, &options))
    };
    traced?;
    Ok((ms, rays.len()))
}
