//! What the survey claims in passing and prints no figures for, measured: how build times and the search for a plane grow,
//! how cubic cells are, how evenly rays and space are divided.

mod growth;
mod shapes;
mod visits;

use super::ReportError;
use super::scene::{Placed, Settings};
use super::table::{Cell, Table};
use growth::{growth, small_nodes};
use serde::Serialize;
use shapes::shapes;

/// The seed of random triangles and lines.
const SEED: u64 = 2012;

/// A claim and what was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claim {
    /// The section of the survey.
    pub section: &'static str,
    /// What it claims.
    pub claim: &'static str,
    /// What was measured.
    pub measured: String,
    /// The figure.
    pub value: f64,
    /// Its standard error, for a figure that is fitted.
    pub error: Option<f64>,
    /// The figure that the claim would give.
    pub expected: Option<f64>,
    /// Whether that is a bound from above, as with O(n), not a value.
    pub bound: bool,
    /// In what unit.
    pub unit: &'static str,
}

impl Claim {
    /// Whether it holds: within two standard errors, or without one within a tenth; where it is a bound, being less is as good.
    /// None where nothing is expected.
    pub fn holds(&self) -> Option<bool> {
        let expected = self.expected?;
        let most = self.error.map_or(0.1 * expected.abs(), |error| 2.0 * error);
        let over = self.value - expected;
        Some(over <= most && (self.bound || over >= -most))
    }
}

/// How much is measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Amounts {
    /// Triangles of the scenes whose builds are timed, from few to many.
    pub triangles: Vec<usize>,
    /// Builds of small nodes, of which the median counts.
    pub small_builds: usize,
    /// Uniform lines that are followed through a tree.
    pub lines: usize,
    /// Most of a frame's rays that are.
    pub rays: usize,
}

impl Amounts {
    /// Those of a report, or of a quick one.
    pub fn of(quick: bool) -> Amounts {
        let (least, sizes, small_builds, lines, rays) =
            if quick { (2_000, 3, 41, 500, 500) } else { (16_000, 5, 1_001, 20_000, 20_000) };
        let triangles = (0..sizes).map(|size| least << size).collect();
        Amounts { triangles, small_builds, lines, rays }
    }
}

/// Measures the claims; cells and rays on a scene and its trees.
///
/// # Errors
/// A tree that cannot be built.
pub fn measure(
    placed: &Placed,
    settings: &Settings,
    amounts: &Amounts,
) -> Result<Vec<Claim>, ReportError> {
    let mut out = growth(settings, amounts)?;
    out.push(small_nodes(amounts)?);
    out.extend(shapes(placed, settings, amounts)?);
    Ok(out)
}

/// The claims as a table.
pub fn table(claims: &[Claim]) -> Table {
    let head =
        ["section", "claim", "measured", "found", "standard error", "as claimed", "holds", "unit"];
    let mut table = Table::new(&head);
    for claim in claims {
        table.push(vec![
            claim.section.into(),
            claim.claim.into(),
            claim.measured.as_str().into(),
            Cell::Number(claim.value, 3),
            Cell::number(claim.error, 3),
            Cell::number(claim.expected, 3),
            claim.holds().map_or(Cell::Missing, |holds| if holds { "yes" } else { "no" }.into()),
            claim.unit.into(),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claims_hold_within_their_errors_and_bounds_below_too() {
        let claim = |value, error, expected, bound| Claim {
            section: "",
            claim: "",
            measured: String::new(),
            value,
            error,
            expected,
            bound,
            unit: "",
        };
        assert_eq!(claim(1.19, Some(0.1), Some(1.0), false).holds(), Some(true));
        assert_eq!(claim(1.21, Some(0.1), Some(1.0), true).holds(), Some(false));
        assert_eq!(claim(0.79, Some(0.1), Some(1.0), false).holds(), Some(false));
        assert_eq!(claim(0.79, Some(0.1), Some(1.0), true).holds(), Some(true));
        assert_eq!(claim(2.19, None, Some(2.0), false).holds(), Some(true));
        assert_eq!(claim(2.21, None, Some(2.0), false).holds(), Some(false));
        assert_eq!(claim(2.21, None, None, false).holds(), None);
    }
}
