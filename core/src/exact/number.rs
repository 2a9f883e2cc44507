//! Numbers that predicates are made of: in `f64` with a bound on the error, and whole.
//!
//! A predicate is written once. It is decided in [`Bounded`], and where that cannot, in whole numbers ([`Integer`]), which always can.

use core::cmp::Ordering;

use super::integer::{Integer, Whole};
use super::meeting::EPSILON;

/// Sums, differences and products of floats. A predicate of degree 6 in floats fits [`Bounded`] and [`Integer`].
pub(super) trait Number: Clone {
    /// A finite float.
    fn of(x: f32) -> Self;
    /// `a - b` of two finite floats.
    fn difference(a: f32, b: f32) -> Self;
    fn plus(&self, other: &Self) -> Self;
    fn minus(&self, other: &Self) -> Self;
    fn times(&self, other: &Self) -> Self;
    /// How it compares with 0; `None` where that is not known.
    fn sign(&self) -> Option<Ordering>;
}

impl<const LIMBS: usize> Number for Whole<LIMBS> {
    fn of(x: f32) -> Self {
        Self::from_float(x)
    }
    fn difference(a: f32, b: f32) -> Self {
        Whole::difference(a, b)
    }
    fn plus(&self, other: &Self) -> Self {
        Whole::plus(self, other)
    }
    fn minus(&self, other: &Self) -> Self {
        Whole::minus(self, other)
    }
    fn times(&self, other: &Self) -> Self {
        Whole::times(self, other)
    }
    fn sign(&self) -> Option<Ordering> {
        Some(Whole::sign(self))
    }
}

/// A number within `error` of `value`. Products of six floats neither overflow in `f64` nor, snapped, become subnormal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounded {
    value: f64,
    error: f64,
}

/// Errors are sums of a few roundings, and err by few themselves.
pub(super) const WIDER: f64 = 1.0 + 16.0 * f64::EPSILON;

impl Bounded {
    /// A sum: what it loses is known (Knuth's two-sum).
    fn sum(a: f64, b: f64, error: f64) -> Bounded {
        let value = a + b;
        let part = value - a;
        let lost = (a - (value - part)) + (b - part);
        Bounded { value, error: (error + lost.abs()) * WIDER }
    }
}

impl Number for Bounded {
    #[inline]
    fn of(x: f32) -> Bounded {
        Bounded { value: f64::from(x), error: 0.0 }
    }
    #[inline]
    fn difference(a: f32, b: f32) -> Bounded {
        Bounded::sum(f64::from(a), -f64::from(b), 0.0)
    }
    #[inline]
    fn plus(&self, other: &Bounded) -> Bounded {
        Bounded::sum(self.value, other.value, self.error + other.error)
    }
    #[inline]
    fn minus(&self, other: &Bounded) -> Bounded {
        Bounded::sum(self.value, -other.value, self.error + other.error)
    }
    #[inline]
    fn times(&self, other: &Bounded) -> Bounded {
        let value = self.value * other.value;
        let carried = self.value.abs() * other.error
            + other.value.abs() * self.error
            + self.error * other.error;
        Bounded { value, error: (carried + value.abs() * EPSILON) * WIDER }
    }
    #[inline]
    fn sign(&self) -> Option<Ordering> {
        if self.value > self.error {
            Some(Ordering::Greater)
        } else if self.value < -self.error {
            Some(Ordering::Less)
        } else if self.error == 0.0 {
            Some(Ordering::Equal)
        } else {
            None
        }
    }
}

pub(super) type Vector<N> = [N; 3];

pub(super) fn vector<N: Number>(a: &[f32; 3], b: &[f32; 3]) -> Vector<N> {
    [0, 1, 2].map(|axis| N::difference(a[axis], b[axis]))
}

/// `a b - c d`.
pub(super) fn determinant<N: Number>(a: &N, b: &N, c: &N, d: &N) -> N {
    a.times(b).minus(&c.times(d))
}

pub(super) fn cross<N: Number>(a: &Vector<N>, b: &Vector<N>) -> Vector<N> {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| determinant(&a[i], &b[j], &a[j], &b[i]))
}

pub(super) fn dot<N: Number>(a: &Vector<N>, b: &Vector<N>) -> N {
    a[0].times(&b[0]).plus(&a[1].times(&b[1])).plus(&a[2].times(&b[2]))
}

/// Whether a number is not negative.
pub(super) fn at_least_zero<N: Number>(x: &N) -> Option<bool> {
    x.sign().map(Ordering::is_ge)
}

/// Whether `a <= b`.
pub(super) fn at_most<N: Number>(a: &N, b: &N) -> Option<bool> {
    at_least_zero(&b.minus(a))
}

/// Whether both hold.
pub(super) fn both(a: Option<bool>, b: impl FnOnce() -> Option<bool>) -> Option<bool> {
    match a {
        Some(false) => Some(false),
        Some(true) => b(),
        None => match b() {
            Some(false) => Some(false),
            _ => None,
        },
    }
}

/// Whether one of them holds.
pub(super) fn either(a: Option<bool>, b: impl FnOnce() -> Option<bool>) -> Option<bool> {
    match a {
        Some(true) => Some(true),
        Some(false) => b(),
        None => match b() {
            Some(true) => Some(true),
            _ => None,
        },
    }
}

/// A question about floats, in any kind of number.
pub(super) trait Predicate {
    /// The answer, if these numbers know it. Whole ones do.
    fn answer<N: Number>(&self) -> Option<bool>;

    /// The answer.
    fn decide(&self) -> bool {
        let fast = self.answer::<Bounded>();
        fast.unwrap_or_else(|| self.answer::<Integer>().unwrap_or(false))
    }
}
