use splitplane_core::exact::{ExactRay, meet};
use splitplane_core::ray::{Culling, Hit};
use splitplane_test_support::random::Random;

use super::*;
use crate::simd::InstructionSet;

/// Rays that meet triangles, of all sizes and from near and far; some triangles are slivers, and some rays begin on them.
fn pairs(random: &mut Random) -> [(Ray, Triangle); MOST_LANES] {
    core::array::from_fn(|lane| {
        loop {
            let scale = random.pick(&[1.0, 1e-6, 1e7]);
            let mut point = |spread: f64| [(); 3].map(|()| random.between(-spread, spread) * scale);
            let (at, sides) =
                (point(1.0), [point(0.3), point(if lane % 5 == 4 { 1e-6 } else { 0.3 })]);
            let triangle = [
                at,
                [0, 1, 2].map(|k| at[k] + sides[0][k]),
                [0, 1, 2].map(|k| at[k] + sides[0][k] * 0.5 + sides[1][k]),
            ]
            .map(|corner| corner.map(|x| x as f32));
            let weights = random.barycentric();
            let target = [0, 1, 2]
                .map(|k| (0..3).map(|i| weights[i] * f64::from(triangle[i][k])).sum::<f64>());
            let away = random.direction();
            let distance = random.pick(&[0.0, 0.1, 30.0]) * scale;
            let origin = [0, 1, 2].map(|k| (target[k] + distance * away[k]) as f32);
            let direction = match random.below(3) {
                0 => random.direction().map(|x| x as f32),
                _ => [0, 1, 2].map(|k| (target[k] - f64::from(origin[k])) as f32),
            };
            let ray = Ray::new(origin, direction);
            if met(&ray, &triangle).is_some() {
                return (ray, triangle);
            }
        }
    })
}

/// The hit by the exact test.
fn met(ray: &Ray, triangle: &Triangle) -> Option<Hit> {
    Some(meet(&ExactRay::new(ray)?, triangle, Culling::None)?.hit(0))
}

/// The numbers that are known are those of the exact test, bit for bit, and nearly all are known; on every instruction set.
#[test]
fn numbers_are_those_of_the_exact_test() {
    for set in InstructionSet::available() {
        let mut random = Random::new(9);
        let (mut known, mut all) = (0, 0);
        for _ in 0..400 {
            let pairs = pairs(&mut random);
            let mut meetings = Meetings::NONE;
            for (lane, (ray, triangle)) in pairs.iter().enumerate() {
                meetings.set(lane, ray, triangle);
            }
            // SAFETY: the processor has it.
            let numbers = unsafe { set.run(FirstLanes::<MOST_LANES>(&meetings)) };
            for (lane, (ray, triangle)) in pairs.iter().enumerate() {
                all += 1;
                if numbers.known >> lane & 1 == 0 {
                    continue;
                }
                known += 1;
                let expected = met(ray, triangle).expect("all meet");
                let found = [numbers.t[lane], numbers.u[lane], numbers.v[lane]];
                let bits = |numbers: [f32; 3]| numbers.map(f32::to_bits);
                assert_eq!(
                    bits(found),
                    bits([expected.t, expected.u, expected.v]),
                    "{set:?}: {ray:?} {triangle:?}"
                );
            }
        }
        println!("{set:?}: {known} known of {all}");
        assert!(known * 10 > all * 4 && known < all, "{known} of {all}");
    }
}
