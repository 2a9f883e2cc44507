//! What was counted: of a dispatch, of a kernel.

use std::ops::AddAssign;

use serde::Serialize;

/// Words of the buffer that invocations count in.
pub(crate) const WORDS: usize = 26;

/// Invocations that hardware runs in step: as long as the longest of them.
pub(crate) const LANES_IN_STEP: u32 = 32;

/// What the invocations of a dispatch did, or of several. `longest_*` are of one invocation, of each dispatch the
/// longest: over several dispatches their sum, since each waits for the one before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Tally {
    pub dispatches: u64,
    pub workgroups: u64,
    /// Workgroups that had something to do: a loop that ends at once is a round.
    pub busy: u64,
    /// How often an invocation entered the body of a loop, the last time included, when the loop ends.
    pub rounds: u64,
    pub operations: u64,
    /// Loads from buffers.
    pub loads: u64,
    /// Operations of groups of [`LANES_IN_STEP`] invocations, of each the longest invocation's.
    pub in_step: u64,
    /// The same of busy workgroups alone.
    pub busy_operations: u64,
    pub busy_loads: u64,
    pub busy_in_step: u64,
    /// Barriers that workgroups met.
    pub barriers: u64,
    pub longest_rounds: u64,
    pub longest_operations: u64,
    pub longest_loads: u64,
    pub longest_barriers: u64,
    /// Bytes of lists: by the table of kernels, and by the shaders where no counter tells how long a list is.
    pub read: u64,
    pub written: u64,
}

impl Tally {
    /// One dispatch, from the words that it left.
    pub(crate) fn of_words(words: &[u32]) -> Tally {
        let word = |at: usize| u64::from(words[at]);
        let long = |at: usize| word(at) | word(at + 1) << 32;
        Tally {
            dispatches: 1,
            workgroups: word(0),
            busy: word(1),
            rounds: long(2),
            operations: long(4),
            loads: long(6),
            in_step: long(8),
            barriers: long(10),
            busy_operations: long(16),
            busy_loads: long(18),
            busy_in_step: long(20),
            longest_rounds: word(12),
            longest_operations: word(13),
            longest_loads: word(14),
            longest_barriers: word(15),
            read: 4 * long(22),
            written: 4 * long(24),
        }
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.read + self.written
    }
}

impl AddAssign for Tally {
    fn add_assign(&mut self, other: Tally) {
        let Tally {
            dispatches,
            workgroups,
            busy,
            rounds,
            operations,
            loads,
            in_step,
            busy_operations,
            busy_loads,
            busy_in_step,
            barriers,
            longest_rounds,
            longest_operations,
            longest_loads,
            longest_barriers,
            read,
            written,
        } = other;
        self.dispatches += dispatches;
        self.workgroups += workgroups;
        self.busy += busy;
        self.rounds += rounds;
        self.operations += operations;
        self.loads += loads;
        self.in_step += in_step;
        self.busy_operations += busy_operations;
        self.busy_loads += busy_loads;
        self.busy_in_step += busy_in_step;
        self.barriers += barriers;
        self.longest_rounds += longest_rounds;
        self.longest_operations += longest_operations;
        self.longest_loads += longest_loads;
        self.longest_barriers += longest_barriers;
        self.read += read;
        self.written += written;
    }
}

/// A kernel with what it did in each of its dispatches.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Counted {
    pub kernel: &'static str,
    /// The shader that does its work.
    pub text: &'static str,
    pub lanes: u32,
    pub dispatches: Vec<Tally>,
}

impl Counted {
    pub(crate) fn all(&self) -> Tally {
        let mut all = Tally::default();
        self.dispatches.iter().for_each(|one| all += *one);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_joined_and_dispatches_add_up() {
        let mut words: Vec<u32> = (100..100 + WORDS as u32).collect();
        words[3] = 1;
        let one = Tally::of_words(&words);
        assert_eq!((one.rounds, one.barriers), (102 | 1 << 32, 110 | 111 << 32));
        let kernel = Counted { kernel: "k", text: "k", lanes: 64, dispatches: vec![one; 3] };
        let all = kernel.all();
        assert_eq!((all.dispatches, all.longest_rounds, all.busy), (3, 3 * 112, 303));
        assert_eq!(all.rounds, 3 * one.rounds);
    }
}
