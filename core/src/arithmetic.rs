//! Floating-point operations whose result is the same on every device.
//!
//! WGSL names no rounding mode, lets a compiler fuse, reassociate and flush subnormals, and divides
//! to 2.5 ULP. So every value that reaches a tree or a watertight hit goes through the *guarded*
//! operations of [`Arithmetic`]: each rounds once, to nearest, and a compiler cannot merge it with
//! another (a device passes the result through an integer operation that it cannot see through).
//! Where a result need only be conservative (the distance to a split plane, which is widened
//! anyway) the *free* operations suffice: a compiler may transform them as it likes.
//!
//! [`Strict`] is the arithmetic of Rust and of every backend. [`Hostile`] fuses
//! free operations, moves their results by up to two floats, and flushes subnormals everywhere; tests
//! run the builder's decisions and the traversal under it, and neither digest nor hits may change.

/// Guarded and free operations on `f32`.
pub trait Arithmetic: Copy + Send + Sync + 'static {
    /// `a * b`, rounded to nearest.
    fn product(a: f32, b: f32) -> f32;
    /// `a + b`, rounded to nearest.
    fn sum(a: f32, b: f32) -> f32;
    /// `a - b`, rounded to nearest.
    fn difference(a: f32, b: f32) -> f32;
    /// `a / b`, rounded to nearest. On devices this is a routine of our own, not the hardware's.
    fn quotient(a: f32, b: f32) -> f32;
    /// `a * b` without error, as a rounded part and the remainder; exact unless it underflows.
    fn two_product(a: f32, b: f32) -> (f32, f32);

    /// `a * b`, unguarded.
    fn free_mul(a: f32, b: f32) -> f32;
    /// `a * b + c`, unguarded: it may round once or twice.
    fn free_mul_add(a: f32, b: f32, c: f32) -> f32;
    /// `a - b`, unguarded.
    fn free_sub(a: f32, b: f32) -> f32;
    /// `1 / a` to 2.5 ULP.
    fn free_reciprocal(a: f32) -> f32;

    /// [`Arithmetic::product`], snapped: results that flushing makes zero are zero everywhere.
    /// These operations decide the tree.
    #[inline(always)]
    fn snapped_product(a: f32, b: f32) -> f32 {
        snap(Self::product(a, b))
    }
    /// [`Arithmetic::sum`], snapped.
    #[inline(always)]
    fn snapped_sum(a: f32, b: f32) -> f32 {
        snap(Self::sum(a, b))
    }
    /// [`Arithmetic::difference`], snapped.
    #[inline(always)]
    fn snapped_difference(a: f32, b: f32) -> f32 {
        snap(Self::difference(a, b))
    }

    /// The square root, rounded to nearest; 0 for what is not positive. On devices this is a routine of our own, as
    /// quotients are.
    #[inline]
    fn root(a: f32) -> f32 {
        root(a)
    }

    /// `a + b` without error, as a rounded part and the remainder (Knuth's two-sum).
    fn two_sum(a: f32, b: f32) -> (f32, f32) {
        let sum = Self::sum(a, b);
        let b_part = Self::difference(sum, a);
        let a_part = Self::difference(sum, b_part);
        let error = Self::sum(Self::difference(a, a_part), Self::difference(b, b_part));
        (sum, error)
    }
}

/// IEEE 754 as Rust has it: the arithmetic that defines all answers.
#[derive(Clone, Copy, Debug)]
pub struct Strict;

impl Arithmetic for Strict {
    #[inline(always)]
    fn product(a: f32, b: f32) -> f32 {
        a * b
    }
    #[inline(always)]
    fn sum(a: f32, b: f32) -> f32 {
        a + b
    }
    #[inline(always)]
    fn difference(a: f32, b: f32) -> f32 {
        a - b
    }
    #[inline(always)]
    fn quotient(a: f32, b: f32) -> f32 {
        a / b
    }
    #[inline(always)]
    fn two_product(a: f32, b: f32) -> (f32, f32) {
        // 24 + 24 bits fit the 53 of an f64: the product is exact, and so is the remainder.
        let exact = f64::from(a) * f64::from(b);
        let rounded = exact as f32;
        (rounded, (exact - f64::from(rounded)) as f32)
    }
    #[inline(always)]
    fn free_mul(a: f32, b: f32) -> f32 {
        a * b
    }
    #[inline(always)]
    fn free_mul_add(a: f32, b: f32, c: f32) -> f32 {
        a * b + c
    }
    #[inline(always)]
    fn free_sub(a: f32, b: f32) -> f32 {
        a - b
    }
    #[inline(always)]
    fn free_reciprocal(a: f32) -> f32 {
        1.0 / a
    }
}

