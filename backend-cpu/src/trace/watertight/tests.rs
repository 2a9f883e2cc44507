use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Strict;
use splitplane_core::query::intersect::{Limits, PreparedRay, SceneScale, watertight};
use splitplane_core::ray::Ray;
use splitplane_core::triangle::Triangle;
use splitplane_test_support::random::Random;

use super::*;
use crate::simd::{Compiled, InstructionSet};

/// A ray towards a point of a large triangle, from nearby, at any angle.
fn pair(round: usize, scene: &SceneScale, random: &mut Random) -> (PreparedRay, Triangle) {
    loop {
        let triangle = [random.point(9.0), random.point(9.0), random.point(9.0)];
        let [a, b, c] = triangle;
        let mut inside = || {
            let (u, v) = (0.5 * random.signed().abs(), 0.6 * random.signed().abs());
            [0, 1, 2].map(|k| a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]))
        };
        let (from, to) = (inside(), inside());
        let off = random.point([1.0, 1e-2, 1e-4, 1e-6][round % 4]);
        let origin = match round / 4 % 3 {
            0 => [0, 1, 2].map(|k| from[k] + off[k]),
            1 => from,
            _ => random.point(9.0),
        };
        let direction = [0, 1, 2].map(|k| to[k] - origin[k]);
        let ray = Ray::new(origin, direction);
        let ray = if round.is_multiple_of(5) { ray.with_limits(-1.0, 1.0) } else { ray };
        if let Some(mut ray) = PreparedRay::new::<Strict>(&ray, scene) {
            // Limits next to the hit: what is left out early must lie before them by more than the error of `t`.
            if round % 7 < 3
                && let Some(hit) = watertight::<Strict>(&ray, &triangle, Culling::None)
            {
                let part = random.signed() * 0.5f32.powi(random.below(24) as i32);
                ray.t_min = hit.t + part * hit.t.abs();
            }
            return (ray, triangle);
        }
    }
}

/// A ray and a triangle per lane.
struct Lanes([(PreparedRay, Triangle); MOST_LANES]);

impl Lanes {
    /// # Safety
    /// The processor must have the set.
    unsafe fn row<S: Simd>(&self, of: impl Fn(&PreparedRay, &Triangle) -> f32) -> S::Floats {
        let row = self.0.map(|(ray, triangle)| of(&ray, &triangle));
        // SAFETY: the caller's contract; no set has more lanes.
        unsafe { S::load(row.as_ptr()) }
    }

    /// # Safety
    /// The processor must have the set.
    unsafe fn corners<S: Simd>(&self) -> [Corner<S>; 3] {
        // SAFETY: the caller's contract.
        unsafe {
            [0, 1, 2].map(|c| {
                Corner::new(
                    [0, 1, 2].map(|k| self.row::<S>(|ray, corners| corners[c][ray.axes[k]])),
                    [0, 1, 2].map(|k| self.row::<S>(|ray, _| ray.origin[ray.axes[k]])),
                    [0, 1, 2].map(|k| self.row::<S>(|ray, _| ray.shear[k])),
                )
            })
        }
    }
}

impl Lanes {
    /// # Safety
    /// The processor must have the set.
    unsafe fn pairs<S: Simd>(&self) -> Pairs<S> {
        // SAFETY: the caller's contract.
        unsafe {
            Pairs {
                origin: [0, 1, 2].map(|k| self.row::<S>(|ray, _| ray.origin[k])),
                direction: [0, 1, 2].map(|k| self.row::<S>(|ray, _| ray.direction[k])),
                corners: [0, 1, 2]
                    .map(|c| [0, 1, 2].map(|k| self.row::<S>(|_, corners| corners[c][k]))),
            }
        }
    }
}

impl<S: Simd> View<S> for Lanes {
    unsafe fn flat(&self) -> [[S::Floats; 3]; 2] {
        // SAFETY: the caller's contract.
        let corners = unsafe { self.corners::<S>() };
        [0, 1].map(|k| corners.map(|corner| corner.flat[k]))
    }

    unsafe fn depths(&self) -> [S::Floats; 3] {
        // SAFETY: the caller's contract.
        unsafe { self.corners::<S>() }.map(|corner| corner.depth)
    }

    unsafe fn reach(&self) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe {
            let [a, b, c] = self.corners::<S>().map(|corner| corner.reach());
            S::max(a, S::max(b, c))
        }
    }

    unsafe fn width(&self, [low, high]: [S::Floats; 2]) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe { S::magnitude(low, high) }
    }
}

/// How many hits there were by interpolation, how many by a closer look, and how many lanes were left.
#[derive(Default)]
struct Meetings([usize; 3]);

impl Compiled for &mut Meetings {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let mut random = Random::new(5);
        let bounds = Aabb { lo: [-9.0; 3], hi: [9.0; 3] };
        let scene = SceneScale::new(
            bounds,
            &Limits { greatest: 9.0, least: 1e-9, longest: 18.0, shortest: 1e-3 },
        );
        for round in 0..if cfg!(miri) { 30 } else { 4_000 } {
            let culling = [Culling::None, Culling::Back, Culling::Front][round % 3];
            let lanes = Lanes(core::array::from_fn(|_| pair(round, &scene, &mut random)));
            // SAFETY: the caller's contract; rows have as many elements as any set has lanes.
            let (plain, met) = unsafe {
                let t_max = lanes.row::<S>(|ray, _| ray.t_max);
                let t_min = lanes.row::<S>(|ray, _| ray.t_min);
                let span = Span { t_min, t_max, stop: t_max };
                let all = (1u32 << S::N) - 1;
                let met = meet::<S, _>(&lanes, all, &span, culling);
                let around = enclosed::<S, _>(&lanes);
                match met {
                    // Then the reference must miss in every lane.
                    None => (0, Met::NONE),
                    Some(mut meeting) => {
                        let plain = meeting.met;
                        meeting.look_closely(lanes.pairs(), &span);
                        assert_eq!((meeting.met | meeting.unclear) & !around, 0);
                        (plain, Met::of(&meeting))
                    }
                }
            };
            for (i, (ray, triangle)) in lanes.0.iter().enumerate().take(S::N) {
                let expected = watertight::<Strict>(ray, triangle, culling);
                if met.unclear >> i & 1 != 0 {
                    self.0[2] += 1;
                    continue;
                }
                let found = (met.met >> i & 1 != 0).then(|| met.candidate(i));
                // One zero is as good as the other.
                let bits = |hit: Option<Candidate>| {
                    hit.map(|hit| [hit.t + 0.0, hit.u, hit.v].map(f32::to_bits))
                };
                assert_eq!(bits(found), bits(expected), "{} {:?}", S::N, lanes.0[i]);
                self.0[0] += (plain >> i & 1) as usize;
                self.0[1] += ((met.met & !plain) >> i & 1) as usize;
            }
        }
    }
}

/// By interpolation and by a closer look.
#[test]
fn meetings_are_those_of_the_reference() {
    let mut meetings = Meetings::default();
    for set in InstructionSet::available() {
        // SAFETY: the processor has it.
        unsafe { set.run(&mut meetings) };
    }
    let [plain, close, left] = meetings.0;
    assert!(plain > 1_000 && close > 1_000 || cfg!(miri), "{plain} {close}");
    // Most of these rays lie in the plane of their triangle or nearly so, and pass its edges within rounding.
    assert!(left < plain + close, "{left} left of {plain} and {close}");
}
