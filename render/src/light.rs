//! What lights a scene, besides surfaces that shine and the environment.

/// A source of light without a size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// A point that shines evenly in all directions.
    Point {
        /// Where it is.
        position: [f32; 3],
        /// Irradiance of a surface that faces the light at `distance`, linear red, green and blue;
        /// elsewhere it falls off with the square of the distance.
        irradiance: [f32; 3],
        /// The distance that `irradiance` is for, more than 0. Given so, and not as a radiant
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
        zenith: [0.16, 0.28, 0.52],
        horizon: [0.66, 0.68, 0.70],
        nadir: [0.16, 0.15, 0.14],
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
