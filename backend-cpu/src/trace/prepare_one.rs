//! Prepares one ray as [`super::prepare`] does many, with the three axes side by side.
//!
//! The operations and their order are the same, and so are all bits; a test checks that.

use core::mem::offset_of;

use splitplane_core::query::intersect::{
    COORDINATE_MOST, DIRECTION_LEAST, ORIGIN_LEAST, PLANE_SLACK, SLOPE_LEAST, STOP_SLACK,
    SceneScale,
};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::Ray;

use super::ray_state::{
    AXES_OF_SIGNS, BEHIND_SLACK, EXIT_FACTOR, ORIGIN_SLACK, RAY_STATE_WORDS, RayState, SHEARED,
    SIGNS, far_end_is_solid,
};
use crate::simd::{F32x4, Simd};

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
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn ray(&self) -> Ray {
        let ([x, y, z, _], [dx, dy, dz, _]) = (self.origin.row(), self.direction.row());
        Ray::new([x, y, z], [dx, dy, dz]).with_limits(self.t_min, self.t_max)
    }
}

impl RayState {
    /// Becomes the state of a ray where it returns [`Readiness::Ready`]. The bounds must not be empty.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn prepare<S: Simd>(
        &mut self,
        ray: &Ray,
        scene: &SceneScale,
        query: Query,
    ) -> Readiness {
        // SAFETY: the caller's contract.
        unsafe { self.prepare_loaded::<S>(&LoadedRay::new(ray), scene, query) }
    }

    /// The same, of a ray whose axes are side by side already.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn prepare_loaded<S: Simd>(
        &mut self,
        ray: &LoadedRay,
        scene: &SceneScale,
        query: Query,
    ) -> Readiness {
        const {
            assert!(
                offset_of!(RayState, near) == 16 && offset_of!(RayState, exit_reciprocal) == 32
            );
            assert!(offset_of!(RayState, far) == 48 && offset_of!(RayState, origin) == 64);
            assert!(offset_of!(RayState, limits) == 96 && offset_of!(RayState, direction) == 112);
        }
        let most = F32x4::splat(f32::MAX);
        let zero = F32x4::splat(0.0);
        // Its fourth is 0, so what comes of that is neither negative nor the largest.
        let given = ray.direction.with_fourth_of(zero);
        let magnitude = given.abs();
        let distance = ray.origin.abs();
        // What is near is finite; an infinite direction has no ordinary power.
        let [low, high] = F32x4::of_bounds(&scene.near);
        let near = low.le(ray.origin).and(ray.origin.le(high)).and(magnitude.le(most));
        let near = near.and(distance.le(F32x4::splat(COORDINATE_MOST)));
        let known = F32x4::splat(ORIGIN_LEAST).le(distance);
        let origin = known.and(ray.origin).or(known.other_only(F32x4::splat(scene.origin_least)));
        let largest = magnitude.greatest();
        // The power of two in it, and its reciprocal.
        let back = largest.and(F32x4::splat(f32::INFINITY));
        let to_unit = F32x4::splat(f32::from_bits(254 << 23)).minus_bits(back);
        let biased = back.row()[0].to_bits() >> 23;
        let ordinary = (near.signs() & ALL_AXES == ALL_AXES)
            & (ray.t_min <= ray.t_max)
            & (LEAST_POWER..=MOST_POWER).contains(&biased)
            & !scene.wide;
        if !ordinary {
            return Readiness::Special;
        }
        let least = F32x4::splat(f32::MIN_POSITIVE);
        let direction = least.le(magnitude).and(given).times(to_unit).at_least(f32::MIN_POSITIVE);

        // Limits are in the last two places, where they enter and leave in the last one.
        let given_limits = F32x4::of([0.0, 0.0, ray.t_min, ray.t_max]);
        let limits = given_limits.times(back);
        let limits = limits.max(F32x4::splat(-f32::MAX)).min(most).at_least(f32::MIN_POSITIVE);
        let widen = F32x4::of([0.0, 0.0, -STOP_SLACK, STOP_SLACK]);
        let ends = limits.plus(limits.abs().times(widen));

        // Of the direction as given, and scaled then, which is exact: a quotient takes long. Components of
        // less than `DIRECTION_LEAST` count as that. Those below the normal range may have any quotient.
        let size = F32x4::splat(1.0).over(magnitude).times(back);
        let size = size.min(F32x4::splat(1.0 / DIRECTION_LEAST));
        // Below 2^38 * 2^80, as scenes are here.
        let slack = F32x4::splat(scene.slack).times(size);
        let reciprocal = size.or(direction.and(F32x4::splat(-0.0)));
        let [low, high] = F32x4::of_bounds(&scene.bounds);
        let low = low.minus(origin).times(reciprocal);
        let high = high.minus(origin).times(reciprocal);
        let widened = |t: F32x4| t.abs().times(F32x4::splat(PLANE_SLACK)).plus(slack);
        let (near, far) = (low.min(high), low.max(high));
        let enter = near.minus(widened(near)).with_fourth_of(ends.third_last()).greatest();
        let exit = far.plus(widened(far)).with_fourth_of(ends).least();
        let (first, last) = (enter.row()[0], exit.row()[0]);
        if first > last {
            return Readiness::Misses;
        }

        // As `behind` has it.
        let reach = enter.abs().max(exit.abs()).times(F32x4::splat(BEHIND_SLACK));
        let reach = enter.less(zero).and(reach);
        let from = origin.times(reciprocal);
        let base = F32x4::splat(scene.base_slack).times(size);
        let room = base.plus(from.abs().times(F32x4::splat(ORIGIN_SLACK))).plus(reach);
        let negative = direction.signs() & ALL_AXES;
        let is_largest = largest.le(magnitude).signs() & ALL_AXES;
        let axes = AXES_OF_SIGNS[(is_largest << 3 | negative) as usize] as usize;
        let main = largest.times(to_unit).or(F32x4::splat(SIGNS[axes % SIGNS.len()]));
        let slopes = direction.with_fourth_of(F32x4::splat(1.0)).over(main).at_least(SLOPE_LEAST);
        let [.., t_min, t_max] = limits.row();
        let solid = (query == Query::Any) & far_end_is_solid(first, t_min, last, t_max);

        let factor = F32x4::splat(EXIT_FACTOR);
        let index = F32x4::splat(f32::from_bits(RayState::NO_RAY));
        let rows: &mut [[f32; 4]; 8] = bytemuck::cast_mut(self);
        rows[0] = reciprocal.with_fourth_of(enter).row();
        rows[1] = from.plus(room).with_fourth_of(exit).row();
        rows[2] = reciprocal.times(factor).row();
        rows[3] = from.minus(room).times(factor).with_fourth_of(index).row();
        // The last word is the offset: none.
        rows[7] = direction.row();
        let words: &mut [f32; RAY_STATE_WORDS] = bytemuck::cast_mut(self);
        let (_, sheared) = words.split_at_mut(16);
        let sheared = sheared.first_chunk_mut().expect("eight of sixteen words");
        // SAFETY: the caller's contract.
        unsafe { S::pick([origin, slopes], &SHEARED[axes % SHEARED.len()], sheared) };
        self.octant = negative | u32::from(solid) << 3;
        (self.t_min, self.t_max) = (t_min, t_max);
        self.limits = [ray.t_min, ray.t_max];
        self.axes = axes as u32;
        self.exponent = biased as i32 - 127;
        Readiness::Ready
    }
}

