//! Sine and cosine from `+ - *` only: libraries of platforms differ in the last bit, and a built-in
//! scene must be the same bytes everywhere.

/// Sine and cosine of an angle in turns (1 is a full circle), to about 1e-15.
pub(crate) fn sin_cos(turns: f64) -> (f64, f64) {
    // To the nearest quarter turn, then two short series on at most an eighth of a turn.
    let quarters = (turns * 4.0).round();
    let x = (turns - quarters * 0.25) * std::f64::consts::TAU;
    let y = x * x;
    let sin = x * series(y, 1.0);
    let cos = series(y, 0.0);
    match quarters.rem_euclid(4.0) as u8 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// `1 - y / ((k+1)(k+2)) (1 - y / ((k+3)(k+4)) (...))`: cosine for k = 0, sine over x for k = 1.
fn series(y: f64, k: f64) -> f64 {
    (0..9).rev().fold(1.0, |sum, term| {
        let n = k + 2.0 * f64::from(term);
        1.0 - y / ((n + 1.0) * (n + 2.0)) * sum
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_library() {
        for step in -300..300 {
            let turns = f64::from(step) / 97.0;
            let (sin, cos) = (turns * std::f64::consts::TAU).sin_cos();
            let (s, c) = sin_cos(turns);
            assert!((s - sin).abs() < 1e-13 && (c - cos).abs() < 1e-13, "{turns}");
        }
    }
}
