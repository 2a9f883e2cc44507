//! Rays as an instance sees them, with the three axes side by side.

use splitplane_core::backend::scene::limit_within;
use splitplane_core::ray::Ray;
use splitplane_core::scene::{ObjectSpace, SceneHit};

use crate::simd::F32x4;
use crate::trace::prepare_one::LoadedRay;

/// [`seen_by`](splitplane_core::backend::scene::seen_by) by vectors: the same operations in the same order, and so the same bits.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn seen_by(space: &ObjectSpace, ray: &Ray, best: &SceneHit) -> LoadedRay {
    let LoadedRay { origin, direction, t_min, .. } = LoadedRay::new(ray);
    let columns = F32x4::columns(&space.inverse);
    let origin = turned(&columns, origin).plus(columns[3]).snapped();
    let direction = turned(&columns, direction);
    LoadedRay { origin, direction, t_min, t_max: limit_within(ray, best) }
}

/// The sum `(m0 x + m1 y) + m2 z`, each operation snapped.
#[cfg_attr(not(unoptimised), inline(always))]
fn turned(columns: &[F32x4; 4], v: F32x4) -> F32x4 {
    let v = v.snapped();
    let (x, y, z) = (v.only::<0>(), v.only::<1>(), v.only::<2>());
    let [first, second, third, _] = columns;
    let two = first.times(x).snapped().plus(second.times(y).snapped()).snapped();
    two.plus(third.times(z).snapped()).snapped()
}

#[cfg(test)]
mod tests {
    use splitplane_core::arithmetic::power_of_two;
    use splitplane_core::scene::Transform;
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

    #[test]
    fn vectors_see_what_the_core_sees() {
        let mut random = Random::new(11);
        let (mut wild, mut small) = (0, 0);
        for _ in 0..200_000 {
            let inverse: Transform = [(); 3].map(|()| [(); 4].map(|()| number(&mut random)));
            let space = ObjectSpace { inverse, mirrored: false };
            let mut three = || [(); 3].map(|()| number(&mut random));
            let ray = Ray::new(three(), three()).with_limits(-1.0, 7.0);
            let best = SceneHit { t: number(&mut random), ..SceneHit::MISS };
            let (seen, t_max) = (space.ray(&ray), limit_within(&ray, &best));
            let (expected, found) =
                (seen.with_limits(ray.t_min, t_max), seen_by(&space, &ray, &best).ray());
            // Of what is not a number the bits do not matter.
            let bits = |x: f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
            let [expected, found]: [[f32; 8]; 2] = bytemuck::cast([expected, found]);
            assert_eq!(found.map(bits), expected.map(bits), "{inverse:?} {ray:?}");
            wild += u32::from(found.iter().any(|x| !x.is_finite()));
            small += u32::from(found[..3].contains(&0.0));
        }
        assert!(wild > 1_000 && small > 100, "{wild} {small}");
    }
}
