//! How photons leave the lights.
//!
//! Powers are in units of radiance times area, and areas in a unit of the scene's own, a power of two near its size: so they neither vanish
//! nor overflow, whatever the scene's size.

use crate::environment;
use crate::environment_map::MapSample;
use crate::layout::Path;
use crate::lighting::shining_point;
use crate::random::{pair, photon_key, unit, words};
use crate::scene_data::DIRECTIONAL;
use crate::scene_words::{LightWords, SceneWords};
use crate::vector::{
    Vector, add, dot, exponent, greatest, length, mul, negated, normalized, power_of_two, scaled,
    sub,
};
use crate::warp::{Basis, PI, cap, disk, hemisphere};
use crate::world::World;
use splitplane_core::aabb::Aabb;
use splitplane_core::ray::Ray;

/// Uses of random numbers by a photon that leaves a light, by the light's place in the list of sources.
const PLACE: u32 = 0;
const DIRECTION: u32 = 1;
const TRIANGLE: u32 = 2;
const USES: u32 = 4;

/// A ball around all that is shown.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ball {
    pub(crate) centre: Vector,
    pub(crate) radius: f32,
    /// The unit of lengths is two to this.
    pub(crate) power: i32,
}

impl Ball {
    /// Around a box; `None` where there is nothing, or nothing that has a size.
    pub(crate) fn around(bounds: &Aabb) -> Option<Ball> {
        let (low, high) = (scaled(bounds.lo, 0.5), scaled(bounds.hi, 0.5));
        // A little more than half the diagonal, for roundings.
        let radius = length(sub(high, low)) * 1.001;
        let power = exponent(radius);
        let fits = radius > 0.0 && radius.is_finite() && bounds.lo[0] <= bounds.hi[0];
        fits.then_some(Ball { centre: add(low, high), radius, power })
    }

    /// The radius in units, 1 to 2.
    fn units(&self) -> f32 {
        self.radius * power_of_two(-self.power)
    }

    /// The area of its shadow, in units.
    fn shadow(&self) -> f32 {
        let units = self.units();
        (units * units) * PI
    }

    /// Where light that comes from this direction enters it, evenly over its shadow.
    fn start(&self, towards: Vector, numbers: [f32; 2]) -> Vector {
        let [x, y] = disk(numbers);
        let across = Basis::around(towards).to_world([x, y, 1.0]);
        add(self.centre, scaled(across, self.radius))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// A light without a size, by its number.
    Light(u32),
    Triangles,
    Environment,
}

/// A light, and which of the photons of a pass are its own.
#[derive(Clone, Copy, Debug)]
struct Source {
    kind: Kind,
    first: u32,
    photons: u32,
}

/// All lights.
#[derive(Clone, Debug)]
pub(crate) struct Sources {
    list: Vec<Source>,
    ball: Ball,
}

impl Sources {
    /// Shares photons out among the lights, by the power that each sends towards what is shown, and at least one to each that shines.
    pub(crate) fn new(
        scene: &SceneWords<'_>,
        world: impl World,
        ball: Ball,
        photons: u32,
    ) -> Sources {
        let frame = scene.frame;
        let sum = |colour: Vector| colour.iter().map(|part| f64::from(*part)).sum::<f64>();
        let mut powers = Vec::new();
        for light in 0..frame.lights {
            powers.push((Kind::Light(light), sum(light_power(&scene.light(light), &ball))));
        }
        if frame.emitters > 0 {
            // The same for every triangle: they are chosen by their power.
            let area = shining_point(scene, world, [0.25; 2], 0);
            let power = scaled(area.radiance, 2.0 * PI);
            let of_area = in_units(area.scaled_area, area.power, &ball);
            powers.push((Kind::Triangles, sum(scaled(power, of_area))));
        }
        if frame.sky_samples > 0 {
            let power = match scene.environment {
                Some(map) => scaled(map.total(), ball.shadow()),
                None => {
                    let twice = scaled(frame.horizon, 2.0);
                    let mean = scaled(add(twice, add(frame.zenith, frame.nadir)), 0.25);
                    scaled(mean, (4.0 * PI) * ball.shadow())
                }
            };
            powers.push((Kind::Environment, sum(power)));
        }
        powers.retain(|(_, power)| *power > 0.0 && power.is_finite());
        let total: f64 = powers.iter().map(|(_, power)| power).sum();
        let (mut list, mut first, mut before) = (Vec::new(), 0, 0.0);
        for (kind, power) in powers {
            let place = |sum: f64| (sum / total * f64::from(photons)) as u32;
            let own = (place(before + power) - place(before)).max(1);
            list.push(Source { kind, first, photons: own });
            first += own;
            before += power;
        }
        Sources { list, ball }
    }

