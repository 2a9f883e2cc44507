//! Lights of a scene, in addition to surfaces that shine and the environment.

/// A source of light without a size.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Light {
    /// A point that shines evenly in all directions.
    Point {
        /// Where it is.
        position: [f32; 3],
        /// Irradiance of a surface that faces the light at `distance`, linear red, green and blue;
        /// elsewhere it falls off with the square of the distance.
        irradiance: [f32; 3],
        /// The distance for which `irradiance` is given, more than 0. With it, and not a radiant
        /// intensity `irradiance * distance^2`, scenes of any size stay within the range of `f32`.
        distance: f32,
    },
    /// A light so far away that its rays are parallel, such as the sun.
    Directional {
        /// The direction from a surface to the light, of any length but zero.
        towards: [f32; 3],
        /// Irradiance of a surface that faces the light.
        irradiance: [f32; 3],
    },
}

impl Light {
    /// The total irradiance of the viewed surfaces by lights chosen for a scene, warm white:
    /// a white surface that faces them shows a radiance of about 1.1.
    pub const DAYLIGHT: [f32; 3] = [3.7, 3.45, 3.05];

    /// A point light at `position` that gives the given irradiance to a surface at `look_at` that
    /// faces it. Where the two are the same, or too near or far for `f32`, the distance is the
    /// nearest that a light can have.
    pub fn point_for(position: [f32; 3], look_at: [f32; 3], irradiance: [f32; 3]) -> Light {
        let offset = |axis: usize| f64::from(position[axis]) - f64::from(look_at[axis]);
        let squared: f64 = (0..3).map(|axis| offset(axis) * offset(axis)).sum();
        let distance = squared.sqrt().clamp(f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX));
        Light::Point { position, irradiance, distance: distance as f32 }
    }
}

/// Light from everywhere: radiance by direction, linear red, green and blue. Between the horizon and
/// the two poles it runs linearly with the height (the `y` of the direction).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Environment {
    /// Radiance from straight above.
    pub zenith: [f32; 3],
    /// Radiance from the horizon.
    pub horizon: [f32; 3],
    /// Radiance from straight below.
    pub nadir: [f32; 3],
}

impl Environment {
    /// No light from outside.
    pub const BLACK: Environment = Environment::uniform([0.0; 3]);

    /// A pale horizon under a blue sky, dark ground.
    pub const SKY: Environment = Environment {
        zenith: [0.20, 0.40, 0.80],
        horizon: [0.85, 0.92, 1.00],
        nadir: [0.20, 0.18, 0.16],
    };

    /// The same radiance from all directions.
    pub const fn uniform(radiance: [f32; 3]) -> Environment {
        Environment { zenith: radiance, horizon: radiance, nadir: radiance }
    }
}

impl Default for Environment {
    fn default() -> Environment {
        Environment::SKY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_light_is_given_by_what_it_does() {
        let light = Light::point_for([1.0, 2.0, 5.0], [1.0, 2.0, 2.0], [1.0, 2.0, 0.5]);
        let want =
            Light::Point { position: [1.0, 2.0, 5.0], irradiance: [1.0, 2.0, 0.5], distance: 3.0 };
        assert_eq!(light, want);
        for (at, least) in [([0.0; 3], f32::MIN_POSITIVE), ([3e38; 3], 3e38)] {
            let light = Light::point_for(at, [0.0; 3], [1.0; 3]);
            assert!(matches!(light, Light::Point { distance, .. } if distance >= least));
        }
    }
}
