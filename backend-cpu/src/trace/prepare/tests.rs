use super::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Strict;
use splitplane_core::query::intersect::Limits;
use splitplane_core::ray::Ray;
use splitplane_test_support::random::Random;

use crate::simd::{Compiled, InstructionSet};

/// [`PreparedRays::fill`] and then [`PreparedRays::ways`].
struct Fill<'a> {
    rays: Rays<'a>,
    scene: &'a SceneScale,
    first: usize,
    query: Query,
}

impl Compiled for Fill<'_> {
    type Output = (PreparedRays, [RayState; CHUNK]);

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> (PreparedRays, [RayState; CHUNK]) {
        let (mut lanes, mut ray_states) = (PreparedRays::NONE, [RayState::none(); CHUNK]);
        // SAFETY: the caller's contract.
        unsafe {
            lanes.fill::<S>(self.rays, self.scene, self.first, self.query);
            lanes.ray_states::<S>(&mut ray_states);
        }
        (lanes, ray_states)
    }
}

/// The first rays as a set prepares them, and their states.
pub(crate) fn filled(
    set: InstructionSet,
    rays: Rays<'_>,
    scene: &SceneScale,
    first: usize,
    query: Query,
) -> (PreparedRays, [RayState; CHUNK]) {
    // SAFETY: callers take sets that the processor has.
    unsafe { set.run(Fill { rays, scene, first, query }) }
}

/// Every field that a hit depends on is that of the scalar code, bit for bit, for rays of all
/// kinds, on every instruction set. The fields that only steps at nodes depend on are compared with
/// those of one ray prepared alone, by the tests of [`query::prepare_one`](crate::query::prepare_one).
#[test]
fn lanes_equal_the_scalar_code() {
    let bounds = Aabb { lo: [-1.0, -2.0, 0.5], hi: [3.0, 1.0, 4.0] };
    let limits = Limits { greatest: 4.0, least: 0.25, longest: 1.0, shortest: 0.1 };
    let scene = SceneScale::new(bounds, &limits);
    let mut random = Random::new(7);
    let odd = [0.0, -0.0, 1.0, -1.0, 1e-40, 1e-30, -1e-13, 1e30, f32::NAN, f32::INFINITY, 0.3];
    let mut rays = Vec::new();
    for round in 0..4100 {
        let mut number = |spread: f32| {
            if round % 4 == 0 { random.pick(&odd) } else { random.signed() * spread }
        };
        let origin = [number(5.0), number(5.0), number(5.0)];
        let direction = [number(1.0), number(1.0), number(1.0)];
        let (a, b) = (number(1.0), number(9.0));
        rays.push(Ray::new(origin, direction).with_limits(a, b.abs()));
    }
    for set in InstructionSet::available() {
        let (mut compared, mut dead) = (0, 0);
        for first in (0..rays.len()).step_by(CHUNK) {
            // Where there are more, they are read from where they are; the last are fewer than lanes.
            let chunk = &rays[first..];
            let (lanes, ray_states) =
                filled(set, Rays::Records(chunk), &scene, first, Query::Closest);
            for lane in chunk.len()..CHUNK {
                assert_eq!(lanes.alive[lane], 0, "{set:?} {lane}");
            }
            for (lane, ray) in chunk.iter().take(CHUNK).enumerate() {
                let expected = PreparedRay::new::<Strict>(ray, &scene);
                if lanes.special[lane] != 0 {
                    continue;
                }
                let Some(expected) = expected else {
                    assert_eq!(lanes.alive[lane], 0, "{set:?} {ray:?}");
                    dead += 1;
                    continue;
                };
                assert_eq!(lanes.alive[lane], 1, "{set:?} {ray:?}");
                let found = ray_states[lane].ray();
                let expected = PreparedRay { slack: [0.0; 3], ..expected };
                assert_eq!(found, expected, "{set:?} {ray:?}");
                assert_eq!(lanes.ray(lane), expected, "{set:?} {ray:?}");
                assert_eq!(ray_states[lane].index as usize, first + lane, "{set:?}");
                let interval = (lanes.enter[lane], lanes.exit[lane]);
                assert_eq!(
                    (ray_states[lane].enter, ray_states[lane].stop),
                    interval,
                    "{set:?} {ray:?}"
                );
                let expected = PreparedRay::new::<Strict>(ray, &scene).expect("alive");
                let expected = expected.enter::<Strict>(&bounds);
                assert_eq!((interval.0 <= interval.1).then_some(interval), expected);
                compared += 1;
            }
        }
        assert!(compared > 2000 && dead > 100, "{set:?} {compared} {dead}");
    }
}

/// Rows of six numbers are prepared as the records of the same rays are, to the last bit, wherever a batch ends.
#[test]
fn rows_are_prepared_as_records_are() {
    let bounds = Aabb { lo: [-1.0, -2.0, 0.5], hi: [3.0, 1.0, 4.0] };
    let limits = Limits { greatest: 4.0, least: 0.25, longest: 1.0, shortest: 0.1 };
    let scene = SceneScale::new(bounds, &limits);
    let mut random = Random::new(11);
    let odd = [0.0, -0.0, 1.0, 1e-40, -1e-13, 1e30, f32::NAN, f32::NEG_INFINITY];
    let rows: Vec<[f32; 6]> = (0..4 * CHUNK + 3)
        .map(|place| match place % 5 {
            0 => core::array::from_fn(|_| random.pick(&odd)),
            _ => core::array::from_fn(|_| random.signed() * 5.0),
        })
        .collect();
    for set in InstructionSet::available() {
        for (t_min, t_max) in [(0.0, f32::INFINITY), (-1.5, 3.0), (2.0, 1.0), (f32::NAN, 1.0)] {
            let rays = Rays::Rows { rows: &rows, t_min, t_max };
            let records: Vec<Ray> = (0..rows.len()).map(|place| rays.ray(place)).collect();
            // From no row to more than are read.
            for places in (0..=CHUNK + 3).map(|count| 7..7 + count) {
                for query in [Query::Closest, Query::Any] {
                    let own = filled(set, rays.part(places.clone()), &scene, 7, query);
                    let expected = Rays::Records(&records[places.clone()]);
                    let expected = filled(set, expected, &scene, 7, query);
                    let count = places.len().min(CHUNK);
                    assert_eq!(own.0.alive, expected.0.alive, "{set:?} {places:?}");
                    assert_eq!(own.0.special, expected.0.special, "{set:?} {places:?}");
                    assert_eq!(own.0.shifted, expected.0.shifted, "{set:?} {places:?}");
                    let bits =
                        |states: &[RayState]| bytemuck::cast_slice::<_, u32>(states).to_vec();
                    let (own, expected) = (bits(&own.1[..count]), bits(&expected.1[..count]));
                    assert_eq!(own, expected, "{set:?} {places:?}");
                }
            }
        }
    }
}
