//! The limits of a mesh's coordinates and extents, which every query needs to know once.

use splitplane_core::aabb::{max, min};
use splitplane_core::arithmetic::snap;
use splitplane_core::query::intersect::Limits;
use splitplane_core::triangle::{Triangle, prepare};

use crate::simd::every_set::for_every_set;

/// Triangles looked at together, and their coordinates, corner after corner.
const SOME: usize = 16;
const COORDINATES: usize = 9 * SOME;

for_every_set! {
    /// The limits of some snapped triangles, without those that are dropped: as
    /// [`Limits::of`] one by one.
    pub(crate) fn of<S>(triangles: &[Triangle]) -> Limits {
        let (some, rest) = triangles.as_chunks::<SOME>();
        let mut all = one_by_one(rest);
        for some in some {
            let limits = of_some(some.as_flattened().as_flattened(), &all);
            all = if let Some(limits) = limits { limits } else { all.union(one_by_one(some)) };
        }
        all
    }
}

fn one_by_one(triangles: &[Triangle]) -> Limits {
    let kept = triangles.iter().filter(|triangle| prepare(triangle).kept);
    kept.fold(Limits::NONE, |limits, triangle| limits.union(Limits::of(triangle)))
}

/// The limits together with those of [`SOME`] triangles, given by their coordinates; `None` where one of them
/// is dropped. Every number is compared with the one three places on, though only those of first and
/// second corners mean anything: that is what vectors are good at.
#[cfg_attr(not(unoptimised), inline(always))]
fn of_some(x: &[f32], limits: &Limits) -> Option<Limits> {
    let x = x.first_chunk::<COORDINATES>()?;
    let (mut bits, mut least) = ([limits.greatest.to_bits(); SOME], [limits.least; SOME]);
    for x in x.as_chunks::<SOME>().0 {
        for lane in 0..SOME {
            let magnitude = x[lane].abs();
            // The bits of what is no number are greater than those of all numbers.
            bits[lane] = bits[lane].max(magnitude.to_bits());
            let magnitude = if magnitude > 0.0 { magnitude } else { f32::MAX };
            least[lane] = min(least[lane], magnitude);
        }
    }
    let greatest = f32::from_bits(bits.into_iter().fold(0, u32::max));
    if !greatest.is_finite() {
        return None;
    }
    // By axis: half the extent, and which corners have the same coordinate, as bits.
    let (mut half, mut same) = ([0.0; COORDINATES], [0u32; COORDINATES]);
    for i in 0..COORDINATES - 6 {
        let [a, b, c] = [x[i], x[i + 3], x[i + 6]];
        let (lo, hi) = (min(min(a, b), c), max(max(a, b), c));
        half[i] = snap(snap(0.5 * hi) - snap(0.5 * lo));
        same[i] = u32::from(a == b) | u32::from(b == c) << 1 | u32::from(c == a) << 2;
    }
    let (mut longest, mut shortest, mut dropped) = (limits.longest, limits.shortest, 0);
    for i in (0..COORDINATES).step_by(9) {
        dropped |= same[i] & same[i + 1] & same[i + 2];
        let half = max(max(half[i], half[i + 1]), half[i + 2]);
        let extent = min(half, 0.5 * f32::MAX) * 2.0;
        (longest, shortest) = (max(longest, extent), min(shortest, extent));
    }
    let least = least.into_iter().fold(f32::MAX, min);
    (dropped == 0).then_some(Limits { greatest, least, longest, shortest })
}

#[cfg(test)]
mod tests {
    use splitplane_test_support::random::Random;

    use super::*;
    use crate::simd::InstructionSet;

    #[test]
    fn limits_are_those_of_all_kept_triangles() {
        let mut random = Random::new(5);
        let odd = [0.0, -0.0, 1e-38, f32::MAX, -f32::MAX, f32::INFINITY, f32::NAN, 1.0];
        for round in 0..400 {
            let extreme = round % 3 == 0;
            let triangles: Vec<Triangle> = (0..round % 37)
                .map(|_| {
                    let mut coordinate = || match random.below(if extreme { 4 } else { 400 }) {
                        0 => random.pick(&odd),
                        _ => random.below(1 << 12) as f32 * 0.01 - 20.0,
                    };
                    let mut triangle = [(); 3].map(|()| [(); 3].map(|()| coordinate()));
                    if random.below(9) == 0 {
                        triangle[2] = triangle[0];
                    }
                    prepare(&triangle).corners
                })
                .collect();
            let kept = triangles.iter().filter(|triangle| prepare(triangle).kept);
            let expected = kept.fold(Limits::NONE, |all, one| all.union(Limits::of(one)));
            for set in InstructionSet::available() {
                assert_eq!(of(set, &triangles), expected, "round {round}");
            }
        }
    }
}
