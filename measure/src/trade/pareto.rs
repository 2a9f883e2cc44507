//! Which settings no other setting beats.

use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// How a setting stands among others, in the sense of Pareto. One beats another when it is better in one figure beyond the
/// noise, and in no figure worse at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Standing {
    /// Optimal: it is better than each of the others in some figure, beyond the noise, so none can beat it.
    Optimal,
    /// None beats it, but what saves it from one of them may be noise.
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

/// How `count` settings stand. Of two of them, `apart` compares the figures beyond the noise, equal where they are not told
/// apart, and `seen` as they were measured. So between what is optimal in one run and beaten in the next lies the noise.
pub fn standings<const N: usize>(
    count: usize,
    apart: impl Fn(usize, usize) -> [Ordering; N],
    seen: impl Fn(usize, usize) -> [Ordering; N],
) -> Vec<Standing> {
    let standing = |own: usize| {
        let others = || (0..count).filter(move |&other| other != own);
        let beats = |other: usize| {
            apart(own, other).iter().any(|figure| figure.is_gt())
                && seen(own, other).iter().all(|figure| figure.is_ge())
        };
        let saved = |other: usize| apart(own, other).iter().any(|figure| figure.is_lt());
        match (others().any(beats), others().all(saved)) {
            (true, _) => Standing::Beaten,
            (false, true) => Standing::Optimal,
            (false, false) => Standing::Perhaps,
        }
    };
    (0..count).map(standing).collect()
}

#[cfg(test)]
mod tests {
    use super::Standing::{Beaten, Optimal, Perhaps};
    use super::*;

    fn of<const N: usize>(points: &[[f64; N]]) -> Vec<Standing> {
        let compare = |i: usize, j: usize| -> [Ordering; N] {
            std::array::from_fn(|k| points[i][k].partial_cmp(&points[j][k]).unwrap())
        };
        standings::<N>(points.len(), compare, compare)
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
    fn what_is_not_told_apart_is_not_sure() {
        // Apart are only figures more than 1 apart.
        let of = |points: &[[f64; 2]]| {
            let seen = |i: usize, j: usize| -> [Ordering; 2] {
                std::array::from_fn(|k| points[i][k].total_cmp(&points[j][k]))
            };
            let apart = |i: usize, j: usize| -> [Ordering; 2] {
                std::array::from_fn(|k| match points[i][k] - points[j][k] {
                    apart if apart.abs() <= 1.0 => Ordering::Equal,
                    apart => apart.total_cmp(&0.0),
                })
            };
            standings(points.len(), apart, seen)
        };
        assert_eq!(of(&[[1.0, 0.0], [1.8, 0.0], [2.6, 0.0]]), [Perhaps, Perhaps, Beaten]);
        // Far worse in one figure, a little better in the other: that may be noise, or save it.
        assert_eq!(of(&[[1.0, 1.5], [9.0, 1.0]]), [Optimal, Perhaps]);
        assert_eq!(of(&[[1.0, 1.0], [9.0, 1.5]]), [Optimal, Beaten]);
        assert_eq!(of(&[[1.0, 9.0], [9.0, 1.0]]), [Optimal, Optimal]);
    }
}
