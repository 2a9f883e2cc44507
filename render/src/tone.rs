//! Converts radiance to screen pixels. Twin of `tone.wgsl`.
//!
//! Radiance `x` times the exposure goes through `x (1 + x / 4) / (1 + x)` (Reinhard et al. 2002, white
//! at 2) channel by channel, and the result is encoded as sRGB (IEC 61966-2-1), to the nearest of 256
//! values.

use crate::scene_words::SceneWords;

/// The screen pixel of a radiance. The last component counts rays that were not followed to their
/// end; where there are any, the result's alpha is 0, else 255.
pub(crate) fn shown(scene: &SceneWords<'_>, radiance: [f32; 4]) -> u32 {
    let mut word = if radiance[3] > 0.0 { 0 } else { 0xff00_0000 };
    for channel in 0..3 {
        let value = curve(radiance[channel] * scene.frame.exposure);
        word |= scene.shown(value) << (8 * channel);
    }
    word
}

fn curve(x: f32) -> f32 {
    // Beyond white, where the curve would continue to rise, and for NaN.
    if x < 2.0 { (x * (1.0 + x * 0.25)) / (1.0 + x) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_is_steady_and_reaches_white() {
        assert_eq!(curve(0.0), 0.0);
        assert_eq!(curve(f32::INFINITY), 1.0);
        assert_eq!(curve(f32::NAN), 1.0);
        let steps: Vec<f32> = (0..=200).map(|i| curve(i as f32 * 0.01)).collect();
        assert!(steps.windows(2).all(|pair| pair[0] < pair[1]));
        assert!((steps[199] - 1.0).abs() < 0.01);
    }
}
