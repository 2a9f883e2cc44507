//! Whole numbers wide enough for every predicate: sign and magnitude, of fixed size, on the stack.
//!
//! A finite `f32` is a whole multiple of 2^-149 below 2^277 of them, and so is the difference of two,
//! below 2^278. The largest number here is the product of two such triple products (comparing two
//! distances along a ray): six factors, 1,668 bits, and a few more for sums. 28 limbs of 64 bits hold 1,792.
//! Distances of triangles from a point take more ([`Wide`](super::foot)).

use core::cmp::Ordering;

/// Whole numbers of 28 limbs.
pub(super) type Integer = Whole<28>;

/// A whole number: its sign, and its magnitude of so many limbs of 64 bits, the lowest first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Whole<const LIMBS: usize> {
    negative: bool,
    /// Limbs in use; the highest of them is not 0.
    len: usize,
    limbs: [u64; LIMBS],
}

impl<const LIMBS: usize> Whole<LIMBS> {
    /// 0.
    pub(super) const ZERO: Self = Whole { negative: false, len: 0, limbs: [0; LIMBS] };

    /// A finite float, in units of 2^-149.
    pub(super) fn from_float(x: f32) -> Self {
        let bits = x.to_bits();
        let (biased, fraction) = ((bits >> 23) & 0xff, u64::from(bits & 0x7f_ffff));
        let (mantissa, shift) =
            if biased == 0 { (fraction, 0) } else { (fraction | 1 << 23, biased as usize - 1) };
        let mut out = Self::ZERO;
        if mantissa == 0 {
            return out;
        }
        let (limb, bit) = (shift / 64, shift % 64);
        out.limbs[limb] = mantissa << bit;
        if bit > 40 {
            out.limbs[limb + 1] = mantissa >> (64 - bit);
        }
        out.len = limb + 2;
        out.trim();
        out.negative = bits >> 31 == 1;
        out
    }

    /// `a - b` of two finite floats, in units of 2^-149.
    pub(super) fn difference(a: f32, b: f32) -> Self {
        Self::from_float(a).minus(&Self::from_float(b))
    }

    fn trim(&mut self) {
        while self.len > 0 && self.limbs[self.len - 1] == 0 {
            self.len -= 1;
        }
    }

    fn compare_magnitude(&self, other: &Self) -> Ordering {
        self.len.cmp(&other.len).then_with(|| {
            let (a, b) = (&self.limbs[..self.len], &other.limbs[..other.len]);
            a.iter().rev().cmp(b.iter().rev())
        })
    }

    /// How it compares with 0.
    pub(super) fn sign(&self) -> Ordering {
        match (self.len, self.negative) {
            (0, _) => Ordering::Equal,
            (_, false) => Ordering::Greater,
            (_, true) => Ordering::Less,
        }
    }

    /// The number with the other sign.
    pub(super) fn negated(mut self) -> Self {
        self.negative = !self.negative;
        self
    }

    /// The sum of both.
    pub(super) fn plus(&self, other: &Self) -> Self {
        if self.negative == other.negative {
            return self.with_magnitude_added(other);
        }
        match self.compare_magnitude(other) {
            Ordering::Less => other.with_magnitude_taken(self),
            Ordering::Equal => Self::ZERO,
            Ordering::Greater => self.with_magnitude_taken(other),
        }
    }

    /// The difference of both.
    pub(super) fn minus(&self, other: &Self) -> Self {
        self.plus(&other.negated())
    }

    fn with_magnitude_added(&self, other: &Self) -> Self {
        let mut out = *self;
        let len = self.len.max(other.len);
        let mut carry = false;
        for i in 0..len {
            let (sum, over) = self.limbs[i].overflowing_add(other.limbs[i]);
            let (sum, over_too) = sum.overflowing_add(u64::from(carry));
            (out.limbs[i], carry) = (sum, over | over_too);
        }
        out.len = len;
        if carry {
            out.limbs[len] = 1;
            out.len = len + 1;
        }
        out
    }

    /// `other`'s magnitude must not be the greater one.
    fn with_magnitude_taken(&self, other: &Self) -> Self {
        let mut out = *self;
        let mut borrow = false;
        for i in 0..self.len {
            let (rest, under) = self.limbs[i].overflowing_sub(other.limbs[i]);
            let (rest, under_too) = rest.overflowing_sub(u64::from(borrow));
            (out.limbs[i], borrow) = (rest, under | under_too);
        }
        out.trim();
        out
    }

    /// The product of both.
    pub(super) fn times(&self, other: &Self) -> Self {
        let mut out = Self::ZERO;
        if self.len == 0 || other.len == 0 {
            return out;
        }
        for i in 0..self.len {
            let mut carry = 0u128;
            for j in 0..other.len {
                let at = u128::from(out.limbs[i + j]);
                let sum = at + u128::from(self.limbs[i]) * u128::from(other.limbs[j]) + carry;
                out.limbs[i + j] = sum as u64;
                carry = sum >> 64;
            }
            // Nothing was there yet: rows end one limb higher each.
            if carry != 0 {
                out.limbs[i + other.len] = carry as u64;
            }
        }
        out.len = (self.len + other.len).min(LIMBS);
        out.trim();
        out.negative = self.negative != other.negative;
        out
    }

    /// Bits of the magnitude: 0 for 0, else one more than the place of the highest.
    fn bits(&self) -> i32 {
        match self.len {
            0 => 0,
            len => len as i32 * 64 - self.limbs[len - 1].leading_zeros() as i32,
        }
    }