#[cfg(test)]
pub(super) mod tests {
    use splitplane_core::aabb::Aabb;
    use splitplane_core::arithmetic::power_of_two;
    use splitplane_core::query::intersect::Limits;
    use splitplane_core::ray::Rays;
    use splitplane_test_support::random::Random;

    use super::*;
    use crate::simd::InstructionSet;
    use crate::simd::every_set::for_every_set;
    use crate::trace::prepare::CHUNK;
    use crate::trace::prepare::tests::filled;

    for_every_set! {
        /// What comes of a ray, and its state.
        pub(in crate::trace) fn prepared<S>(ray: &Ray, scene: &SceneScale, query: Query) -> (Readiness, RayState) {
            let mut ray_state = RayState::none();
            // SAFETY: `S` is a set of this processor.
            let readiness = unsafe { ray_state.prepare::<S>(ray, scene, query) };
            (readiness, ray_state)
        }
    }

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
            let many = many
                .into_iter()
                .map(|set| (set, filled(set, Rays::Records(&rays), &scene, 0, query)));
            for ((set, (lanes, ray_states)), (lane, ray)) in
                many.flat_map(|made| rays.iter().enumerate().map(move |ray| (made, ray)))
            {
                let ordinary = lanes.alive[lane] != 0 && lanes.special[lane] == 0;
                let within = lanes.enter[lane] <= lanes.exit[lane];
                let biased = (lanes.exponent[lane] + 127) as u32;
                let (readiness, mut ray_state) = prepared(set, ray, &scene, query);
                match readiness {
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
