//! Which settings no other setting beats.

use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// How a setting stands among others, in the sense of Pareto. One beats another when it is worse in no figure and
/// better in one, beyond the noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Standing {
    /// Optimal: it is better than each of the others in some figure, beyond the noise, so none can beat it.
    Optimal,
    /// None beats it beyond the noise, but of one at least it is not told apart in what would save it.
    Perhaps,
    /// Another beats it.
    Beaten,
}

impl Standing {
    /// Its name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Standing::Optimal => "optimal",
            Standing::Perhaps => "perhaps",
            Standing::Beaten => "beaten",
        }
    }

    /// As a table marks it.
    pub const fn mark(self) -> &'static str {
        match self {
            Standing::Optimal => "opt",
            Standing::Perhaps => "opt?",
            Standing::Beaten => "",
        }
    }
}

/// How `count` settings stand. `compare(i, j)` compares the figures of two of them, equal where they are not told apart.
pub fn standings<const N: usize>(
    count: usize,
    compare: impl Fn(usize, usize) -> [Ordering; N],
) -> Vec<Standing> {
    let standing = |own: usize| {
        let others = || (0..count).filter(|&other| other != own).map(|other| compare(own, other));
        let beaten = |figures: [Ordering; N]| {
            figures.iter().all(|figure| figure.is_ge())
                && figures.iter().any(|figure| figure.is_gt())
        };
        if others().any(beaten) {
            Standing::Beaten
        } else if others().all(|figures| figures.iter().any(|figure| figure.is_lt())) {
            Standing::Optimal
        } else {
            Standing::Perhaps
        }
    };
    (0..count).map(standing).collect()
}

#[cfg(test)]
mod tests {
    use super::Standing::{Beaten, Optimal, Perhaps};
    use super::*;

    fn of<const N: usize>(points: &[[f64; N]]) -> Vec<Standing> {
        standings::<N>(points.len(), |i, j| {
            std::array::from_fn(|k| points[i][k].partial_cmp(&points[j][k]).unwrap())
        })
    }

    #[test]
    fn a_staircase() {
        let points = [[1.0, 4.0], [2.0, 2.0], [4.0, 1.0], [3.0, 3.0], [2.0, 2.0], [1.0, 5.0]];
        assert_eq!(of(&points), [Optimal, Perhaps, Optimal, Beaten, Perhaps, Beaten]);
        assert_eq!(of::<3>(&[]), Vec::new());
        assert_eq!(of(&[[1.0]]), [Optimal], "the only one");
        assert_eq!(of(&[[0.0], [-0.0]]), [Perhaps; 2], "equal ones do not beat each other");
    }

    #[test]
    fn what_is_not_told_apart_beats_nothing_and_is_not_sure_to_be_optimal() {
        // Apart are only figures more than 1 apart.
        let figures: [f64; 3] = [1.0, 1.8, 2.6];
        let compare = |i: usize, j: usize| {
            let apart = figures[i] - figures[j];
            [if apart < -1.0 {
                Ordering::Less
            } else if apart > 1.0 {
                Ordering::Greater
            } else {
                Ordering::Equal
            }]
        };
        assert_eq!(standings(3, compare), [Perhaps, Perhaps, Beaten]);
    }
}