/// A device that uses the liberties of WGSL: free operations fuse, keep excess precision or land one
/// or two floats away (seemingly at random, a function of the operands; a stand-in for
/// reassociation, which a function of two operands cannot perform), and every subnormal is flushed
/// to zero, going in and coming out. Guarded operations still round to nearest.
#[derive(Clone, Copy, Debug)]
pub struct Hostile;

/// Zero for subnormals.
#[inline]
pub fn flush(x: f32) -> f32 {
    if x.abs() < f32::MIN_POSITIVE { 0.0 } else { x }
}

/// Moves a result by up to `reach` floats either way, as a hash of the operands decides.
fn disturb(x: f32, reach: i32, a: f32, b: f32) -> f32 {
    if x == 0.0 || !x.is_finite() {
        return flush(x);
    }
    let hash = (a.to_bits() ^ b.to_bits().rotate_left(13)).wrapping_mul(0x9e37_79b9) >> 7;
    let step = hash as i32 % (2 * reach + 1) - reach;
    let moved = f32::from_bits(x.to_bits().wrapping_add_signed(step));
    if moved.is_finite() { flush(moved) } else { x }
}

impl Arithmetic for Hostile {
    fn product(a: f32, b: f32) -> f32 {
        flush(flush(a) * flush(b))
    }
    fn sum(a: f32, b: f32) -> f32 {
        flush(flush(a) + flush(b))
    }
    fn difference(a: f32, b: f32) -> f32 {
        flush(flush(a) - flush(b))
    }
    fn quotient(a: f32, b: f32) -> f32 {
        flush(flush(a) / flush(b))
    }
    fn root(a: f32) -> f32 {
        flush(root(flush(a)))
    }
    fn two_product(a: f32, b: f32) -> (f32, f32) {
        let (rounded, rest) = Strict::two_product(flush(a), flush(b));
        (flush(rounded), flush(rest))
    }
    fn free_mul(a: f32, b: f32) -> f32 {
        disturb(flush(a) * flush(b), 1, a, b)
    }
    fn free_mul_add(a: f32, b: f32, c: f32) -> f32 {
        let fused = f64::from(flush(a)) * f64::from(flush(b)) + f64::from(flush(c));
        disturb(fused as f32, 1, a, c)
    }
    fn free_sub(a: f32, b: f32) -> f32 {
        disturb(flush(a) - flush(b), 1, a, b)
    }
    fn free_reciprocal(a: f32) -> f32 {
        disturb(1.0 / flush(a), 2, a, a)
    }
}

/// Square root by Newton's method, since `core` has none without `std`. Accurate to a few units in
/// the last place for normal arguments; 0 for arguments that are not positive.
pub(crate) fn sqrt(x: f64) -> f64 {
    if x.is_nan() || x <= 0.0 || x.is_infinite() {
        return if x > 0.0 { x } else { 0.0 };
    }
    // Halving the exponent gives a start within a factor of two.
    let mut y = f64::from_bits((x.to_bits() >> 1) + (1023 << 51));
    for _ in 0..6 {
        y = 0.5 * (y + x / y);
    }
    y
}

/// The square root of a finite float, rounded to nearest; 0 for what is not positive. `core` has none without `std`.
pub(crate) fn root(x: f32) -> f32 {
    if x.is_nan() || x <= 0.0 {
        return 0.0;
    }
    let exact = f64::from(x);
    let near = sqrt(exact) as f32;
    // Squares of what lies halfway between two floats have at most 50 bits, so they are exact, and none is a float.
    let above = 0.5 * (f64::from(near) + f64::from(near.next_up()));
    let below = 0.5 * (f64::from(near) + f64::from(near.next_down()));
    if above * above < exact {
        near.next_up()
    } else if below * below > exact {
        near.next_down()
    } else {
        near
    }
}

