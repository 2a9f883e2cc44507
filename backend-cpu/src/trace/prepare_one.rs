//! Prepares one ray as [`super::prepare`] does many, with the three axes side by side.
//!
//! The operations and their order are the same, and so are all bits; a test checks that.

use splitplane_core::query::intersect::{
    COORDINATE_MOST, DIRECTION_LEAST, ORIGIN_LEAST, PLANE_SLACK, SLOPE_LEAST, STOP_SLACK,
    SceneScale,
};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::Ray;

use super::ray_state::{AXES, EXIT_FACTOR, ORIGIN_SLACK, RayState, behind, far_end_is_solid};
use crate::simd::F32x4;

/// How to continue with a ray.
pub(crate) enum Readiness {
    /// It must be traced.
    Ready,
    /// It misses the bounds.
    Misses,
    /// It can hit nothing, or is one of the rare rays that need more care.
    Special,
}

/// The first three bits: one for each axis.
const ALL_AXES: u32 = 0b111;
/// Lengths of directions, as powers of two, whose reciprocals need not wait for the scale: they neither
/// overflow nor leave the normal range where that counts.
const LEAST_POWER: u32 = 127 - 40;
const MOST_POWER: u32 = 127 + 60;

/// A ray with its axes side by side. The fourth places count for nothing.
#[derive(Clone, Copy)]
pub(crate) struct LoadedRay {
    pub(crate) origin: F32x4,
    pub(crate) direction: F32x4,
    pub(crate) t_min: f32,
    pub(crate) t_max: f32,
}

impl LoadedRay {
    /// Loads a ray.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn new(ray: &Ray) -> LoadedRay {
        // Origin and lower limit, direction and upper limit.
        let [origin, direction]: [[f32; 4]; 2] = bytemuck::cast(*ray);
        let (origin, direction) = (F32x4::of(origin), F32x4::of(direction));
        LoadedRay { origin, direction, t_min: ray.t_min, t_max: ray.t_max }
    }

    /// The ray as others take it.
    #[cfg(test)]
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn ray(&self) -> Ray {
        Ray::new(self.origin.three(), self.direction.three()).with_limits(self.t_min, self.t_max)
    }
}

impl RayState {
    /// Becomes the state of a ray where it returns [`Readiness::Ready`]. The bounds must not be empty.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn prepare(&mut self, ray: &Ray, scene: &SceneScale, query: Query) -> Readiness {
        self.prepare_loaded(&LoadedRay::new(ray), scene, query)
    }

    /// The same, of a ray whose axes are side by side already.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn prepare_loaded(
        &mut self,
        ray: &LoadedRay,
        scene: &SceneScale,
        query: Query,
    ) -> Readiness {
        let (given_origin, given) = (ray.origin, ray.direction);
        let most = F32x4::splat(f32::MAX);
        let magnitude = given.abs();
        let finite = given_origin.abs().le(most).and(magnitude.le(most));
        let origin = given_origin.at_least(f32::MIN_POSITIVE);
        let near = F32x4::of_three(scene.near.lo).le(origin);
        let near = near.and(origin.le(F32x4::of_three(scene.near.hi)));
        let near = near.and(origin.abs().le(F32x4::splat(COORDINATE_MOST)));
        let origin = origin.at_least(ORIGIN_LEAST);
        let is_least = origin.abs().le(F32x4::splat(0.0));
        let origin = origin.or(F32x4::splat(scene.origin_least).and(is_least));
        let largest = magnitude.greatest_of_three();
        // The power of two in it, and its reciprocal.
        let back = largest.and(F32x4::splat(f32::INFINITY));
        let to_unit = F32x4::splat(f32::from_bits(254 << 23)).minus_bits(back);
        let biased = back.row()[0].to_bits() >> 23;
        let ordinary = (finite.and(near).signs() & ALL_AXES == ALL_AXES)
            & (ray.t_min <= ray.t_max)
            & (LEAST_POWER..=MOST_POWER).contains(&biased)
            & !scene.wide;
        if !ordinary {
            return Readiness::Special;
        }
        let given = given.at_least(f32::MIN_POSITIVE);
        let direction = given.times(to_unit).at_least(f32::MIN_POSITIVE);

        let limits = F32x4::of([ray.t_min, ray.t_max, 0.0, 0.0]).times(back);
        let limits = limits.max(F32x4::splat(-f32::MAX)).min(most).at_least(f32::MIN_POSITIVE);
        let widen = F32x4::of([-STOP_SLACK, STOP_SLACK, 0.0, 0.0]);
        let [enter, exit, ..] = limits.plus(limits.abs().times(widen)).row();
        let [t_min, t_max, ..] = limits.row();

        // Of the direction as given, and scaled then, which is exact: a quotient takes long. Components of
        // less than `DIRECTION_LEAST` count as that.
        let reciprocal = F32x4::splat(1.0).over(magnitude).times(back);
        let reciprocal = reciprocal.min(F32x4::splat(1.0 / DIRECTION_LEAST));
        let slack = F32x4::splat(scene.slack).times(reciprocal).min(most);
        let reciprocal = reciprocal.or(direction.and(F32x4::splat(-0.0)));
        let low = F32x4::of_three(scene.bounds.lo).minus(origin).times(reciprocal);
        let high = F32x4::of_three(scene.bounds.hi).minus(origin).times(reciprocal);
        let widened = |t: F32x4| t.abs().times(F32x4::splat(PLANE_SLACK)).plus(slack);
        let (near, far) = (low.min(high), low.max(high));
        let near = near.minus(widened(near)).greatest_of_three().row()[0];
        let far = far.plus(widened(far)).least_of_three().row()[0];
        let enter = if near > enter { near } else { enter };
        let exit = if far < exit { far } else { exit };
        if enter > exit {
            return Readiness::Misses;
        }

        let reach = behind(enter, exit);
        let from = origin.times(reciprocal);
        let base = F32x4::splat(scene.base_slack).times(reciprocal.abs()).min(most);
        let room =
            base.plus(from.abs().times(F32x4::splat(ORIGIN_SLACK))).plus(F32x4::splat(reach));
        let negative = direction.signs() & ALL_AXES;
        let is_largest = largest.le(magnitude).signs() & ALL_AXES;
        // The first of the largest components.
        let axis = is_largest.trailing_zeros() % 3;
        let axes = axis + 3 * (negative >> axis & 1);
        let [kx, ky, kz] = AXES[axes as usize % AXES.len()];
        let (origins, directions) = (origin.row(), direction.row());
        let [x, y, z, _] = directions;
        let slopes = F32x4::of([x, y, z, 1.0]).over(F32x4::splat(directions[kz]));
        let slopes = slopes.at_least(SLOPE_LEAST).row();
        let solid = (query == Query::Any) & far_end_is_solid(enter, t_min, exit, t_max);

        self.reciprocal = reciprocal.three();
        self.near = from.plus(room).three();
        let factor = F32x4::splat(EXIT_FACTOR);
        self.far = from.minus(room).times(factor).three();
        self.exit_reciprocal = reciprocal.times(factor).three();
        (self.enter, self.stop) = (enter, exit);
        self.octant = negative | u32::from(solid) << 3;
        self.origin = [origins[kx], origins[ky], origins[kz]];
        self.shear = [slopes[kx], slopes[ky], slopes[3]];
        (self.t_min, self.t_max) = (t_min, t_max);
        self.axes = axes;
        self.exponent = biased as i32 - 127;
        self.limits = [ray.t_min, ray.t_max];
        self.direction = [x, y, z];
        self.offset = 0.0;
        Readiness::Ready
    }
}

