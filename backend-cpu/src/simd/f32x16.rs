//! Sixteen floats at a time: two references, or what two columns of eight need. By AVX-512, by AVX2, and by loops
//! that a compiler turns into what vector instructions it may use.

use super::WIDTH;

/// Sixteen floats, in memory.
pub(crate) type Row16 = [f32; WIDTH];

/// Sixteen floats. Comparisons with what is no number fail.
pub(crate) trait F32x16: Copy {
    /// From memory.
    fn load(from: &Row16) -> Self;
    /// The same eight in both halves.
    fn twice(from: &[f32; 8]) -> Self;
    /// One number in all lanes.
    fn splat(x: f32) -> Self;
    /// To memory.
    fn store(self, to: &mut Row16);
    /// Sums.
    fn plus(self, other: Self) -> Self;
    /// Differences.
    fn minus(self, other: Self) -> Self;
    /// Products.
    fn times(self, other: Self) -> Self;
    /// The lesser of each two.
    fn least(self, other: Self) -> Self;
    /// The greater of each two.
    fn greatest(self, other: Self) -> Self;
    /// The halves exchanged.
    fn swapped(self) -> Self;
    /// The first four of each eight exchanged with the other four.
    fn crossed(self) -> Self;
    /// The words of two references with upper faces negated, and 0 for words that are no faces.
    fn faces(self) -> Self;
    /// The lower half of this, the upper half of the other.
    fn halves(self, other: Self) -> Self;
    /// `more` added where `a < b`.
    fn plus_where_less(self, a: Self, b: Self, more: Self) -> Self;
    /// This where `a < b`, else `other`.
    fn where_less(self, a: Self, b: Self, other: Self) -> Self;
    /// The lanes that equal the other's, a bit each.
    fn equal(self, other: Self) -> u16;
    /// The lanes less than the other's, a bit each.
    fn less(self, other: Self) -> u16;
    /// The lanes that are not greater than the other's, those that are no numbers among them.
    fn not_above(self, other: Self) -> u16;
    /// The least of all lanes; unspecified where one is no number.
    fn least_lane(self) -> f32;
}

/// Without intrinsics.
#[derive(Clone, Copy)]
pub(crate) struct ArrayF32x16(Row16);

impl ArrayF32x16 {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn map(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self;
        for k in 0..WIDTH {
            out.0[k] = f(self.0[k], other.0[k]);
        }
        out
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn mask(self, other: Self, f: impl Fn(f32, f32) -> bool) -> u16 {
        let mut out = 0;
        for k in 0..WIDTH {
            out |= u16::from(f(self.0[k], other.0[k])) << k;
        }
        out
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn permuted(self, from: impl Fn(usize) -> usize) -> Self {
        let mut out = self;
        for k in 0..WIDTH {
            out.0[k] = self.0[from(k)];
        }
        out
    }
}

impl F32x16 for ArrayF32x16 {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn load(from: &Row16) -> Self {
        ArrayF32x16(*from)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn twice(from: &[f32; 8]) -> Self {
        ArrayF32x16(core::array::from_fn(|k| from[k % 8]))
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn splat(x: f32) -> Self {
        ArrayF32x16([x; WIDTH])
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn store(self, to: &mut Row16) {
        *to = self.0;
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn plus(self, other: Self) -> Self {
        self.map(other, |a, b| a + b)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn minus(self, other: Self) -> Self {
        self.map(other, |a, b| a - b)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn times(self, other: Self) -> Self {
        self.map(other, |a, b| a * b)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn least(self, other: Self) -> Self {
        self.map(other, |a, b| if a < b { a } else { b })
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn greatest(self, other: Self) -> Self {
        self.map(other, |a, b| if a > b { a } else { b })
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn swapped(self) -> Self {
        self.permuted(|k| k ^ 8)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn crossed(self) -> Self {
        self.permuted(|k| k ^ 4)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn faces(self) -> Self {
        let mut out = self;
        for k in 0..WIDTH {
            let sign = if k % 8 < 4 { 1.0 } else { -1.0 };
            out.0[k] = if k % 4 == 3 { 0.0 } else { sign * self.0[k] };
        }
        out
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn halves(self, other: Self) -> Self {
        let mut out = self;
        out.0[8..].copy_from_slice(&other.0[8..]);
        out
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn plus_where_less(self, a: Self, b: Self, more: Self) -> Self {
        self.plus(more.where_less(a, b, ArrayF32x16::splat(0.0)))
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn where_less(self, a: Self, b: Self, other: Self) -> Self {
        let mut out = self;
        for k in 0..WIDTH {
            out.0[k] = if a.0[k] < b.0[k] { self.0[k] } else { other.0[k] };
        }
        out
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn equal(self, other: Self) -> u16 {
        self.mask(other, |a, b| a == b)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn less(self, other: Self) -> u16 {
        self.mask(other, |a, b| a < b)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    #[allow(clippy::neg_cmp_op_on_partial_ord, reason = "true of what is no number")]
    fn not_above(self, other: Self) -> u16 {
        self.mask(other, |a, b| !(a > b))
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn least_lane(self) -> f32 {
        self.0.iter().fold(f32::INFINITY, |least, &x| if x < least { x } else { least })
    }
}
