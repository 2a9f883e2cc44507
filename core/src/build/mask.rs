//! Sets of the triangles of a small root: 64 bits as two words, since WGSL has no portable `u64`.

use bytemuck::{Pod, Zeroable};
use core::ops::{BitAnd, BitOr, Not};

/// A set of up to 64 triangles of one small root (Zhou et al. 2008, small-node stage).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct TriangleMask {
    /// Triangles 0 to 31, lowest bit first.
    pub low: u32,
    /// Triangles 32 to 63.
    pub high: u32,
}

impl TriangleMask {
    /// No triangle.
    pub const EMPTY: TriangleMask = TriangleMask { low: 0, high: 0 };

    /// The first `count` triangles; all 64 from 64 up (a shift by the width would be undefined).
    pub const fn first(count: u32) -> TriangleMask {
        const fn word(count: u32) -> u32 {
            if count >= 32 { u32::MAX } else { (1 << count) - 1 }
        }
        TriangleMask { low: word(count), high: if count > 32 { word(count - 32) } else { 0 } }
    }

    /// The same set as one 64-bit word.
    #[inline]
    pub const fn bits(self) -> u64 {
        self.low as u64 | (self.high as u64) << 32
    }

    /// The set with these bits.
    #[inline]
    pub const fn from_bits(bits: u64) -> TriangleMask {
        TriangleMask { low: bits as u32, high: (bits >> 32) as u32 }
    }

    /// How many triangles are in the set.
    #[inline]
    pub const fn count(self) -> u32 {
        self.low.count_ones() + self.high.count_ones()
    }

    /// True when triangle `index` is in the set.
    #[inline]
    pub const fn contains(self, index: u32) -> bool {
        let word = if index < 32 { self.low } else { self.high };
        word >> (index & 31) & 1 == 1
    }

    /// The set with triangle `index` added.
    #[inline]
    #[must_use]
    pub const fn with(self, index: u32) -> TriangleMask {
        TriangleMask::from_bits(self.bits() | 1 << (index & 63))
    }

    /// The triangles of the set, lowest first.
    pub fn iter(self) -> impl Iterator<Item = u32> {
        let mut rest = self.bits();
        core::iter::from_fn(move || {
            if rest == 0 {
                return None;
            }
            let index = rest.trailing_zeros();
            rest &= rest - 1;
            Some(index)
        })
    }
}

impl BitAnd for TriangleMask {
    type Output = TriangleMask;
    fn bitand(self, other: TriangleMask) -> TriangleMask {
        TriangleMask { low: self.low & other.low, high: self.high & other.high }
    }
}

impl BitOr for TriangleMask {
    type Output = TriangleMask;
    fn bitor(self, other: TriangleMask) -> TriangleMask {
        TriangleMask { low: self.low | other.low, high: self.high | other.high }
    }
}

impl Not for TriangleMask {
    type Output = TriangleMask;
    fn not(self) -> TriangleMask {
        TriangleMask { low: !self.low, high: !self.high }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_counts_and_holds_the_first() {
        for count in 0..=64 {
            let mask = TriangleMask::first(count);
            assert_eq!(mask.count(), count);
            assert!(mask.iter().eq(0..count));
            assert!((0..64).all(|i| mask.contains(i) == (i < count)));
        }
    }

    #[test]
    fn masks_that_share_bits_join_and_meet() {
        let (a, b) = (TriangleMask::first(40), !TriangleMask::first(20));
        assert!((a | b).iter().eq(0..64) && (a & b).iter().eq(20..40));
        assert!((a | a).iter().eq(0..40) && (a & a).iter().eq(0..40));
        assert_eq!((a & !a).count(), 0);
    }

    #[test]
    fn words_and_bits_agree() {
        let mask = TriangleMask::EMPTY.with(3).with(40);
        assert_eq!(mask.bits(), 1 << 3 | 1 << 40);
        assert_eq!(TriangleMask::from_bits(mask.bits()), mask);
        assert_eq!((mask & TriangleMask::first(32)).count(), 1);
        assert_eq!((mask | TriangleMask::first(2)).count(), 4);
        assert_eq!((!mask).count(), 62);
    }
}
