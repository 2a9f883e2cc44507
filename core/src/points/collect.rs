//! The k least keys of a stream.

use crate::points::distance::NOTHING;
use alloc::collections::TryReserveError;
use alloc::vec::Vec;

/// Up to this many keys are kept in order; beyond it they are gathered and selected.
const FEW: usize = 24;

/// Keeps the k least of the keys that it is given.
#[derive(Clone, Debug)]
pub struct Collector {
    k: usize,
    stop: u64,
    keys: Vec<u64>,
}

impl Collector {
    /// For k keys, of which there are at most `most`.
    ///
    /// # Errors
    /// No memory.
    pub fn new(k: usize, most: usize) -> Result<Collector, TryReserveError> {
        let k = k.min(most);
        let mut keys = Vec::new();
        keys.try_reserve_exact(room(k))?;
        Ok(Collector { k, stop: 0, keys })
    }

    /// Bytes of a collector for k keys.
    pub fn bytes(k: usize) -> u64 {
        (room(k) * size_of::<u64>()) as u64
    }

    /// Begins again. Keys from `stop` on do not count.
    pub fn begin(&mut self, stop: u64) {
        self.keys.clear();
        self.stop = if self.k == 0 { 0 } else { stop.min(NOTHING) };
    }

    /// Keys from here on do not count any more.
    #[inline(always)]
    pub fn stop(&self) -> u64 {
        self.stop
    }

    /// Adds a key, which must be below [`Collector::stop`].
    #[inline(always)]
    pub fn add(&mut self, key: u64) {
        if self.k == 1 {
            self.keys.clear();
            self.keys.push(key);
            self.stop = key;
        } else if self.k <= FEW {
            self.insert(key);
        } else {
            self.keys.push(key);
            if self.keys.len() == self.k || self.keys.len() == room(self.k) {
                self.select();
            }
        }
    }

    #[inline(always)]
    fn insert(&mut self, key: u64) {
        if self.keys.len() == self.k {
            self.keys.pop();
        }
        let mut place = self.keys.len();
        self.keys.push(key);
        while place > 0 && self.keys[place - 1] > key {
            self.keys[place] = self.keys[place - 1];
            place -= 1;
        }
        self.keys[place] = key;
        if self.keys.len() == self.k {
            self.stop = self.keys[self.k - 1];
        }
    }

    #[inline(never)]
    fn select(&mut self) {
        let (_, last, _) = self.keys.select_nth_unstable(self.k - 1);
        self.stop = *last;
        self.keys.truncate(self.k);
    }

    /// The keys found, in order.
    pub fn finish(&mut self) -> &[u64] {
        if self.k > FEW {
            self.keys.sort_unstable();
            self.keys.truncate(self.k);
        }
        &self.keys
    }
}

/// Keys that a collector holds.
fn room(k: usize) -> usize {
    if k <= FEW { k } else { k + k / 2 }
}
