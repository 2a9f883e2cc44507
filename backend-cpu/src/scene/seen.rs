//! Rays as an instance sees them, with the three axes side by side.

use splitplane_core::ray::Ray;
use splitplane_core::scene::{LEAST_OF_RAY, Placement};

use crate::simd::F32x4;
use crate::trace::prepare_one::LoadedRay;

/// A ray in the world, ready to be seen by instances.
#[derive(Clone, Copy)]
pub(super) struct WorldRay {
    /// Snapped.
    origin: F32x4,
    direction: F32x4,
    /// Whether its numbers are 0 or at least [`LEAST_OF_RAY`] in magnitude.
    ordinary: bool,
}

impl WorldRay {
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn new(ray: &Ray) -> WorldRay {
        let LoadedRay { origin, direction, .. } = LoadedRay::new(ray);
        let (origin, direction) = (origin.snapped(), direction.snapped());
        let zero = F32x4::splat(0.0);
        let fits = |x: F32x4| x.abs().le(zero).or(F32x4::splat(LEAST_OF_RAY).le(x.abs()));
        let ordinary = fits(origin).and(fits(direction)).signs() & 0b111 == 0b111;
        WorldRay { origin, direction, ordinary }
    }

    /// No ray.
    pub(super) fn none() -> WorldRay {
        let zero = F32x4::splat(0.0);
        WorldRay { origin: zero, direction: zero, ordinary: false }
    }

    /// [`seen_by`](splitplane_core::backend::scene::seen_by) by vectors: the same operations in the same order, and so the same bits. Where
    /// ray and placement are ordinary, nothing is snapped: then zeros may be negative, and only they.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn seen_by(&self, placement: &Placement, [t_min, t_max]: [f32; 2]) -> LoadedRay {
        let columns = F32x4::columns(&placement.space.inverse);
        let (origin, direction) = if self.ordinary & placement.ordinary {
            let turned = |v: F32x4| turned(&columns, v, |x| x);
            (turned(self.origin).plus(columns[3]), turned(self.direction))
        } else {
            let turned = |v: F32x4| turned(&columns, v, F32x4::snapped);
            (turned(self.origin).plus(columns[3]).snapped(), turned(self.direction))
        };
        LoadedRay { origin, direction, t_min, t_max }
    }
}

/// The sum `(m0 x + m1 y) + m2 z`, each operation snapped.
#[cfg_attr(not(unoptimised), inline(always))]
fn turned(columns: &[F32x4; 4], v: F32x4, snapped: impl Fn(F32x4) -> F32x4) -> F32x4 {
    let (x, y, z) = (v.only::<0>(), v.only::<1>(), v.only::<2>());
    let [first, second, third, _] = columns;
    let two = snapped(snapped(first.times(x)).plus(snapped(second.times(y))));
    snapped(two.plus(snapped(third.times(z))))
}

#[cfg(test)]
mod tests {
    use splitplane_core::aabb::Aabb;
    use splitplane_core::arithmetic::power_of_two;
    use splitplane_core::backend::scene::limit_within;
    use splitplane_core::scene::{
        GeometryId, Instance, LEAST_OF_WAY, ObjectSpace, SceneHit, Transform,
    };
    use splitplane_test_support::random::Random;

    use super::*;

    /// Numbers of every size that there is, zeros and those below the normal range among them.
    fn number(random: &mut Random) -> f32 {
        let sizes = [0.0, -0.0, 1.0, -1.0, 1e-40, -1e-45, 1e38, -3e38, f32::MIN_POSITIVE];
        if random.below(8) == 0 {
            return random.pick(&sizes);
        }
        random.between(-1.0, 1.0) as f32 * power_of_two(random.below(250) as i32 - 125)
    }

    /// As small as an ordinary number may be, so that differences of products have little but last bits; or 0.
    fn least(random: &mut Random, least: f32) -> f32 {
        let number = least * (1.0 + random.below(4) as f32 * f32::EPSILON);
        random.pick(&[number, number, number, -number, -number, 0.0, -0.0])
    }

    #[test]
    fn vectors_see_what_the_core_sees() {
        let mut random = Random::new(11);
        let (mut wild, mut small, mut ordinary) = (0, 0, 0);
        for round in 0..200_000 {
            let of_all = |random: &mut Random, bound: f32| {
                if round % 4 == 0 { least(random, bound) } else { number(random) }
            };
            let mut of_way = || of_all(&mut random, LEAST_OF_WAY);
            let inverse: Transform = [(); 3].map(|()| [(); 4].map(|()| of_way()));
            let space = ObjectSpace { inverse, mirrored: false };
            let own = Instance::in_place(GeometryId(0));
            let mut placement = Placement::new(&own, space, &Aabb::EMPTY, None);
            // Both ways where both are right.
            placement.ordinary &= random.below(2) == 0;
            let mut three = || [(); 3].map(|()| of_all(&mut random, LEAST_OF_RAY));
            let ray = Ray::new(three(), three()).with_limits(-1.0, 7.0);
            let best = SceneHit { t: number(&mut random), ..SceneHit::MISS };
            let (seen, t_max) = (space.ray(&ray), limit_within(&ray, &best));
            let world = WorldRay::new(&ray);
            let found = world.seen_by(&placement, [ray.t_min, t_max]).ray();
            let expected = seen.with_limits(ray.t_min, t_max);
            let is_ordinary = world.ordinary & placement.ordinary;
            ordinary += u32::from(is_ordinary);
            // Of what is not a number the bits do not matter.
            let bits = |x: f32| match x {
                x if x.is_nan() => u32::MAX,
                x if is_ordinary && x == 0.0 => 0,
                x => x.to_bits(),
            };
            let [expected, found]: [[f32; 8]; 2] = bytemuck::cast([expected, found]);
            assert_eq!(found.map(bits), expected.map(bits), "{inverse:?} {ray:?}");
            wild += u32::from(found.iter().any(|x| !x.is_finite()));
            small += u32::from(found[..3].contains(&0.0));
        }
        assert!(wild > 1_000 && small > 100 && ordinary > 20_000, "{wild} {small} {ordinary}");
    }
}
