//! How many rays a submission takes: as many as suit the device.

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// Rays of the first submission, before it is known how fast the device is: a software rasteriser
/// takes a second for them where a GPU takes microseconds.
const FIRST_RAYS: u32 = 1 << 13;
/// Most rays of the first submission of a later batch, whose rays may be slower than those before.
const MOST_FIRST_RAYS: u32 = 1 << 17;
/// Fewest rays of a submission, however slow the device.
const LEAST_RAYS: u32 = 1 << 10;
/// A slice that takes longer is followed by one of half the rays: drivers end submissions that take
/// seconds, and a later slice may hold slower rays.
const TOO_LONG: Duration = Duration::from_millis(250);
/// A slice that takes less is followed by one of four times the rays.
const SHORT: Duration = Duration::from_millis(30);

/// Rays of the first slice of the next batch: what suited the device lately.
#[derive(Debug)]
pub(super) struct SliceRays(AtomicU32);

impl Default for SliceRays {
    fn default() -> SliceRays {
        SliceRays(AtomicU32::new(FIRST_RAYS))
    }
}

impl SliceRays {
    /// Most rays of a submission. At a few hundred million rays a second this takes milliseconds.
    pub(super) const MOST: u32 = 1 << 20;

    /// Rays of the first slice of a batch whose slices have at most this many.
    pub(super) fn first(&self, most: u32) -> u32 {
        self.0.load(Ordering::Relaxed).min(most)
    }

    /// Rays of the slice after one of `size` rays that took so long.
    pub(super) fn after(size: u32, took: Duration, most: u32) -> u32 {
        if took > TOO_LONG {
            (size / 2).max(LEAST_RAYS.min(most))
        } else if took < SHORT {
            size.saturating_mul(4).min(most)
        } else {
            size
        }
    }

    /// Keeps the size that a batch ended with for the next one.
    pub(super) fn keep(&self, size: u32) {
        self.0.store(size.min(MOST_FIRST_RAYS), Ordering::Relaxed);
    }
}