#[cfg(test)]
mod tests {
    use splitplane_core::aabb::Aabb;
    use splitplane_core::arithmetic::power_of_two;
    use splitplane_core::query::intersect::Limits;
    use splitplane_core::ray::Rays;
    use splitplane_test_support::random::Random;

    use super::*;
    use crate::simd::InstructionSet;
    use crate::trace::prepare::CHUNK;
    use crate::trace::prepare::tests::filled;

    /// Of all kinds: zeros, subnormals, infinities and NaN among them.
    fn number(random: &mut Random, spread: f64) -> f32 {
        let odd = [0.0, -0.0, 1.0, -1.0, 1e-40, 1e-30, -1e-13, 1e30, f32::NAN, f32::INFINITY];
        if random.below(24) == 0 {
            return random.pick(&odd);
        }
        (random.between(-spread, spread)) as f32
    }

    /// A ray prepared alone equals the one prepared among others, bit for bit, on every instruction
    /// set.
    #[test]
    fn one_is_made_ready_like_many() {
        let bounds = Aabb { lo: [-1.0, -2.0, 0.5], hi: [3.0, 1.0, 4.0] };
        let limits = Limits { greatest: 4.0, least: 0.25, longest: 1.0, shortest: 0.1 };
        let scene = SceneScale::new(bounds, &limits);
        let mut random = Random::new(5);
        let [mut ready, mut missed, mut special, mut any] = [0; 4];
        for round in 0..4000 {
            let query = if round % 2 == 0 { Query::Closest } else { Query::Any };
            let rays: [Ray; CHUNK] = core::array::from_fn(|_| {
                let mut three = |spread| [(); 3].map(|()| number(&mut random, spread));
                let (origin, direction) = (three(5.0), three(1.0));
                let power = random.below(if round % 8 == 0 { 160 } else { 20 }) as i32;
                let scale = power_of_two(power - if round % 8 == 0 { 80 } else { 10 });
                let ray = Ray::new(origin, direction.map(|x| x * scale));
                let limits = [number(&mut random, 1.0), number(&mut random, 9.0).abs()];
                match random.below(3) {
                    0 => ray.with_limits(limits[0], limits[1]),
                    1 => ray.with_limits(limits[0], limits[1] / scale),
                    _ => ray,
                }
            });
            let many = InstructionSet::available();
            let many =
                many.into_iter().map(|set| filled(set, Rays::Records(&rays), &scene, 0, query));
            for ((lanes, ray_states), (lane, ray)) in
                many.flat_map(|made| rays.iter().enumerate().map(move |ray| (made, ray)))
            {
                let mut ray_state = RayState::none();
                let ordinary = lanes.alive[lane] != 0 && lanes.special[lane] == 0;
                let within = lanes.enter[lane] <= lanes.exit[lane];
                let biased = (lanes.exponent[lane] + 127) as u32;
                match ray_state.prepare(ray, &scene, query) {
                    Readiness::Ready => {
                        assert!(ordinary && within, "{ray:?}");
                        ray_state.index = ray_states[lane].index;
                        let (found, expected) = (bytemuck::bytes_of(&ray_state), &ray_states[lane]);
                        assert_eq!(found, bytemuck::bytes_of(expected), "{ray:?} {expected:?}");
                        ready += 1;
                        any += ray_state.octant >> 3;
                    }
                    Readiness::Misses => {
                        assert!(ordinary && !within, "{ray:?}");
                        missed += 1;
                    }
                    Readiness::Special => {
                        let usual = (LEAST_POWER..=MOST_POWER).contains(&biased);
                        assert!(!ordinary || !usual, "{ray:?}");
                        special += 1;
                    }
                }
            }
        }
        let counts = [ready, missed, special, any];
        assert!(
            counts.into_iter().zip([5_000, 5_000, 3_000, 300]).all(|(a, b)| a > b),
            "{counts:?}"
        );
    }
}
