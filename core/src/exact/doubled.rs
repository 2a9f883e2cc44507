//! Sums of two `f64` that do not overlap: about 104 bits (Dekker 1971). For cases that `f64` alone
//! cannot decide and for which whole numbers would take long, such as the weights of hits that are
//! far away.
//!
//! Nothing here overflows or underflows for triple products of differences of floats.

/// A sum of two `f64`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Doubled {
    /// The rounded value.
    pub high: f64,
    /// The remainder.
    pub low: f64,
}

/// Error of a triple product, as a part of its terms' magnitudes: a difference has no error, a
/// product 2^-102 and a sum 2^-104 of the greater operand; there are two products and three sums
/// per term.
pub(super) const DOUBLED_ERROR: f64 = 1.0 / (1u128 << 98) as f64;

/// `a + b` without error (Knuth).
#[inline]
fn two_sum(a: f64, b: f64) -> Doubled {
    let high = a + b;
    let part = high - a;
    Doubled { high, low: (a - (high - part)) + (b - part) }
}

/// An `f64` as a sum of two with half as many bits (Veltkamp).
#[inline]
fn split(a: f64) -> (f64, f64) {
    let scaled = a * 134_217_729.0; // 2^27 + 1
    let high = scaled - (scaled - a);
    (high, a - high)
}

/// `a * b` without error.
#[inline]
pub(super) fn two_product(a: f64, b: f64) -> Doubled {
    let high = a * b;
    let ((a, c), (b, d)) = (split(a), split(b));
    Doubled { high, low: c * d - (((high - a * b) - c * b) - a * d) }
}

impl Doubled {
    /// Nothing.
    pub(super) const ZERO: Doubled = Doubled { high: 0.0, low: 0.0 };

    /// `a - b` of floats, without error.
    pub(super) fn difference(a: f32, b: f32) -> Doubled {
        two_sum(f64::from(a), -f64::from(b))
    }

    #[inline]
    fn renormalised(high: f64, low: f64) -> Doubled {
        let sum = high + low;
        Doubled { high: sum, low: low - (sum - high) }
    }

    pub(super) fn plus(self, other: Doubled) -> Doubled {
        let Doubled { high, low } = two_sum(self.high, other.high);
        Doubled::renormalised(high, low + (self.low + other.low))
    }

    pub(super) fn minus(self, other: Doubled) -> Doubled {
        self.plus(Doubled { high: -other.high, low: -other.low })
    }

    pub(super) fn times(self, other: Doubled) -> Doubled {
        let Doubled { high, low } = two_product(self.high, other.high);
        Doubled::renormalised(high, low + (self.high * other.low + self.low * other.high))
    }
}

/// `d . (p x q)`, and the sum of the magnitudes of its terms.
pub(super) fn triple(d: &[f32; 3], p: &[Doubled; 3], q: &[Doubled; 3]) -> (Doubled, f64) {
    let (mut value, mut magnitude) = (Doubled::ZERO, 0.0);
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let (left, right) = (p[i].times(q[j]), p[j].times(q[i]));
        let along = Doubled { high: f64::from(d[k]), low: 0.0 };
        value = value.plus(along.times(left.minus(right)));
        magnitude += along.high.abs() * (left.high.abs() + right.high.abs());
    }
    (value, magnitude)
}
