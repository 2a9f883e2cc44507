//! Whether packets pay for the rays that come.
//!
//! A block that some ray of a packet may meet costs the packet a test of the box by all of its rays, and of triangles that none of them meets. Where few
//! of the rays that come to a block together meet it, each by itself is faster: among triangles in all directions, whose boxes overlap. How many do is
//! known only from packets that were traced, so now and then some are, whatever became of those before.

/// Of a packet's lanes at a block as many as this must have a ray that meets it: one of four, in vectors of 16, where a step costs a ray alone little; one of three in
/// those of eight. A lane without a ray costs what others cost. Measured: docs/measurements/counts-2026-11-27.md.
const fn fewest_of(lanes: usize) -> u64 {
    if lanes == 16 { 4 } else { 3 }
}

/// Large packets pay where at least this many of so many meet it.
const TOGETHER: u64 = 2;
const TOGETHER_OF: u64 = 5;
/// Packets that come to fewer blocks than this pay anyhow: steps at nodes are shared.
const BLOCKS: u64 = 4;
/// So many lanes must have come to blocks before anything is known, and about as many times four are remembered.
const KNOWN: u64 = 1 << 11;
const REMEMBERED: u64 = 4 * KNOWN;
/// After this many times, what is known counts half.
const PASSED: u32 = 32;

/// What became of the latest packets.
#[derive(Clone, Copy, Default)]
pub(super) struct Worth {
    /// Lanes of packets, how many came to blocks, each counted once for each block, and how many met the block.
    taken: u64,
    came: u64,
    met: u64,
    /// How often packets were passed over since.
    passed: u32,
}

impl Worth {
    /// A packet of so many lanes begins.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn begins(&mut self, lanes: usize) {
        self.taken += lanes as u64;
        if self.came > REMEMBERED {
            self.halve();
        }
    }

    /// Of a packet's lanes that came to a block, so many met it.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn at_block(&mut self, came: usize, met: u32) {
        self.came += came as u64;
        self.met += u64::from(met);
    }

    /// Whether the next rays should go in packets.
    pub(super) fn packets_pay(&mut self, lanes: usize) -> bool {
        if self.came < KNOWN
            || self.came < BLOCKS * self.taken
            || self.met * fewest_of(lanes) >= self.came
        {
            return true;
        }
        self.passed += 1;
        if self.passed == PASSED {
            self.passed = 0;
            self.halve();
        }
        false
    }

    /// Whether rays have stayed together so far.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn keeps_together(&self) -> bool {
        self.met * TOGETHER_OF >= self.came * TOGETHER
    }

    fn halve(&mut self) {
        (self.taken, self.came, self.met) = (self.taken / 2, self.came / 2, self.met / 2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Packets of 16 rays that come to so many blocks, of whose rays so many meet each.
    fn packets(worth: &mut Worth, count: usize, blocks: usize, met: u32) -> usize {
        let mut traced = 0;
        for _ in 0..count {
            if worth.packets_pay(16) {
                traced += 1;
                worth.begins(16);
                (0..blocks).for_each(|_| worth.at_block(16, met));
            }
        }
        traced
    }

    #[test]
    fn packets_are_given_up_where_few_rays_meet_and_taken_up_again() {
        let mut worth = Worth::default();
        // Few meet: after some, one of sixteen or so is traced.
        let traced = packets(&mut worth, 10_000, 30, 2);
        assert!((200..1_000).contains(&traced), "{traced}");
        // Enough meet: after a few times 32 all are.
        let traced = packets(&mut worth, 1_000, 30, 6);
        assert!((800..1_000).contains(&traced), "{traced}");
        assert_eq!(packets(&mut worth, 1_000, 30, 16), 1_000);
        // Few, but at few blocks.
        let mut worth = Worth::default();
        assert_eq!(packets(&mut worth, 10_000, 3, 1), 10_000);
        // None at all.
        assert_eq!(packets(&mut Worth::default(), 10_000, 0, 0), 10_000);
    }
}
