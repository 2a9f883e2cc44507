//! How answers differ from the exact ones.

use serde::{Deserialize, Serialize};

/// By how much the distances of some answers differ from the exact ones, in parts of the diagonal of the
/// scene's box: how far off the point is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Apart {
    /// Answers.
    pub answers: u64,
    /// The mean over them. 0 without any.
    pub mean: f64,
    /// The greatest.
    pub greatest: f64,
}

impl Apart {
    /// Takes one more answer. What is no number counts as the whole diagonal.
    pub fn take(&mut self, apart: f64) {
        let apart = if apart.is_finite() { apart } else { 1.0 };
        self.answers += 1;
        self.mean += (apart - self.mean) / self.answers as f64;
        self.greatest = self.greatest.max(apart);
    }

    /// Those of two sets of answers together.
    #[must_use]
    pub fn and(self, other: Apart) -> Apart {
        let answers = self.answers + other.answers;
        let sum = self.answers as f64 * self.mean + other.answers as f64 * other.mean;
        Apart {
            answers,
            mean: sum / answers.max(1) as f64,
            greatest: self.greatest.max(other.greatest),
        }
    }
}

/// Answers that differ from the exact ones; what each word means is in [`trade::judge`](crate::trade::judge).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Errors {
    /// Rays judged.
    pub rays: u64,
    /// They hit, and the answer was a miss that rounding does not explain.
    pub missing: u64,
    /// They hit, and the answer was another place, farther or nearer than rounding explains.
    pub wrong: u64,
    /// They hit nothing, and the answer was a hit that rounding does not explain.
    pub phantom: u64,
    /// Answers of any of these kinds that rounding explains; they are no errors.
    pub rounded: u64,
    /// Right answers that name the exact triangle.
    pub same: Apart,
    /// Right answers that name another triangle.
    pub other: Apart,
    /// Rounded answers: the ray passes an outline within rounding, so they may be anywhere.
    pub outline: Apart,
    /// Wrong answers.
    pub off: Apart,
}

impl Errors {
    /// All errors.
    pub fn all(&self) -> u64 {
        self.missing + self.wrong + self.phantom
    }

    /// A count of these rays, for each million of them. 0 without rays.
    pub fn per_million(&self, count: u64) -> f64 {
        if self.rays == 0 { 0.0 } else { 1e6 * count as f64 / self.rays as f64 }
    }
}