    /// Bits `low..low + 64` of the magnitude, those outside it being 0.
    fn window(&self, low: i32) -> u64 {
        let limb = |index: i32| {
            usize::try_from(index).ok().and_then(|i| self.limbs.get(i)).copied().unwrap_or(0)
        };
        let (index, bit) = (low.div_euclid(64), low.rem_euclid(64) as u32);
        if bit == 0 { limb(index) } else { limb(index) >> bit | limb(index + 1) << (64 - bit) }
    }

    /// The magnitude times a power of two, which must leave it whole and within the limbs.
    fn shifted(&self, by: i32) -> Self {
        let mut out = Self::ZERO;
        out.len = ((self.bits() + by).max(0) as usize).div_ceil(64);
        for i in 0..out.len {
            out.limbs[i] = self.window(i as i32 * 64 - by);
        }
        out
    }
}

/// The quotient of two numbers, rounded to the nearest float (ties to even), with magnitudes below
/// 2^-126 taken as 0 and those beyond `f32::MAX` as `f32::MAX`. The denominator must not be 0.
pub(super) fn quotient(numerator: &Integer, denominator: &Integer) -> f32 {
    if numerator.len == 0 {
        return 0.0;
    }
    let sign = if numerator.negative == denominator.negative { 1.0 } else { -1.0 };
    // The quotient lies between 2^(scale - 1) and 2^(scale + 1). Times 2^(25 - scale) it has 25 or 26
    // bits before the point: a mantissa and at least one bit to round by.
    let scale = numerator.bits() - denominator.bits();
    if scale < -128 {
        return 0.0;
    }
    if scale > 129 {
        return sign * f32::MAX;
    }
    let by = 25 - scale;
    let (mut rest, divisor) = if by >= 0 {
        (numerator.shifted(by), Integer { negative: false, ..*denominator })
    } else {
        (Integer { negative: false, ..*numerator }, denominator.shifted(-by))
    };
    let mut whole = 0u64;
    for bit in (0..27).rev() {
        let part = divisor.shifted(bit);
        whole <<= 1;
        if rest.compare_magnitude(&part).is_ge() {
            rest = rest.minus(&part);
            whole |= 1;
        }
    }
    // What is left only matters as being something: one more bit below, which cannot make a tie.
    let odd = whole << 1 | u64::from(rest.len != 0);
    // 27 bits at most: exact in f64, and scaled exactly. A single rounding follows.
    let value = odd as f64 * power_of_two(scale - 26);
    let rounded = value as f32;
    let rounded = if rounded > f32::MAX { f32::MAX } else { rounded };
    if rounded < f32::MIN_POSITIVE { 0.0 } else { sign * rounded }
}

/// 2^exponent for exponents in the normal range of `f64`.
fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

#[cfg(all(test, feature = "alloc"))]
mod tests {
    use super::*;
    use alloc::vec::Vec;

    fn floats() -> impl Iterator<Item = f32> {
        let mut state = 1u32;
        let special = [0.0, -0.0, 1.0, -1.5, f32::MAX, f32::MIN, f32::MIN_POSITIVE, 1e-45, 3e38];
        special.into_iter().chain((0..2000).map(move |_| {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            let x = f32::from_bits(state ^ state >> 15);
            if x.is_finite() { x } else { 0.25 }
        }))
    }

    #[test]
    fn floats_and_their_quotients_come_back() {
        let one = Integer::from_float(1.0);
        for x in floats() {
            let back = quotient(&Integer::from_float(x), &one);
            let expected = if x.abs() < f32::MIN_POSITIVE { 0.0 } else { x };
            assert_eq!(back, expected, "{x:e}");
        }
    }

    #[test]
    fn quotients_are_those_of_the_processor() {
        let all: Vec<f32> = floats().collect();
        for pair in all.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            if b == 0.0 {
                continue;
            }
            let found = quotient(&Integer::from_float(a), &Integer::from_float(b));
            let expected = (a / b).clamp(-f32::MAX, f32::MAX);
            let expected = if expected.abs() < f32::MIN_POSITIVE { 0.0 } else { expected };
            // Quotients next to 2^-126 may be rounded up to it.
            assert_eq!(found, expected, "{a:e} / {b:e}");
        }
    }

    #[test]
    fn sums_and_products_are_exact() {
        // Checked in the whole numbers that fit 128 bits.
        let mut state = 5u32;
        let mut next = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 9) as i32 - (1 << 22)
        };
        let integer = |x: i128| {
            let mut out = Integer::ZERO;
            let magnitude = x.unsigned_abs();
            (out.limbs[0], out.limbs[1]) = (magnitude as u64, (magnitude >> 64) as u64);
            (out.len, out.negative) = (2, x < 0);
            out.trim();
            out
        };
        for _ in 0..2000 {
            let [a, b, c, d] = [(); 4].map(|()| i128::from(next()) * i128::from(next()));
            let (x, y, z, w) = (integer(a), integer(b), integer(c), integer(d));
            let found = x.times(&y).minus(&z.times(&w));
            let expected = integer(a * b - c * d);
            assert_eq!(found.minus(&expected).sign(), Ordering::Equal, "{a} {b} {c} {d}");
            assert_eq!(found.sign(), (a * b).cmp(&(c * d)));
            assert_eq!(x.plus(&y).sign(), (a + b).cmp(&0));
        }
    }

    #[test]
    fn the_widest_products_fit() {
        let most = Integer::difference(f32::MAX, -f32::MAX);
        let triple = most.times(&most).times(&most);
        let six = triple.times(&triple);
        let sum = (0..36).fold(Integer::ZERO, |sum, _| sum.plus(&six));
        assert!(sum.bits() <= 6 * 278 + 6);
        assert_eq!(quotient(&sum, &six), 36.0);
        assert_eq!(quotient(&six, &triple), f32::MAX);
        assert_eq!(quotient(&triple.negated(), &six), 0.0);
    }
}
