//! The straight line of least squares through points.

/// A line, and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// `y = slope x + intercept`. 0 where all x are equal.
    pub slope: f64,
    /// See `slope`.
    pub intercept: f64,
    /// The coefficient of determination; 1 where y does not vary.
    pub r_squared: f64,
    /// The standard error of the slope; two points have none.
    pub error: Option<f64>,
}

/// Fits points of (x, y).
pub fn fit(points: &[[f64; 2]]) -> Fit {
    let n = points.len().max(1) as f64;
    let mean = |value: &dyn Fn(&[f64; 2]) -> f64| points.iter().map(value).sum::<f64>() / n;
    let (x, y) = (mean(&|p| p[0]), mean(&|p| p[1]));
    let xx = mean(&|p| (p[0] - x) * (p[0] - x));
    let xy = mean(&|p| (p[0] - x) * (p[1] - y));
    let yy = mean(&|p| (p[1] - y) * (p[1] - y));
    let slope = if xx > 0.0 { xy / xx } else { 0.0 };
    let r_squared = if xx > 0.0 && yy > 0.0 { xy * xy / (xx * yy) } else { 1.0 };
    let rest = mean(&|p| (p[1] - y - slope * (p[0] - x)).powi(2));
    let error = (points.len() > 2 && xx > 0.0).then(|| (rest / (n - 2.0) / xx).sqrt());
    Fit { slope, intercept: y - slope * x, r_squared, error }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_fitted_and_scatter_is_seen() {
        let found = fit(&[[0.0, 5.0], [1.0, 7.0], [2.0, 9.0]]);
        assert!((found.slope - 2.0).abs() < 1e-12 && (found.intercept - 5.0).abs() < 1e-12);
        assert!((found.r_squared - 1.0).abs() < 1e-12 && found.error.unwrap() < 1e-9);
        assert!(fit(&[[0.0, 5.0], [1.0, 9.0], [2.0, 5.0]]).r_squared < 1e-12);
        // Residuals of -1/6, 1/3, -1/6 about a slope of 1/2: the root of (1/6) / 1 / 2.
        let found = fit(&[[0.0, 0.0], [1.0, 1.0], [2.0, 1.0]]);
        let expected = (1.0f64 / 12.0).sqrt();
        assert!((found.slope - 0.5).abs() < 1e-12);
        assert!((found.error.unwrap() - expected).abs() < 1e-12, "{found:?}");
        let found = fit(&[[0.0, 0.0], [1.0, 3.0]]);
        assert_eq!((found.slope, found.error), (3.0, None));
    }
}
