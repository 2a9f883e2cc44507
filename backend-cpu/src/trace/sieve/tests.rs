use super::*;

use crate::layout::gathered_block::GatheredBlock;
use crate::simd::{Compiled, InstructionSet};
use crate::trace::prepare_one::Readiness;
use crate::trace::prepare_one::tests::prepared;
use splitplane_core::exact::meet;
use splitplane_core::query::intersect::{Limits, SceneScale};
use splitplane_core::ray::Culling;
use splitplane_core::triangle::Triangle;
use splitplane_test_support::random::Random;

/// 16 triangles around one another: a fan, slivers, and some all over the place.
fn triangles(random: &mut Random, scale: f64) -> Vec<Triangle> {
    let mut point = |spread: f64| [(); 3].map(|()| random.between(-spread, spread) * scale);
    let hub = point(1.0);
    let mut rim = [0, 1, 2].map(|k| hub[k] + point(0.1)[k]);
    (0..16)
        .map(|i| {
            let mut next = [0, 1, 2].map(|k| hub[k] + point(0.1)[k]);
            if i % 4 == 3 {
                // A sliver: its third corner beside its second one.
                next = [0, 1, 2].map(|k| rim[k] + point(1e-5)[k]);
            }
            let corners =
                if i % 5 == 4 { [point(1.0), point(1.0), point(1.0)] } else { [hub, rim, next] };
            rim = next;
            corners.map(|corner| corner.map(|x| x as f32))
        })
        .collect()
}

/// A block of 16 triangles, and the words that may be read after it.
fn words(triangles: &[Triangle]) -> Vec<f32> {
    let mut words = vec![0.0; 10 * 16 + 16];
    for (i, corners) in triangles.iter().enumerate() {
        for (row, &x) in corners.as_flattened().iter().enumerate() {
            words[row * 16 + i] = x;
        }
        words[9 * 16 + i] = f32::from_bits(i as u32);
    }
    words
}

/// A ray from near, from far or from a triangle itself to a corner, an edge, or inside.
fn ray(random: &mut Random, triangles: &[Triangle], scale: f64) -> Ray {
    let on = |random: &mut Random| {
        let corners = random.pick(triangles);
        let mut weights = random.barycentric();
        match random.below(3) {
            0 => weights = [0.0, 1.0, 0.0],
            1 => weights = [weights[0], 1.0 - weights[0], 0.0],
            _ => {}
        }
        [0, 1, 2].map(|k| (0..3).map(|i| weights[i] * f64::from(corners[i][k])).sum::<f64>())
    };
    let target = on(random);
    let away = random.direction();
    let distance = random.pick(&[0.01, 1.0, 40.0]) * scale;
    let origin = match random.below(3) {
        0 => on(random),
        _ => [0, 1, 2].map(|k| target[k] + distance * away[k]),
    };
    let origin = origin.map(|x| x as f32);
    let direction = [0, 1, 2].map(|k| (target[k] - f64::from(origin[k])) as f32);
    let ray = Ray::new(origin, direction);
    match random.below(4) {
        0 => ray.with_limits(-1.0, 1.0),
        1 => ray.with_limits(1e-6, 0.999_999),
        2 => ray.with_limits(1.0, 2.0),
        _ => ray,
    }
}

/// What is tested here.
struct Sift<'a> {
    ray_state: &'a RayState,
    reach: &'a Reach,
    block: &'a GatheredBlock<'a>,
    limit: f32,
    culling: Culling,
}

impl Compiled for Sift<'_> {
    type Output = Option<Sifted>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Option<Sifted> {
        // SAFETY: the caller's contract.
        unsafe { sift::<S, _>(self.ray_state, self.reach, self.block, self.limit, self.culling) }
    }
}

/// What came of pairs of rays and triangles.
#[derive(Debug, Default)]
struct Counts {
    /// That meet but were rejected.
    lost: usize,
    /// That meet.
    met: usize,
    /// That were kept.
    kept: usize,
    /// That are certain, and those of them that do not meet.
    certain: usize,
    wrong: usize,
    /// That meet at a `t` that is not where they are said to.
    elsewhere: usize,
    all: usize,
}

/// What an error is multiplied by.
#[derive(Clone, Copy)]
struct Share {
    /// That of edge functions by the distance of the scene.
    edges: f32,
    /// Those by a triangle's own distance.
    own: f32,
}

