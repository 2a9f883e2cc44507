//! What crosses between host and device, counted.

use std::fmt;
use std::ops::Sub;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// What has crossed between host and device so far, and what was made there. The difference of two of these
/// is what happened in between.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Traffic {
    /// Pieces of memory that were sent to the device.
    pub uploads: u64,
    /// Bytes of them.
    pub bytes_up: u64,
    /// How often the host took bytes that the device had written. For each the host waits, or asks until the
    /// device is done: a round trip.
    pub readbacks: u64,
    /// Bytes that were copied for the host.
    pub bytes_down: u64,
    /// Buffers that were made.
    pub buffers: u64,
}

impl Sub for Traffic {
    type Output = Traffic;

    /// What has happened since `before`.
    fn sub(self, before: Traffic) -> Traffic {
        Traffic {
            uploads: self.uploads.wrapping_sub(before.uploads),
            bytes_up: self.bytes_up.wrapping_sub(before.bytes_up),
            readbacks: self.readbacks.wrapping_sub(before.readbacks),
            bytes_down: self.bytes_down.wrapping_sub(before.bytes_down),
            buffers: self.buffers.wrapping_sub(before.buffers),
        }
    }
}

/// The counters of a device, shared by its clones.
#[derive(Debug, Default)]
pub(super) struct Counted {
    uploads: AtomicU64,
    bytes_up: AtomicU64,
    readbacks: AtomicU64,
    bytes_down: AtomicU64,
    buffers: AtomicU64,
    /// Called when a buffer was made, where a test says so.
    observer: OnceLock<Observer>,
}

struct Observer(Box<dyn Fn() + Send + Sync>);

impl fmt::Debug for Observer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an observer")
    }
}

impl Counted {
    pub(super) fn upload(&self, bytes: u64) {
        self.uploads.fetch_add(1, Ordering::Relaxed);
        self.bytes_up.fetch_add(bytes, Ordering::Relaxed);
    }

    pub(super) fn readback(&self, bytes: u64) {
        self.readbacks.fetch_add(1, Ordering::Relaxed);
        self.bytes_down.fetch_add(bytes, Ordering::Relaxed);
    }

    pub(super) fn buffer(&self) {
        self.buffers.fetch_add(1, Ordering::Relaxed);
        if let Some(Observer(observer)) = self.observer.get() {
            observer();
        }
    }

    /// The first observer stays.
    pub(super) fn observe(&self, observer: impl Fn() + Send + Sync + 'static) {
        self.observer.get_or_init(|| Observer(Box::new(observer)));
    }

    pub(super) fn so_far(&self) -> Traffic {
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Traffic {
            uploads: read(&self.uploads),
            bytes_up: read(&self.bytes_up),
            readbacks: read(&self.readbacks),
            bytes_down: read(&self.bytes_down),
            buffers: read(&self.buffers),
        }
    }
}
