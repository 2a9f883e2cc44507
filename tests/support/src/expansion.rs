//! Exact sums and products of `f64`, after Shewchuk 1997.
//!
//! An expansion is a sum of floats that do not overlap, so the last one carries the sign. Nothing
//! here rounds as long as nothing overflows or underflows. The oracle multiplies at most six
//! differences of `f32` values: magnitudes stay below 2^(6 * 129) = 2^774, and every bit is a
//! multiple of 2^(-149 * 6) = 2^-894, both inside the range of `f64`.

use std::cmp::Ordering;

/// A number as an unevaluated sum, least component first, without zeros.
#[derive(Clone, Debug, Default)]
pub struct Expansion(Vec<f64>);

impl From<f64> for Expansion {
    fn from(value: f64) -> Expansion {
        Expansion(if value == 0.0 { Vec::new() } else { vec![value] })
    }
}

impl Expansion {
    /// `a - b`.
    pub fn difference(a: f64, b: f64) -> Expansion {
        let (high, low) = two_sum(a, -b);
        let mut parts = Vec::with_capacity(2);
        parts.extend([low, high].iter().filter(|&&x| x != 0.0));
        Expansion(parts)
    }

    /// The sum of both. Shewchuk's EXPANSION-SUM, which asks less of its operands than the faster
    /// merge does.
    #[must_use]
    pub fn plus(&self, other: &Expansion) -> Expansion {
        let mut parts = self.0.clone();
        for &value in &other.0 {
            let mut carry = value;
            let mut grown = Vec::with_capacity(parts.len() + 1);
            for &part in &parts {
                let (high, low) = two_sum(carry, part);
                if low != 0.0 {
                    grown.push(low);
                }
                carry = high;
            }
            if carry != 0.0 {
                grown.push(carry);
            }
            parts = grown;
        }
        Expansion(parts)
    }

    /// The difference of both.
    #[must_use]
    pub fn minus(&self, other: &Expansion) -> Expansion {
        self.plus(&other.negated())
    }

    /// The same number with the other sign.
    #[must_use]
    pub fn negated(&self) -> Expansion {
        Expansion(self.0.iter().map(|x| -x).collect())
    }

    /// The product with one float: Shewchuk's SCALE-EXPANSION.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Expansion {
        let mut parts = Vec::with_capacity(2 * self.0.len());
        let mut push = |x: f64| {
            if x != 0.0 {
                parts.push(x);
            }
        };
        let Some((&first, rest)) = self.0.split_first() else { return Expansion::default() };
        let (mut carry, low) = two_product(first, factor);
        push(low);
        for &part in rest {
            let (high, product_low) = two_product(part, factor);
            let (sum, low) = two_sum(carry, product_low);
            push(low);
            let (next, low) = two_sum(high, sum);
            push(low);
            carry = next;
        }
        push(carry);
        Expansion(parts)
    }

    /// The product of both.
    #[must_use]
    pub fn times(&self, other: &Expansion) -> Expansion {
        other.0.iter().fold(Expansion::default(), |sum, &part| sum.plus(&self.scaled(part)))
    }

    /// How the number compares with 0.
    pub fn sign(&self) -> Ordering {
        match self.0.last() {
            Some(x) if *x > 0.0 => Ordering::Greater,
            Some(_) => Ordering::Less,
            None => Ordering::Equal,
        }
    }

    /// The number as one float, within 2^-51 of itself; the sign and 0 are kept.
    pub fn estimate(&self) -> f64 {
        self.0.iter().sum()
    }

    /// The components.
    pub fn parts(&self) -> &[f64] {
        &self.0
    }
}

/// The rounded sum and its rounding error (Knuth).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let high = a + b;
    let b_part = high - a;
    let a_part = high - b_part;
    (high, (a - a_part) + (b - b_part))
}

/// Two halves of the significand (Veltkamp).
fn split(a: f64) -> (f64, f64) {
    let c = 134_217_729.0 * a;
    let high = c - (c - a);
    (high, a - high)
}

/// The rounded product and its rounding error (Dekker). No fused multiply-add, so that the answer
/// is the same on every machine that runs the tests.
fn two_product(a: f64, b: f64) -> (f64, f64) {
    let high = a * b;
    let ((ah, al), (bh, bl)) = (split(a), split(b));
    (high, al * bl - (((high - ah * bh) - al * bh) - ah * bl))
}
