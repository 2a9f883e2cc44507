//! Sixteen floats at a time: two references, or what two columns of eight need. By AVX-512, and by loops
//! that a compiler turns into what vector instructions it may use.

/// How many lanes there are.
pub(super) const LANES: usize = 16;

/// Sixteen floats, in memory.
pub(super) type Row = [f32; LANES];

/// Sixteen floats. Comparisons with what is no number fail.
pub(super) trait Lanes: Copy {
    /// From memory.
    fn load(from: &Row) -> Self;
    /// The same eight in both halves.
    fn twice(from: &[f32; 8]) -> Self;
    /// One number in all lanes.
    fn splat(x: f32) -> Self;
    /// To memory.
    fn store(self, to: &mut Row);
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
pub(super) struct Loops(Row);

impl Loops {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn map(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self;
        for k in 0..LANES {
            out.0[k] = f(self.0[k], other.0[k]);
        }
        out
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn mask(self, other: Self, f: impl Fn(f32, f32) -> bool) -> u16 {
        let mut out = 0;
        for k in 0..LANES {
            out |= u16::from(f(self.0[k], other.0[k])) << k;
        }
        out
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn permuted(self, from: impl Fn(usize) -> usize) -> Self {
        let mut out = self;
        for k in 0..LANES {
            out.0[k] = self.0[from(k)];
        }
        out
    }
}

impl Lanes for Loops {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn load(from: &Row) -> Self {
        Loops(*from)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn twice(from: &[f32; 8]) -> Self {
        Loops(core::array::from_fn(|k| from[k % 8]))
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn splat(x: f32) -> Self {
        Loops([x; LANES])
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn store(self, to: &mut Row) {
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
        for k in 0..LANES {
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
        self.plus(more.where_less(a, b, Loops::splat(0.0)))
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn where_less(self, a: Self, b: Self, other: Self) -> Self {
        let mut out = self;
        for k in 0..LANES {
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

#[cfg(target_arch = "x86_64")]
pub(super) use wide::Avx512;

#[cfg(target_arch = "x86_64")]
mod wide {
    #![allow(
        clippy::undocumented_unsafe_blocks,
        reason = "one reason for all: functions are instantiated with `Avx512` only where they are \
                  compiled for AVX-512; loads and stores are of arrays as long as they read and write"
    )]

    use core::arch::x86_64::*;

    use super::{Lanes, Row};

    /// By AVX-512 (F and DQ). To be used only where the processor has it.
    #[derive(Clone, Copy)]
    pub struct Avx512(__m512);

    impl Lanes for Avx512 {
        #[cfg_attr(not(unoptimised), inline(always))]
        fn load(from: &Row) -> Self {
            unsafe { Avx512(_mm512_loadu_ps(from.as_ptr())) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn twice(from: &[f32; 8]) -> Self {
            unsafe { Avx512(_mm512_broadcast_f32x8(_mm256_loadu_ps(from.as_ptr()))) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn splat(x: f32) -> Self {
            unsafe { Avx512(_mm512_set1_ps(x)) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn store(self, to: &mut Row) {
            unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn plus(self, other: Self) -> Self {
            unsafe { Avx512(_mm512_add_ps(self.0, other.0)) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn minus(self, other: Self) -> Self {
            unsafe { Avx512(_mm512_sub_ps(self.0, other.0)) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn times(self, other: Self) -> Self {
            unsafe { Avx512(_mm512_mul_ps(self.0, other.0)) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn least(self, other: Self) -> Self {
            unsafe { Avx512(_mm512_min_ps(self.0, other.0)) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn greatest(self, other: Self) -> Self {
            unsafe { Avx512(_mm512_max_ps(self.0, other.0)) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn swapped(self) -> Self {
            unsafe { Avx512(_mm512_shuffle_f32x4::<0b01_00_11_10>(self.0, self.0)) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn crossed(self) -> Self {
            unsafe { Avx512(_mm512_shuffle_f32x4::<0b10_11_00_01>(self.0, self.0)) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn faces(self) -> Self {
            unsafe {
                let sign = i32::MIN;
                let signs = _mm512_castsi512_ps(_mm512_set_epi32(
                    sign, sign, sign, sign, 0, 0, 0, 0, sign, sign, sign, sign, 0, 0, 0, 0,
                ));
                Avx512(_mm512_maskz_xor_ps(0x7777, self.0, signs))
            }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn halves(self, other: Self) -> Self {
            unsafe { Avx512(_mm512_mask_blend_ps(0xff00, self.0, other.0)) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn plus_where_less(self, a: Self, b: Self, more: Self) -> Self {
            unsafe {
                let mask = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a.0, b.0);
                Avx512(_mm512_mask_add_ps(self.0, mask, self.0, more.0))
            }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn where_less(self, a: Self, b: Self, other: Self) -> Self {
            unsafe {
                let mask = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a.0, b.0);
                Avx512(_mm512_mask_blend_ps(mask, other.0, self.0))
            }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn equal(self, other: Self) -> u16 {
            unsafe { _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(self.0, other.0) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn less(self, other: Self) -> u16 {
            unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn not_above(self, other: Self) -> u16 {
            unsafe { _mm512_cmp_ps_mask::<_CMP_NGT_UQ>(self.0, other.0) }
        }

        #[cfg_attr(not(unoptimised), inline(always))]
        fn least_lane(self) -> f32 {
            unsafe { _mm512_reduce_min_ps(self.0) }
        }
    }
}
