//! The blocks that tasks pack, within a limit on the memory of all.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

use crate::layout::pack::MOST_WORDS;

/// Words that a triangle takes at first guess.
const GUESS: usize = 6;

/// The blocks of a task's leaves.
#[derive(Debug, Default)]
pub(crate) struct PackedWords {
    pub(super) words: Vec<u32>,
    pub(super) used: usize,
    room: usize,
    /// Whether a limit on memory was met: then the words are not kept, and `used` and `room` tell what there
    /// would be.
    lost: bool,
}

/// Memory that tasks take at the same time.
pub(super) struct Budget {
    /// Bytes held.
    pub(super) held: AtomicU64,
    pub(super) limit: u64,
    /// Whether there was less memory than the limit allows.
    pub(super) failed: AtomicBool,
}

impl Budget {
    /// Accounts for `bytes` more and returns whether they are within the limit.
    fn take(&self, bytes: u64) -> bool {
        self.held.fetch_add(bytes, Relaxed) + bytes <= self.limit
    }
}

impl PackedWords {
    /// Empties the list for another task.
    pub(super) fn begin(&mut self) {
        (self.used, self.room, self.lost) = (0, self.words.len(), false);
    }

    /// Space for one more block. Where there is too little, it grows to hold `triangles` triangles.
    /// `None` where there is no memory for that, which the budget records.
    pub(super) fn next(&mut self, triangles: usize, budget: &Budget) -> Option<&mut [u32]> {
        if self.used + MOST_WORDS > self.room {
            let needed = self.used + MOST_WORDS + GUESS * triangles;
            let more = needed.max(self.room + self.room / 2) - self.room;
            self.lost |= !budget.take((more * size_of::<u32>()) as u64);
            self.room += more;
            // Where there is no memory for the blocks, all are written to the space of one.
            let room = if self.lost { self.words.len().max(MOST_WORDS) } else { self.room };
            if self.words.try_reserve_exact(room - self.words.len()).is_err() {
                budget.failed.store(true, Relaxed);
                return None;
            }
            self.words.resize(room, 0);
        }
        let at = if self.lost { 0 } else { self.used };
        Some(&mut self.words[at..])
    }

    /// Its words.
    pub(crate) fn words(&self) -> &[u32] {
        &self.words[..self.used]
    }
}