    /// Photons of a pass.
    pub(crate) fn photons(&self) -> u32 {
        self.list.last().map_or(0, |source| source.first + source.photons)
    }
}

/// The area of a triangle in units. `scaled_area` is the area times 4^power.
fn in_units(scaled_area: f32, power: i32, ball: &Ball) -> f32 {
    let factor = power_of_two(-power - ball.power);
    (scaled_area * factor) * factor
}

/// One less the cosine of half the angle under which a light sees the ball; 2 from within.
fn cone(towards_ball: Vector, ball: &Ball) -> f32 {
    let sine = ball.radius / length(towards_ball);
    if sine < 1.0 {
        let square = sine * sine;
        square / (1.0 + (1.0 - square).sqrt())
    } else {
        2.0
    }
}

/// The power that a light without a size sends towards the ball.
fn light_power(light: &LightWords, ball: &Ball) -> Vector {
    if light.kind == DIRECTIONAL {
        return scaled(light.irradiance, ball.shadow());
    }
    let away = light.distance * power_of_two(-ball.power);
    let depth = cone(sub(ball.centre, light.place), ball);
    scaled(light.irradiance, ((2.0 * PI) * (depth * away)) * away)
}

/// The photon of this number of a pass: its ray, and a path whose weight is its power. `None` where it has none.
pub(crate) fn emit(
    scene: &SceneWords<'_>,
    world: impl World,
    sources: &Sources,
    (pass, photon): (u32, u32),
) -> Option<(Ray, Path)> {
    let frame = scene.frame;
    let after = sources.list.partition_point(|source| source.first <= photon);
    let place = after.checked_sub(1)?;
    let Source { kind, first, photons } = sources.list[place];
    let key = |used: u32| photon_key(pass, 0, place as u32 * USES + used, frame.seed);
    let numbers = |used: u32| pair(key(used), photon - first);
    let ball = &sources.ball;
    let (start, direction, power) = match kind {
        Kind::Light(light) => {
            let light = scene.light(light);
            let power = light_power(&light, ball);
            if light.kind == DIRECTIONAL {
                (ball.start(light.place, numbers(PLACE)), negated(light.place), power)
            } else {
                let towards = sub(ball.centre, light.place);
                let local = cap(numbers(DIRECTION), cone(towards, ball));
                let axis = normalized(towards);
                let axis = if axis == [0.0; 3] { [0.0, 0.0, 1.0] } else { axis };
                (light.place, normalized(Basis::around(axis).to_world(local)), power)
            }
        }
        Kind::Triangles => {
            let [triangle, side] = words(key(TRIANGLE), photon - first);
            let area = shining_point(scene, world, numbers(PLACE), triangle);
            let normal = if unit(side) < 0.5 { area.normal } else { negated(area.normal) };
            let local = hemisphere(numbers(DIRECTION));
            let direction = normalized(Basis::around(normal).to_world(local));
            let of_area = in_units(area.scaled_area, area.power, ball);
            let power = scaled(scaled(area.radiance, 2.0 * PI), of_area);
            (add(area.point, scaled(normal, area.offset)), direction, power)
        }
        Kind::Environment if scene.environment.is_some() => {
            let MapSample { direction, radiance, density } =
                environment::sample(scene, words(key(DIRECTION), photon - first))?;
            let power = scaled(scaled(radiance, 1.0 / density), ball.shadow());
            (ball.start(direction, numbers(PLACE)), negated(direction), power)
        }
        Kind::Environment => {
            let towards = normalized(cap(numbers(DIRECTION), 2.0));
            let power = scaled(environment::radiance(scene, towards), (4.0 * PI) * ball.shadow());
            (ball.start(towards, numbers(PLACE)), negated(towards), power)
        }
    };
    let power = mul(power, [1.0 / photons as f32; 3]);
    let most = greatest(power);
    let fits = most > 0.0 && most.is_finite() && dot(direction, direction) > 0.5;
    let path = Path { weight: power, pixel: photon, sequence: pass, ..Path::default() };
    fits.then_some((Ray::new(start, direction), path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balls_hold_their_boxes() {
        for size in [1.0f32, 1e-30, 1e30] {
            let bounds = Aabb { lo: [-size, 0.0, 2.0 * size], hi: [size, 3.0 * size, 2.0 * size] };
            let ball = Ball::around(&bounds).unwrap();
            assert!((1.0..2.0).contains(&ball.units()), "{ball:?}");
            assert!(length(sub(bounds.hi, ball.centre)) < ball.radius);
            let start = ball.start([0.0, 1.0, 0.0], [0.9, 0.9]);
            assert!(start[1] > bounds.hi[1]);
        }
        assert!(Ball::around(&Aabb::EMPTY).is_none());
        assert!(Ball::around(&Aabb { lo: [1.0; 3], hi: [1.0; 3] }).is_none());
        assert!(Ball::around(&Aabb { lo: [-3e38; 3], hi: [3e38; 3] }).is_none());
    }

    /// A far light sends into a cone what it would send there as a part of all its power.
    #[test]
    fn cones_have_the_ball_s_solid_angle() {
        let ball = Ball::around(&Aabb { lo: [-1.0; 3], hi: [1.0; 3] }).unwrap();
        for distance in [2.0f32, 10.0, 1e4, 1e18] {
            let depth = f64::from(cone([distance, 0.0, 0.0], &ball));
            let sine = f64::from(ball.radius) / f64::from(distance);
            let want = 2.0 * (0.5 * sine.asin()).sin().powi(2);
            assert!((depth / want - 1.0).abs() < 1e-5, "{distance}: {depth} {want}");
        }
        assert_eq!(cone([1.0, 0.0, 0.0], &ball), 2.0);
    }
}
