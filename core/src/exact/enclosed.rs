//! Numbers of any magnitude in `f64`, with a bound on the error.
//!
//! As [`Bounded`](super::number), but for more factors: what overflows is not known, what underflows is allowed for, and products that `f64` holds
//! have no error, so that small whole numbers are decided here.

use core::cmp::Ordering;

use super::doubled::two_product;
use super::meeting::EPSILON;
use super::number::{Number, WIDER};

/// A number within `error` of `value`; not known where either is no number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Enclosed {
    value: f64,
    error: f64,
}

/// What rounding takes from a product of a magnitude between these is computed without error.
const LEAST: f64 = 1e-250;
const MOST: f64 = 1e250;

impl Enclosed {
    fn is_zero(&self) -> bool {
        self.value == 0.0 && self.error == 0.0
    }

    fn sum(a: f64, b: f64, error: f64) -> Enclosed {
        let value = a + b;
        let part = value - a;
        let lost = (a - (value - part)) + (b - part);
        Enclosed { value, error: (error + lost.abs()) * WIDER }
    }

    /// The number times a power of two.
    pub(super) fn scaled(&self, power: f64) -> Enclosed {
        let lost = if self.error == 0.0 { 0.0 } else { f64::MIN_POSITIVE };
        let value = self.value * power;
        let lost = if value.abs() < LEAST && !self.is_zero() { f64::MIN_POSITIVE } else { lost };
        Enclosed { value, error: self.error * power + lost }
    }

    /// About what it is.
    pub(super) fn about(&self) -> f64 {
        self.value
    }
}

impl Number for Enclosed {
    fn of(x: f32) -> Enclosed {
        Enclosed { value: f64::from(x), error: 0.0 }
    }

    fn difference(a: f32, b: f32) -> Enclosed {
        Enclosed::sum(f64::from(a), -f64::from(b), 0.0)
    }

    fn plus(&self, other: &Enclosed) -> Enclosed {
        Enclosed::sum(self.value, other.value, self.error + other.error)
    }

    fn minus(&self, other: &Enclosed) -> Enclosed {
        Enclosed::sum(self.value, -other.value, self.error + other.error)
    }

    fn times(&self, other: &Enclosed) -> Enclosed {
        if self.is_zero() || other.is_zero() {
            return Enclosed { value: 0.0, error: 0.0 };
        }
        let value = self.value * other.value;
        let magnitude = value.abs();
        let rounded = if LEAST < magnitude && magnitude < MOST {
            two_product(self.value, other.value).low.abs()
        } else {
            magnitude * EPSILON + f64::MIN_POSITIVE
        };
        let carried = match self.error == 0.0 && other.error == 0.0 {
            true => 0.0,
            false => {
                (self.value.abs() * other.error + other.value.abs() * self.error)
                    + (self.error * other.error + f64::MIN_POSITIVE)
            }
        };
        Enclosed { value, error: (carried + rounded) * WIDER }
    }

    fn sign(&self) -> Option<Ordering> {
        if self.value > self.error {
            Some(Ordering::Greater)
        } else if self.value < -self.error {
            Some(Ordering::Less)
        } else if self.is_zero() {
            Some(Ordering::Equal)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(value: f64) -> Enclosed {
        Enclosed { value, error: 0.0 }
    }

    #[test]
    fn small_whole_numbers_have_no_error_and_others_have_one() {
        let square = |x: f32| Enclosed::of(x).times(&Enclosed::of(x));
        assert_eq!(
            square(3.0).plus(&square(4.0)).minus(&square(5.0)).sign(),
            Some(Ordering::Equal)
        );
        let third = of(1.0 / 3.0);
        let ninth = third.times(&third);
        assert!(ninth.error > 0.0 && ninth.error < 1e-16, "{ninth:?}");
        assert_eq!(ninth.minus(&of(ninth.value)).sign(), None);
        assert_eq!(ninth.sign(), Some(Ordering::Greater));
    }

    #[test]
    fn what_overflows_or_underflows_is_not_known() {
        let (most, least) = (of(1e200), of(1e-200));
        assert_eq!(most.times(&most).sign(), None);
        assert_eq!(most.times(&most).minus(&most.times(&most)).sign(), None);
        assert_eq!(least.times(&least).sign(), None);
        assert_eq!(least.times(&of(0.0)).sign(), Some(Ordering::Equal));
        assert_eq!(least.scaled(1e-200).sign(), None);
        assert_eq!(least.scaled(2.0).sign(), Some(Ordering::Greater));
        // Neither is what an error that underflows is part of.
        let unsure = Enclosed { value: 0.0, error: 1e-200 };
        assert_eq!(unsure.times(&least).sign(), None);
        assert_eq!(unsure.times(&of(0.0)).sign(), Some(Ordering::Equal));
    }
}
