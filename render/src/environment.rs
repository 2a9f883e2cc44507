//! Light from everywhere. But for maps, a twin of `environment.wgsl`.

use crate::environment_map::MapSample;
use crate::layout::Frame;
use crate::planted::{Fault, is_planted};
use crate::scene_words::SceneWords;
use crate::vector::{Vector, add, mix, scaled, sub};

/// Radiance from a direction of length 1.
pub(crate) fn radiance(scene: &SceneWords<'_>, direction: Vector) -> Vector {
    if let Some(map) = scene.environment {
        return map.radiance(direction);
    }
    let frame = scene.frame;
    let height = direction[1];
    if height >= 0.0 {
        mix(frame.horizon, frame.zenith, height)
    } else {
        mix(frame.horizon, frame.nadir, -height)
    }
}

/// The sample of a map that two random words choose; `None` where there is no map, or nothing comes from there.
pub(crate) fn sample(scene: &SceneWords<'_>, words: [u32; 2]) -> Option<MapSample> {
    let mut sample = scene.environment?.sample(words);
    if is_planted(scene.frame, Fault::MapDensity) {
        sample.density *= 4.0;
    }
    (sample.density > 0.0).then_some(sample)
}

/// Irradiance by what is no map, of a surface with this normal that nothing occludes, over pi: the radiance that it sends
/// back when it is white.
pub(crate) fn irradiance(frame: &Frame, normal: Vector) -> Vector {
    let above = scaled(sub(frame.zenith, frame.horizon), hemisphere(normal[1]));
    let below = scaled(sub(frame.nadir, frame.horizon), hemisphere(-normal[1]));
    add(add(frame.horizon, above), below)
}

/// The mean over a cosine-weighted hemisphere of the height of directions above the horizon, `max(0,
/// y)`, by the cosine of the hemisphere's axis to the zenith. The first three terms in spherical
/// harmonics (Ramamoorthi and Hanrahan 2001), within 0.01 of the closed form.
fn hemisphere(cosine: f32) -> f32 {
    let quadratic = (cosine * cosine) * 0.117_187_5;
    (0.210_937_5 + cosine * (1.0 / 3.0)) + quadratic
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The closed form: `2/3pi (sin a + (pi - a) cos a)` for the angle `a` between axis and zenith.
    #[test]
    fn hemispheres_are_near_the_closed_form() {
        for i in 0..=64 {
            let angle = std::f64::consts::PI * f64::from(i) / 64.0;
            let exact = 2.0 / (3.0 * std::f64::consts::PI)
                * (angle.sin() + (std::f64::consts::PI - angle) * angle.cos());
            let error = f64::from(hemisphere(angle.cos() as f32)) - exact;
            assert!(error.abs() < 0.01, "{angle}: {error}");
        }
    }
}
