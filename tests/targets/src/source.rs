//! Choices from bytes.

use arbitrary::Unstructured;

/// Floats that readers, builders and queries trip over.
const ODD: [f32; 28] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    -f32::MIN_POSITIVE,
    // Around the least normal number, and the least of all.
    1.175_494_2e-38,
    -1.175_494_2e-38,
    1e-45,
    -1e-45,
    1e-40,
    3e-39,
    1e38,
    -2e38,
    1.7e38,
    1e-30,
    1e30,
    1e19,
    -1e19,
    2.75e11,
    16_777_216.0,
    1.000_000_1,
    8.6e-19,
];

/// Bytes as choices. When they run out, every choice is the first one.
pub struct Source<'a>(Unstructured<'a>);

impl<'a> Source<'a> {
    /// Choices from these bytes.
    pub fn new(bytes: &'a [u8]) -> Source<'a> {
        Source(Unstructured::new(bytes))
    }

    /// True when no bytes are left.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All bytes that are left.
    pub fn rest(&mut self) -> &'a [u8] {
        let length = self.0.len();
        self.0.bytes(length).unwrap_or_default()
    }

    /// Up to so many bytes.
    pub fn bytes(&mut self, most: usize) -> &'a [u8] {
        let length = self.below(most + 1).min(self.0.len());
        self.0.bytes(length).unwrap_or_default()
    }

    /// Below `n`, which must not be 0.
    pub fn below(&mut self, n: usize) -> usize {
        self.0.int_in_range(0..=n - 1).unwrap_or(0)
    }

    /// True once in `n`; never when the bytes have run out.
    pub fn once_in(&mut self, n: usize) -> bool {
        self.below(n) == n - 1
    }

    /// Any 32 bits.
    pub fn bits(&mut self) -> u32 {
        self.0.arbitrary().unwrap_or(0)
    }

    /// Any 64 bits.
    pub fn long(&mut self) -> u64 {
        self.0.arbitrary().unwrap_or(0)
    }

    /// One of the items.
    pub fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.below(items.len())]
    }

    /// A number of a coarse grid around 0, where many come out equal.
    pub fn step(&mut self) -> f32 {
        (self.below(17) as f32 - 8.0) * 0.25
    }

    /// Any float: most from a coarse grid, some odd, some of another magnitude, some of any bits.
    pub fn number(&mut self) -> f32 {
        match self.below(16) {
            0..8 => self.step(),
            8..11 => self.pick(&ODD),
            11..13 => self.step() * (self.below(250) as f32 - 125.0).exp2(),
            13..15 => self.step() + self.step() * 1e-6,
            _ => f32::from_bits(self.bits()),
        }
    }

    /// A number that is finite.
    pub fn finite(&mut self) -> f32 {
        let number = self.number();
        if number.is_finite() { number } else { 0.5 }
    }

    /// An odd count: around 0, around powers of two, or anything.
    pub fn count(&mut self) -> u32 {
        match self.below(4) {
            0 | 1 => self.below(70) as u32,
            2 => 1u32
                .rotate_left(self.below(32) as u32)
                .wrapping_add(self.below(3) as u32)
                .wrapping_sub(1),
            _ => self.bits(),
        }
    }
}
