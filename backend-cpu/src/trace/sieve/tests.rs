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
}

impl Compiled for Sift<'_> {
    type Output = u32;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> u32 {
        // SAFETY: the caller's contract.
        unsafe { sift::<S, _>(self.ray_state, self.reach, self.block, self.limit) }
    }
}

/// Pairs of rays and triangles: those that meet but were rejected, those that meet, and those that
/// were kept, of all tried. The error that the sieve assumes for an edge function is multiplied by
/// `share`.
fn try_out(set: InstructionSet, share: f32) -> [usize; 4] {
    let (mut lost, mut met, mut kept, mut all) = (0, 0, 0, 0);
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
            let Some(mut lane) = ExactLane::new(&ray, &ray_state, &[bounds; 2]) else {
                continue;
            };
            if ray_state.ray().origin != lane.ray.origin {
                continue;
            }
            lane.reach.errors.as_flattened_mut().iter_mut().for_each(|error| *error *= share);
            let found: Vec<_> = triangles[..count]
                .iter()
                .map(|corners| {
                    meet(&lane.ray, corners, Culling::None).filter(|met| met.is_within_limits())
                })
                .collect();
            let nearest = found.iter().flatten().min_by(|a, b| a.compare_t(b));
            let stop = nearest.map_or(f64::INFINITY, |met| met.t_interval().1);
            let stop = inner_stop(stop, ray_state.exponent, ray_state.offset);
            for limit in [lane.reach.t_max, lane.reach.t_max.min(stop)] {
                let mut bits = 0;
                for first in (0..count).step_by(set.lanes()) {
                    let count = (count - first).min(set.lanes());
                    let block =
                        GatheredBlock { words: &words[first..], stride: 16, count, large: false };
                    let sift =
                        Sift { ray_state: &ray_state, reach: &lane.reach, block: &block, limit };
                    // SAFETY: the caller names sets that the processor has; more words follow.
                    let some = unsafe { set.run(sift) };
                    assert_eq!(u64::from(some) >> count, 0, "triangles that are not there");
                    bits |= some << first;
                }
                for (i, found) in found.iter().enumerate() {
                    let wanted = found.as_ref().is_some_and(|met| {
                        limit == lane.reach.t_max
                            || nearest.is_some_and(|best| met.compare_t(best).is_le())
                    });
                    let is_kept = bits >> i & 1 != 0;
                    lost += usize::from(wanted && !is_kept);
                    met += usize::from(wanted);
                    kept += usize::from(is_kept);
                    all += 1;
                }
            }
        }
    }
    [lost, met, kept, all]
}

#[test]
fn what_is_met_is_kept() {
    for set in InstructionSet::available() {
        let [lost, met, kept, all] = try_out(set, 1.0);
        println!("{set:?}: {lost} lost of {met} met, {kept} kept of {all}");
        assert_eq!(lost, 0, "{set:?}: {met} met");
        // And little else: these rays are aimed at edges.
        assert!(met > 30_000 && kept < 3 * met && kept * 4 < all, "{met} {kept} {all}");
    }
}

/// Without the slack for rounding, rays aimed at edges are lost: the test above detects that.
#[test]
fn too_little_room_is_seen() {
    for set in InstructionSet::available() {
        assert!(try_out(set, 0.0)[0] > 100);
    }
}
