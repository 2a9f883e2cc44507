//! Linear models by least squares.

/// How many coefficients.
const TERMS: usize = 3;

/// A number as a linear function of terms.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fit {
    coefficients: [f64; TERMS],
    /// The standard deviation of what was measured from this.
    pub(super) spread: f64,
}

impl Fit {
    /// The one with the least sum of squares over what was measured; `None` where nothing was. Terms that others make up, such as the size
    /// where all scenes have one size, get no weight.
    pub(super) fn least_squares(
        measured: impl Iterator<Item = ([f64; TERMS], f64)> + Clone,
    ) -> Option<Fit> {
        let count = measured.clone().count();
        if count == 0 {
            return None;
        }
        // Relative to the means, so that a term of small variance is told from a constant.
        let mut means = [0.0; TERMS + 1];
        for (terms, value) in measured.clone() {
            for (mean, x) in means.iter_mut().zip(terms.into_iter().chain([value])) {
                *mean += x / count as f64;
            }
        }
        let mut equations = [[0.0; TERMS + 1]; TERMS];
        for (terms, value) in measured.clone() {
            let mut row = [0.0; TERMS + 1];
            for (place, x) in terms.into_iter().chain([value]).enumerate() {
                row[place] = x - means[place];
            }
            for (equation, x) in equations.iter_mut().zip(row) {
                for (sum, y) in equation.iter_mut().zip(row) {
                    *sum += x * y;
                }
            }
        }
        let slopes = solve(equations);
        let mut coefficients = slopes;
        // The first term is 1: it takes up what the others leave.
        let others = (1..TERMS).map(|term| slopes[term] * means[term]).sum::<f64>();
        coefficients[0] = means[TERMS] - others;
        let mut fit = Fit { coefficients, spread: 0.0 };
        let squares = measured.map(|(terms, value)| (value - fit.at(&terms)).powi(2)).sum::<f64>();
        let used = 1 + slopes[1..].iter().filter(|slope| **slope != 0.0).count();
        fit.spread = (squares / count.saturating_sub(used).max(1) as f64).sqrt();
        Some(fit)
    }

    /// Its value.
    pub(super) fn at(&self, terms: &[f64; TERMS]) -> f64 {
        self.coefficients.iter().zip(terms).map(|(coefficient, term)| coefficient * term).sum()
    }
}

/// Solves symmetric equations; unknowns that others make up are 0.
fn solve(mut equations: [[f64; TERMS + 1]; TERMS]) -> [f64; TERMS] {
    let before: [f64; TERMS] = std::array::from_fn(|place| equations[place][place]);
    let mut solved = [false; TERMS];
    for place in 0..TERMS {
        let pivot = equations[place][place];
        // What elimination leaves of a dependent term is rounding.
        if pivot <= 1e-9 * before[place] || pivot <= 1e-12 {
            continue;
        }
        solved[place] = true;
        let own = equations[place];
        for (other, equation) in equations.iter_mut().enumerate() {
            if other != place {
                let factor = equation[place] / pivot;
                for (x, y) in equation.iter_mut().zip(own) {
                    *x -= factor * y;
                }
            }
        }
    }
    std::array::from_fn(|place| match solved[place] {
        true => equations[place][TERMS] / equations[place][place],
        false => 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers that are linear are met, and their coefficients found.
    #[test]
    fn lines_are_met() {
        let value = |x: f64, y: f64| 2.0 - 0.5 * x + 7.0 * y;
        let places = [(1.0, 0.1), (2.0, 0.9), (5.0, 0.3), (9.0, 0.4)];
        let fit = Fit::least_squares(places.into_iter().map(|(x, y)| ([1.0, x, y], value(x, y))))
            .unwrap();
        for (found, wanted) in fit.coefficients.into_iter().zip([2.0, -0.5, 7.0]) {
            assert!((found - wanted).abs() < 1e-9, "{fit:?}");
        }
        assert!(fit.spread < 1e-9, "{fit:?}");
    }

    /// The closed form of a line through points that are on none: slope 1.4, intercept 3.5 - 1.4 * 2.5; squares 1.2 + 1.2 ... by hand.
    #[test]
    fn a_line_between_points_has_the_least_squares() {
        let points = [(1.0, 6.0), (2.0, 5.0), (3.0, 7.0), (4.0, 10.0)];
        let fit = Fit::least_squares(points.into_iter().map(|(x, y)| ([1.0, x, 0.0], y))).unwrap();
        assert!((fit.coefficients[1] - 1.4).abs() < 1e-12, "{fit:?}");
        assert!((fit.coefficients[0] - 3.5).abs() < 1e-12, "{fit:?}");
        // Residuals 1.1, -1.3, -0.7, 0.9: squares 4.2 over two degrees of freedom.
        assert!((fit.spread - 2.1_f64.sqrt()).abs() < 1e-12, "{fit:?}");
    }

    #[test]
    fn terms_that_tell_nothing_have_no_weight() {
        let one = |y| ([1.0, 4.0, 0.25], y);
        let fit = Fit::least_squares([one(2.0), one(4.0)].into_iter()).unwrap();
        assert_eq!(fit.coefficients, [3.0, 0.0, 0.0]);
        // The third is a multiple of the second.
        let line = |x: f64| ([1.0, x, 2.0 * x], 10.0 * x);
        let fit = Fit::least_squares([line(1.0), line(2.0), line(7.0)].into_iter()).unwrap();
        assert!((fit.at(&[1.0, 3.0, 6.0]) - 30.0).abs() < 1e-9, "{fit:?}");
        assert_eq!(fit.coefficients[2], 0.0);
        assert_eq!(Fit::least_squares(std::iter::empty()), None);
    }
}
