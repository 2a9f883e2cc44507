//! XXH64, the hash that names trees and guards files.

use core::fmt;

/// A 64-bit name of some bytes; prints as 16 hexadecimal digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Digest(pub u64);

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

const PRIME_1: u64 = 0x9e37_79b1_85eb_ca87;
const PRIME_2: u64 = 0xc2b2_ae3d_27d4_eb4f;
const PRIME_3: u64 = 0x1656_67b1_9e37_79f9;
const PRIME_4: u64 = 0x85eb_ca77_c2b2_ae63;
const PRIME_5: u64 = 0x27d4_eb2f_1656_67c5;

/// Streaming XXH64 after the xxHash specification (Collet). Not cryptographic: it detects
/// accidents, not forgeries.
#[derive(Clone, Debug)]
pub struct Xxh64 {
    lanes: [u64; 4],
    seed: u64,
    length: u64,
    pending: [u8; 32],
    filled: usize,
}

impl Xxh64 {
    /// An empty hash with this seed.
    pub const fn new(seed: u64) -> Xxh64 {
        Xxh64 {
            lanes: [
                seed.wrapping_add(PRIME_1).wrapping_add(PRIME_2),
                seed.wrapping_add(PRIME_2),
                seed,
                seed.wrapping_sub(PRIME_1),
            ],
            seed,
            length: 0,
            pending: [0; 32],
            filled: 0,
        }
    }

    /// Adds bytes.
    pub fn write(&mut self, mut bytes: &[u8]) {
        self.length = self.length.wrapping_add(bytes.len() as u64);
        if self.filled > 0 {
            let take = bytes.len().min(32 - self.filled);
            self.pending[self.filled..self.filled + take].copy_from_slice(&bytes[..take]);
            self.filled += take;
            bytes = &bytes[take..];
            if self.filled < 32 {
                return;
            }
            let stripe = self.pending;
            self.stripe(&stripe);
            self.filled = 0;
        }
        let mut stripes = bytes.chunks_exact(32);
        for stripe in &mut stripes {
            self.stripe(stripe.try_into().unwrap_or(&[0; 32]));
        }
        let rest = stripes.remainder();
        self.pending[..rest.len()].copy_from_slice(rest);
        self.filled = rest.len();
    }

    /// Adds 32-bit words as little-endian bytes.
    pub fn write_words(&mut self, words: &[u32]) {
        if cfg!(target_endian = "little") {
            self.write(bytemuck::cast_slice(words));
        } else {
            for word in words {
                self.write(&word.to_le_bytes());
            }
        }
    }

    /// The hash of all bytes added.
    pub fn finish(&self) -> u64 {
        let mut hash = if self.length >= 32 {
            let [a, b, c, d] = self.lanes;
            let mut hash = a
                .rotate_left(1)
                .wrapping_add(b.rotate_left(7))
                .wrapping_add(c.rotate_left(12))
                .wrapping_add(d.rotate_left(18));
            for lane in self.lanes {
                hash = (hash ^ round(0, lane)).wrapping_mul(PRIME_1).wrapping_add(PRIME_4);
            }
            hash
        } else {
            self.seed.wrapping_add(PRIME_5)
        };
        hash = hash.wrapping_add(self.length);
        let mut rest = &self.pending[..self.filled];
        while let Some((word, tail)) = rest.split_first_chunk::<8>() {
            hash ^= round(0, u64::from_le_bytes(*word));
            hash = hash.rotate_left(27).wrapping_mul(PRIME_1).wrapping_add(PRIME_4);
            rest = tail;
        }
        if let Some((word, tail)) = rest.split_first_chunk::<4>() {
            hash ^= u64::from(u32::from_le_bytes(*word)).wrapping_mul(PRIME_1);
            hash = hash.rotate_left(23).wrapping_mul(PRIME_2).wrapping_add(PRIME_3);
            rest = tail;
        }
        for &byte in rest {
            hash ^= u64::from(byte).wrapping_mul(PRIME_5);
            hash = hash.rotate_left(11).wrapping_mul(PRIME_1);
        }
        hash ^= hash >> 33;
        hash = hash.wrapping_mul(PRIME_2);
        hash ^= hash >> 29;
        hash = hash.wrapping_mul(PRIME_3);
        hash ^ (hash >> 32)
    }

    fn stripe(&mut self, stripe: &[u8; 32]) {
        for (lane, word) in self.lanes.iter_mut().zip(stripe.as_chunks::<8>().0) {
            *lane = round(*lane, u64::from_le_bytes(*word));
        }
    }
}

fn round(lane: u64, word: u64) -> u64 {
    lane.wrapping_add(word.wrapping_mul(PRIME_2)).rotate_left(31).wrapping_mul(PRIME_1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hash(bytes: &[u8], seed: u64) -> u64 {
        let mut state = Xxh64::new(seed);
        state.write(bytes);
        state.finish()
    }

    /// Values published with the algorithm and its ports.
    #[test]
    fn published_values() {
        assert_eq!(hash(b"", 0), 0xef46_db37_51d8_e999);
        assert_eq!(hash(b"a", 0), 0xd24e_c4f1_a98c_6e5b);
        assert_eq!(hash(b"abc", 0), 0x44bc_2cf5_ad77_0999);
        assert_eq!(hash(b"Nobody inspects the spammish repetition", 0), 0xfbce_a83c_8a37_8bf1);
    }

    /// By the reference implementation, xxHash 0.8: of every way to end, with and without whole stripes.
    #[test]
    fn reference_values() {
        let bytes: [u8; 199] = core::array::from_fn(|i| (i * 7) as u8);
        for (length, expected) in [
            (1, 0x72b1_2317_e8a8_b952),
            (2, 0x727a_fe16_5a81_6e13),
            (3, 0xd2c8_306f_8e36_b5d3),
            (4, 0xed9e_fa0f_8128_3bb0),
            (5, 0xa4fd_9d1e_c934_a44b),
            (8, 0xda3b_3b36_c13e_acd3),
            (9, 0xbc06_a480_6a95_abbc),
            (12, 0xa49a_b73e_8e5f_63d0),
            (15, 0xcfe9_d022_7cea_8c31),
            (16, 0x0a15_9d01_6d70_c24c),
            (31, 0xef72_4477_78be_814f),
            (32, 0x1147_8bb5_d3aa_c371),
            (33, 0xef95_605f_a43c_b760),
            (63, 0x94c0_64fd_81f3_e379),
            (64, 0xfa6b_f718_7ea4_898a),
            (96, 0x9936_a724_ba14_02f7),
            (100, 0x44e7_dcf2_a6c8_0314),
            (199, 0x0b5d_2c05_3589_92d9),
        ] {
            assert_eq!(hash(&bytes[..length], 5), expected, "{length}");
        }
        let mut state = Xxh64::new(5);
        state.write_words(&[0x150e_0700, 0x312a_231c, 0x4d46_3f38]);
        assert_eq!(state.finish(), hash(&bytes[..12], 5));
    }

    #[test]
    fn pieces_equal_the_whole() {
        let bytes: [u8; 199] = core::array::from_fn(|i| (i * 7) as u8);
        for cut in 0..bytes.len() {
            let mut state = Xxh64::new(5);
            state.write(&bytes[..cut]);
            state.write(&bytes[cut..]);
            assert_eq!(state.finish(), hash(&bytes, 5));
        }
    }
}