/// Tries pairs of rays and triangles. The errors that the sieve assumes are multiplied by their share.
fn try_out(set: InstructionSet, share: Share) -> Counts {
    let mut counts = Counts::default();
    for round in 0..1500 {
        let mut random = Random::new(round);
        let scale = random.pick(&[1.0, 1.0, 1e-9, 1e9]);
        let triangles = triangles(&mut random, scale);
        let words = words(&triangles);
        let count = 1 + random.below(16);
        let limits = triangles.iter().fold(Limits::NONE, |all, t| all.union(Limits::of(t)));
        let bounds = Aabb::of_points(triangles.as_flattened());
        let scene = SceneScale::new(bounds, &limits);
        for _ in 0..16 {
            let ray = ray(&mut random, &triangles[..count], scale);
            let (Readiness::Ready, ray_state) = prepared(set, &ray, &scene, Query::Closest) else {
                continue;
            };
            let Some(exact) = ExactRay::new(&ray) else { continue };
            let mut reach = Reach::new(&ray_state, &[bounds; 2]);
            if ray_state.ray().origin != exact.origin {
                continue;
            }
            reach.errors.as_flattened_mut().iter_mut().for_each(|error| *error *= share.edges);
            // Of one triangle the distance is not known beforehand; what is added to it is.
            if share.own == 0.0 {
                reach.moved -= 2e-10 * scale as f32;
                let farthest = triangles
                    .as_flattened()
                    .iter()
                    .flat_map(|corner| (0..3).map(|k| (corner[k] - ray.origin[k]).abs()));
                reach.moved -= farthest.fold(0.0, f32::max);
            }
            let culling = match random.below(16) {
                0 => Culling::Back,
                1 => Culling::Front,
                _ => Culling::None,
            };
            let found: Vec<_> = triangles[..count]
                .iter()
                .map(|corners| meet(&exact, corners, culling).filter(|met| met.is_within_limits()))
                .collect();
            let nearest = found.iter().flatten().min_by(|a, b| a.compare_t(b));
            let mut best = Best::default();
            for (corners, i) in triangles[..count].iter().zip(0..) {
                best.test(&exact, corners, i, culling, Query::Closest);
            }
            let of = (ray_state.exponent, ray_state.offset);
            let stop = inner_interval(&best, of, reach.late)[1];
            for limit in [reach.t_max, reach.t_max.min(stop)] {
                let (mut bits, mut certain) = (0, 0);
                let (mut low, mut high) = ([0.0; 16], [0.0; 16]);
                for first in (0..count).step_by(set.lanes()) {
                    let count = (count - first).min(set.lanes());
                    let block =
                        GatheredBlock { words: &words[first..], stride: 16, count, large: false };
                    let (ray_state, reach, block) = (&ray_state, &reach, &block);
                    let sift = Sift { ray_state, reach, block, limit, culling };
                    // SAFETY: the caller names sets that the processor has; more words follow.
                    let Some(some) = (unsafe { set.run(sift) }) else { continue };
                    assert_eq!(u64::from(some.bits) >> count, 0, "triangles that are not there");
                    assert_eq!(some.certain & !some.bits, 0, "certain and not met");
                    bits |= some.bits << first;
                    certain |= some.certain << first;
                    low[first..first + count].copy_from_slice(&some.low[..count]);
                    high[first..first + count].copy_from_slice(&some.high[..count]);
                }
                for (i, found) in found.iter().enumerate() {
                    let wanted = found.as_ref().is_some_and(|met| {
                        limit == reach.t_max
                            || nearest.is_some_and(|best| met.compare_t(best).is_le())
                    });
                    let [is_kept, is_certain] = [bits, certain].map(|bits| bits >> i & 1 != 0);
                    counts.lost += usize::from(wanted && !is_kept);
                    counts.met += usize::from(wanted);
                    counts.kept += usize::from(is_kept);
                    counts.certain += usize::from(is_certain);
                    counts.wrong += usize::from(is_certain && found.is_none());
                    if let Some(found) = found.as_ref().filter(|_| is_kept) {
                        let (least, most) = found.t_interval();
                        let power = f64::from_bits(((ray_state.exponent + 1023) as u64) << 52);
                        let inner = |t: f64| t * power - f64::from(ray_state.offset);
                        let apart =
                            inner(most) < f64::from(low[i]) || f64::from(high[i]) < inner(least);
                        counts.elsewhere += usize::from(apart);
                    }
                    counts.all += 1;
                }
            }
        }
    }
    counts
}

const AS_THEY_ARE: Share = Share { edges: 1.0, own: 1.0 };

#[test]
fn what_is_met_is_kept() {
    for set in InstructionSet::available() {
        let counts = try_out(set, AS_THEY_ARE);
        println!("{set:?}: {counts:?}");
        let Counts { lost, met, kept, all, .. } = counts;
        assert_eq!(lost, 0, "{set:?}: {counts:?}");
        // And little else: these rays are aimed at edges.
        assert!(met > 30_000 && kept < 3 * met && kept * 4 < all, "{counts:?}");
    }
}

/// What is certain is a hit, and where it is said to be.
#[test]
fn what_is_certain_is_met() {
    for set in InstructionSet::available() {
        let counts = try_out(set, AS_THEY_ARE);
        assert_eq!([counts.wrong, counts.elsewhere], [0, 0], "{set:?}: {counts:?}");
        // A third of these rays are aimed between edges.
        assert!(counts.certain * 10 > counts.met, "{counts:?}");
    }
}

/// Without the slack for rounding, rays aimed at edges are lost: the first test above detects that.
#[test]
fn too_little_room_is_seen() {
    for set in InstructionSet::available() {
        assert!(try_out(set, Share { edges: 0.0, ..AS_THEY_ARE }).lost > 100);
    }
}

/// Nor would hits be certain or in their place, which the second one detects.
#[test]
fn too_little_doubt_is_seen() {
    for set in InstructionSet::available() {
        let counts = try_out(set, Share { own: 0.0, ..AS_THEY_ARE });
        assert!(counts.wrong > 10 && counts.elsewhere > 1000, "{counts:?}");
    }
}
