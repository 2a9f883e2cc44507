//! Four floats: the three axes of one ray, side by side, and one number more. SSE2, which every x86-64
//! processor has, or plain Rust. Each operation rounds by itself, as scalar code does.

#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "SSE2 is part of x86-64, and rows have four floats"
)]

#[cfg(target_arch = "x86_64")]
use core::arch::x86_64::*;

use splitplane_core::aabb::Aabb;

/// Four floats.
#[derive(Clone, Copy)]
pub(crate) struct F32x4(
    #[cfg(target_arch = "x86_64")] pub(super) __m128,
    #[cfg(not(target_arch = "x86_64"))] [f32; 4],
);

/// Defines operations lane by lane: for SSE2, and in plain Rust.
macro_rules! lane_by_lane {
    ($($(#[$doc:meta])* $name:ident, $by_sse:expr, $by_lane:expr;)*) => {$(
        $(#[$doc])*
        #[cfg_attr(not(unoptimised), inline(always))]
        pub(crate) fn $name(self, other: F32x4) -> F32x4 {
            #[cfg(target_arch = "x86_64")]
            return F32x4(unsafe { $by_sse(self.0, other.0) });
            #[cfg(not(target_arch = "x86_64"))]
            {
                let by_lane: fn(f32, f32) -> f32 = $by_lane;
                F32x4(core::array::from_fn(|i| by_lane(self.0[i], other.0[i])))
            }
        }
    )*};
}

/// Bits all set where it holds.
#[cfg(not(target_arch = "x86_64"))]
fn yes(holds: bool) -> f32 {
    f32::from_bits(if holds { u32::MAX } else { 0 })
}

impl F32x4 {
    lane_by_lane! {
        /// Sums.
        plus, _mm_add_ps, |a, b| a + b;
        /// Differences.
        minus, _mm_sub_ps, |a, b| a - b;
        /// Products.
        times, _mm_mul_ps, |a, b| a * b;
        /// Quotients.
        over, _mm_div_ps, |a, b| a / b;
        /// The lesser ones; `other` where either is no number.
        min, _mm_min_ps, |a, b| if a < b { a } else { b };
        /// The greater ones; `other` where either is no number.
        max, _mm_max_ps, |a, b| if a > b { a } else { b };
        /// A mask: where this is at most the other.
        le, _mm_cmple_ps, |a, b| yes(a <= b);
        /// A mask: where this is not less than the other.
        not_less, _mm_cmpnlt_ps, |a, b| yes(!(a < b));
        /// A mask: where this is less than the other.
        less, _mm_cmplt_ps, |a, b| yes(a < b);
        /// Bits that both have: of two masks, or of a mask and numbers, which are 0 outside of it.
        and, _mm_and_ps, |a, b| f32::from_bits(a.to_bits() & b.to_bits());
        /// Bits that only the other has: of a mask and numbers, which are 0 in it.
        other_only, _mm_andnot_ps, |a, b| f32::from_bits(!a.to_bits() & b.to_bits());
        /// Bits that either has.
        or, _mm_or_ps, |a, b| f32::from_bits(a.to_bits() | b.to_bits());
    }

    /// Of a row.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn of(row: [f32; 4]) -> F32x4 {
        #[cfg(target_arch = "x86_64")]
        return F32x4(unsafe { _mm_loadu_ps(row.as_ptr()) });
        #[cfg(not(target_arch = "x86_64"))]
        return F32x4(row);
    }

    /// Lower and upper corner of bounds; their fourth places count for nothing. In a load each, since what is read lies together.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn of_bounds(Aabb { lo, hi }: &Aabb) -> [F32x4; 2] {
        let low = F32x4::of([lo[0], lo[1], lo[2], hi[0]]);
        let high = F32x4::of([lo[2], hi[0], hi[1], hi[2]]);
        #[cfg(target_arch = "x86_64")]
        return [low, F32x4(unsafe { _mm_shuffle_ps::<0b00_11_10_01>(high.0, high.0) })];
        #[cfg(not(target_arch = "x86_64"))]
        return [low, F32x4([high.0[1], high.0[2], high.0[3], high.0[0]])];
    }

    /// The same number in all.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn splat(x: f32) -> F32x4 {
        F32x4::of([x; 4])
    }

    /// As a row.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn row(self) -> [f32; 4] {
        #[cfg(target_arch = "x86_64")]
        {
            let mut row = [0.0; 4];
            unsafe { _mm_storeu_ps(row.as_mut_ptr(), self.0) };
            row
        }
        #[cfg(not(target_arch = "x86_64"))]
        self.0
    }

    /// The sign bits, the first lowest.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn signs(self) -> u32 {
        #[cfg(target_arch = "x86_64")]
        return unsafe { _mm_movemask_ps(self.0) } as u32;
        #[cfg(not(target_arch = "x86_64"))]
        return (0..4).fold(0, |bits, i| bits | (self.0[i].to_bits() >> 31) << i);
    }

    /// Magnitudes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn abs(self) -> F32x4 {
        self.and(F32x4::splat(f32::from_bits(!0 >> 1)))
    }

    /// Differences of the bits, as whole numbers.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn minus_bits(self, other: F32x4) -> F32x4 {
        #[cfg(target_arch = "x86_64")]
        return F32x4(unsafe {
            let (a, b) = (_mm_castps_si128(self.0), _mm_castps_si128(other.0));
            _mm_castsi128_ps(_mm_sub_epi32(a, b))
        });
        #[cfg(not(target_arch = "x86_64"))]
        return F32x4(core::array::from_fn(|i| {
            f32::from_bits(self.0[i].to_bits().wrapping_sub(other.0[i].to_bits()))
        }));
    }

    /// 0 for what is less than a bound in magnitude.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn at_least(self, bound: f32) -> F32x4 {
        self.and(F32x4::splat(bound).le(self.abs()))
    }

    /// +0 for what is below the normal range, and all else as it is: [`snap`](splitplane_core::arithmetic::snap).
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn snapped(self) -> F32x4 {
        self.and(self.abs().not_less(F32x4::splat(f32::MIN_POSITIVE)))
    }

    /// One of them in all places.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn only<const LANE: usize>(self) -> F32x4 {
        #[cfg(target_arch = "x86_64")]
        return F32x4(unsafe {
            match LANE {
                0 => _mm_shuffle_ps::<0b00_00_00_00>(self.0, self.0),
                1 => _mm_shuffle_ps::<0b01_01_01_01>(self.0, self.0),
                2 => _mm_shuffle_ps::<0b10_10_10_10>(self.0, self.0),
                _ => _mm_shuffle_ps::<0b11_11_11_11>(self.0, self.0),
            }
        });
        #[cfg(not(target_arch = "x86_64"))]
        return F32x4([self.0[LANE]; 4]);
    }

    /// The columns of three rows: four vectors of three numbers, and 0.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn columns(rows: &[[f32; 4]; 3]) -> [F32x4; 4] {
        #[cfg(target_arch = "x86_64")]
        unsafe {
            let [a, b, c] = [F32x4::of(rows[0]).0, F32x4::of(rows[1]).0, F32x4::of(rows[2]).0];
            let zero = _mm_setzero_ps();
            let (ab, ab_end) = (_mm_unpacklo_ps(a, b), _mm_unpackhi_ps(a, b));
            let (c_, c_end) = (_mm_unpacklo_ps(c, zero), _mm_unpackhi_ps(c, zero));
            [
                F32x4(_mm_movelh_ps(ab, c_)),
                F32x4(_mm_movehl_ps(c_, ab)),
                F32x4(_mm_movelh_ps(ab_end, c_end)),
                F32x4(_mm_movehl_ps(c_end, ab_end)),
            ]
        }
        #[cfg(not(target_arch = "x86_64"))]
        [0, 1, 2, 3].map(|i| F32x4([rows[0][i], rows[1][i], rows[2][i], 0.0]))
    }

    /// The first three, and the fourth of others.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn with_fourth_of(self, other: F32x4) -> F32x4 {
        #[cfg(target_arch = "x86_64")]
        return F32x4(unsafe {
            let ends = _mm_unpackhi_ps(self.0, other.0);
            _mm_shuffle_ps::<0b11_00_01_00>(self.0, ends)
        });
        #[cfg(not(target_arch = "x86_64"))]
        return F32x4([self.0[0], self.0[1], self.0[2], other.0[3]]);
    }

    /// The third in the place of the fourth.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn third_last(self) -> F32x4 {
        #[cfg(target_arch = "x86_64")]
        return F32x4(unsafe { _mm_shuffle_ps::<0b10_10_01_00>(self.0, self.0) });
        #[cfg(not(target_arch = "x86_64"))]
        return F32x4([self.0[0], self.0[1], self.0[2], self.0[2]]);
    }

    /// The greatest of all, in the place of each of them.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn greatest(self) -> F32x4 {
        let pairs = self.max(self.paired());
        pairs.max(pairs.halved())
    }

    /// The least of all, in the place of each of them; none is no number.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn least(self) -> F32x4 {
        let pairs = self.min(self.paired());
        pairs.min(pairs.halved())
    }

    /// Neighbours exchanged.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn paired(self) -> F32x4 {
        #[cfg(target_arch = "x86_64")]
        return F32x4(unsafe { _mm_shuffle_ps::<0b10_11_00_01>(self.0, self.0) });
        #[cfg(not(target_arch = "x86_64"))]
        return F32x4([self.0[1], self.0[0], self.0[3], self.0[2]]);
    }

    /// Halves exchanged.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn halved(self) -> F32x4 {
        #[cfg(target_arch = "x86_64")]
        return F32x4(unsafe { _mm_shuffle_ps::<0b01_00_11_10>(self.0, self.0) });
        #[cfg(not(target_arch = "x86_64"))]
        return F32x4([self.0[2], self.0[3], self.0[0], self.0[1]]);
    }
}