/// The canonical form of a coordinate: -0 and everything below 2^-126 become +0. A function of the
/// value alone, so shared vertices stay shared; devices may flush subnormals and ignore the sign of
/// zero, and this leaves them nothing to disagree about.
#[inline]
pub fn snap(coordinate: f32) -> f32 {
    // `<` is false for NaN, which stays and is dropped with its triangle.
    if coordinate.abs() < f32::MIN_POSITIVE { 0.0 } else { coordinate }
}

/// The power of two with this exponent, clamped to the normal range `-126..=127`.
#[inline]
pub fn power_of_two(exponent: i32) -> f32 {
    f32::from_bits(((exponent.clamp(-126, 127) + 127) as u32) << 23)
}

/// The exponent of a float: `floor(log2 |x|)` for normal `x`, -127 for zero and subnormals, 128 for
/// infinities and NaN.
#[inline]
pub fn exponent(x: f32) -> i32 {
    ((x.to_bits() >> 23) & 0xff) as i32 - 127
}

/// `x as u32` for `x` from 0 to below 2^22, and any number for others, by operations that compilers
/// turn into vector instructions, which they do not do with that conversion.
#[inline(always)]
pub fn truncated(x: f32) -> u32 {
    const WHOLE: f32 = 8_388_608.0; // 2^23: floats from here to its double are the integers
    let nearest = x + WHOLE;
    (nearest.to_bits() & 0x7f_ffff).wrapping_sub(u32::from(nearest - WHOLE > x))
}

/// Maps floats to integers of the same order; -0 comes just before +0.
#[inline]
pub fn ordered_bits(x: f32) -> u32 {
    let bits = x.to_bits();
    if bits >> 31 == 0 { bits | 0x8000_0000 } else { !bits }
}

/// Products of doubles err by less than this part of their factors, with slack for six of them and
/// a direction of length up to 4.
pub const DOUBLE_NOISE: f32 = 9.094_947e-13; // 2^-40

/// A sum of two floats that do not overlap: about 48 bits.
#[derive(Clone, Copy, Debug)]
pub struct Double {
    /// The rounded value.
    pub high: f32,
    /// The remainder.
    pub low: f32,
}

impl Double {
    /// `a - b` without error.
    #[inline]
    pub fn difference_of<A: Arithmetic>(a: f32, b: f32) -> Double {
        let (high, low) = A::two_sum(a, -b);
        Double { high, low }
    }

    /// A float as a double.
    #[inline]
    pub fn from_float(high: f32) -> Double {
        Double { high, low: 0.0 }
    }

    /// The product, to about 2^-46 of itself.
    #[inline]
    pub fn times<A: Arithmetic>(self, other: Double) -> Double {
        let Double { high, low } = self.times_loosely::<A>(other);
        renormalise::<A>(high, low)
    }

    /// The same, with its two parts not yet added: they may overlap.
    #[inline(always)]
    pub(crate) fn times_loosely<A: Arithmetic>(self, other: Double) -> Double {
        let (high, mut low) = A::two_product(self.high, other.high);
        low = A::sum(low, A::product(self.high, other.low));
        low = A::sum(low, A::product(self.low, other.high));
        Double { high, low }
    }

    /// The product with a float, to about 2^-46 of itself.
    #[inline]
    pub fn times_float<A: Arithmetic>(self, other: f32) -> Double {
        let (high, low) = A::two_product(self.high, other);
        renormalise::<A>(high, A::sum(low, A::product(self.low, other)))
    }

    /// The sum, to about 2^-46 of the greater operand.
    #[inline]
    pub fn plus<A: Arithmetic>(self, other: Double) -> Double {
        let (high, low) = A::two_sum(self.high, other.high);
        renormalise::<A>(high, A::sum(low, A::sum(self.low, other.low)))
    }

    /// The difference, to about 2^-46 of the greater operand.
    #[inline]
    pub fn minus<A: Arithmetic>(self, other: Double) -> Double {
        self.plus::<A>(Double { high: -other.high, low: -other.low })
    }
}

/// Dekker's fast two-sum: `|high| >= |low|`.
#[inline]
fn renormalise<A: Arithmetic>(high: f32, low: f32) -> Double {
    let sum = A::sum(high, low);
    Double { high: sum, low: A::difference(low, A::difference(sum, high)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_sum_and_two_product_lose_nothing() {
        let values = [1.0f32, 1.000_000_1, -3.3e7, 7.5e-8, 0.1, 1e18, -1.0 / 3.0];
        for a in values {
            for b in values {
                let (high, low) = Strict::two_product(a, b);
                assert_eq!(f64::from(high) + f64::from(low), f64::from(a) * f64::from(b));
                let (high, low) = Strict::two_sum(a, b);
                if a.abs().max(b.abs()) < 1e10 {
                    assert_eq!(f64::from(high) + f64::from(low), f64::from(a) + f64::from(b));
                }
            }
        }
    }

    #[test]
    fn doubles_keep_what_floats_cancel() {
        let x = Double::difference_of::<Strict>(1e8, 0.3);
        let y = Double::difference_of::<Strict>(1e8, 0.1);
        let gap = y.minus::<Strict>(x).high;
        assert!((gap - 0.2).abs() < 1e-6, "{gap}");
    }

    /// Mantissas under both parities of the exponent: the machine's roots are rounded to nearest.
    #[test]
    fn roots_are_rounded_to_nearest() {
        extern crate std;
        for bits in (1.0f32.to_bits()..4.0f32.to_bits()).step_by(7) {
            let x = f32::from_bits(bits);
            assert_eq!(root(x).to_bits(), x.sqrt().to_bits(), "{x}");
        }
        for x in [f32::MIN_POSITIVE, f32::MAX, 1e-30, 3e37, 2.0f32.powi(-126) * 1.5] {
            assert_eq!(root(x), x.sqrt(), "{x}");
        }
        for none in [0.0, -0.0, -1.0, f32::NAN] {
            assert_eq!(root(none), 0.0, "{none}");
        }
    }

    #[test]
    fn truncation_is_the_conversion() {
        let mut x = 0.0f32;
        while x < 4_194_304.0 {
            assert_eq!(truncated(x), x as u32, "{x}");
            // Every float near the integers up to 128, every 1,021st elsewhere.
            let step = if x < 128.0 && (x - x.round()).abs() < 1e-4 { 1 } else { 1021 };
            x = f32::from_bits(x.to_bits() + step);
        }
        for whole in 1..2048u32 {
            let x = whole as f32;
            let below = f32::from_bits(x.to_bits() - 1);
            assert_eq!([truncated(x), truncated(below)], [whole, whole - 1]);
        }
        for any in [-1.0, f32::MAX, f32::INFINITY, f32::NAN] {
            truncated(any);
        }
    }

    #[test]
    fn snapping() {
        assert_eq!(snap(-0.0).to_bits(), 0);
        assert_eq!(snap(-1e-40).to_bits(), 0);
        assert_eq!(snap(f32::MIN_POSITIVE), f32::MIN_POSITIVE);
        assert!(snap(f32::NAN).is_nan());
    }

    #[test]
    fn ordered_bits_order() {
        let sorted = [f32::MIN, -1.0, -1e-30, 0.0, 1e-30, 1.0, f32::MAX];
        assert!(sorted.windows(2).all(|w| ordered_bits(w[0]) < ordered_bits(w[1])));
    }

    #[test]
    fn exponents() {
        assert_eq!(exponent(1.5), 0);
        assert_eq!(exponent(0.5), -1);
        assert_eq!(exponent(-8.0), 3);
        assert_eq!(exponent(1e-40), -127);
        assert_eq!(power_of_two(-3), 0.125);
        assert_eq!(power_of_two(-500), f32::MIN_POSITIVE);
    }
}
