//! `t` of the planes of triangles, a triangle and a ray a lane, for those that are seen at too grazing
//! an angle or from too near for interpolation.
//!
//! The operations are those of [`splitplane_core::intersect::distance_to_plane`] in its order, on sums
//! of two floats that do not overlap (Dekker 1971), so `t` is the same bit for bit. Left out
//! is only what adds zero: a zero may have the other sign here, which no other number depends on, since
//! divisors are not 0.

use splitplane_core::intersect::DOUBLE_NOISE;

use super::simd::Simd;

/// Rays and triangles, a pair a lane; on the axes of the mesh.
pub(crate) struct Plane<S: Simd> {
    /// Where the rays start.
    pub origin: [S::Floats; 3],
    /// Inner directions.
    pub direction: [S::Floats; 3],
    /// Corners, each on three axes.
    pub corners: [[S::Floats; 3]; 3],
}

impl<S: Simd> Plane<S> {
    /// `t`, and which lanes have one: not triangles without a plane, nor rays within it.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub unsafe fn distance(&self) -> (S::Floats, u32) {
        // SAFETY: the caller's contract.
        unsafe {
            let [a, b, c] = self.corners;
            let (ab, ac) = (Double::<S>::edge(b, a), Double::<S>::edge(c, a));
            let oa = Double::<S>::edge(a, self.origin);
            let mut normal = ab;
            for axis in 0..3 {
                let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
                normal[axis] = ab[i].times(ac[j]).minus(ab[j].times(ac[i]));
            }
            let [x, y, z] = normal;
            let distance = x.times(oa[0]).plus(y.times(oa[1])).plus(z.times(oa[2]));
            let [dx, dy, dz] = self.direction;
            let speed = x.times_float(dx).plus(y.times_float(dy)).plus(z.times_float(dz));
            let t = S::div(distance.high, speed.high);
            // Below this the normal is what rounding left.
            let noise = S::mul(S::mul(length::<S>(ab), length::<S>(ac)), S::splat(DOUBLE_NOISE));
            let least = S::max(noise, S::splat(f32::MIN_POSITIVE));
            let without = S::bits(S::le(S::abs(speed.high), least));
            (t, S::bits(S::le(S::abs(t), S::splat(f32::MAX))) & !without)
        }
    }
}

/// The longest extent of edges.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn length<S: Simd>([x, y, z]: [Double<S>; 3]) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe { S::magnitude(S::magnitude(x.high, y.high), z.high) }
}

/// Sums of two floats that do not overlap, a sum a lane: see [`splitplane_core::arithmetic::Double`].
#[derive(Clone, Copy)]
struct Double<S: Simd> {
    high: S::Floats,
    low: S::Floats,
}

/// # Safety
/// All methods: the processor must have the set.
impl<S: Simd> Double<S> {
    /// From `from` to `to`, without error.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn edge(to: [S::Floats; 3], from: [S::Floats; 3]) -> [Double<S>; 3] {
        // SAFETY: the caller's contract.
        unsafe {
            [
                Double::difference_of(to[0], from[0]),
                Double::difference_of(to[1], from[1]),
                Double::difference_of(to[2], from[2]),
            ]
        }
    }

    /// `a - b` without error: Knuth's two-sum of `a` and `-b`.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn difference_of(a: S::Floats, b: S::Floats) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let high = S::sub(a, b);
            let b_part = S::sub(high, a);
            let a_part = S::sub(high, b_part);
            Double { high, low: S::sub(S::sub(a, a_part), S::add(b, b_part)) }
        }
    }

    /// The product.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn times(self, other: Double<S>) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let low = S::product_error(self.high, other.high);
            let low = S::add(low, S::mul(self.high, other.low));
            let low = S::add(low, S::mul(self.low, other.high));
            Double::renormalised(S::mul(self.high, other.high), low)
        }
    }

    /// The product with floats.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn times_float(self, other: S::Floats) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let low = S::product_error(self.high, other);
            let low = S::add(low, S::mul(self.low, other));
            Double::renormalised(S::mul(self.high, other), low)
        }
    }

    /// The sum.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn plus(self, other: Double<S>) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let high = S::add(self.high, other.high);
            let part = S::sub(high, self.high);
            let own = S::sub(high, part);
            let low = S::add(S::sub(self.high, own), S::sub(other.high, part));
            Double::renormalised(high, S::add(low, S::add(self.low, other.low)))
        }
    }

    /// The difference.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn minus(self, other: Double<S>) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let Double { high, low } = Double::<S>::difference_of(self.high, other.high);
            Double::renormalised(high, S::add(low, S::sub(self.low, other.low)))
        }
    }

    /// Dekker's fast two-sum: `high` is the greater.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn renormalised(high: S::Floats, low: S::Floats) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let sum = S::add(high, low);
            Double { high: sum, low: S::sub(low, S::sub(sum, high)) }
        }
    }
}

#[cfg(test)]
mod tests {
    use splitplane_core::arithmetic::{Strict, power_of_two};
    use splitplane_core::intersect::distance_to_plane;
    use splitplane_core::triangle::Triangle;
    use splitplane_test_support::random::Random;

    use super::*;
    use crate::query::InstructionSet;
    use crate::query::simd::{Compiled, MOST_LANES};

    /// A power of two, with an exponent from one to another.
    fn power(random: &mut Random, from: i32, to: i32) -> f32 {
        power_of_two(from + random.below((to - from + 1) as usize) as i32)
    }

    fn along(from: [f32; 3], way: [f32; 3], far: f32) -> [f32; 3] {
        [0, 1, 2].map(|k| from[k] + way[k] * far)
    }

    /// An origin, a direction and a triangle, as bad as tests that are in range may meet.
    fn case(kind: u32, random: &mut Random) -> ([f32; 3], [f32; 3], Triangle) {
        let mut triangle = [random.point(1.0), random.point(1.0), random.point(1.0)];
        let (mut origin, mut direction) = (random.point(1.0), random.point(1.0));
        let inside = |random: &mut Random, [a, b, c]: Triangle| {
            let (u, v) = (random.signed().abs(), random.signed().abs());
            [0, 1, 2].map(|k| a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]))
        };
        match kind % 8 {
            // Grazing, more and less.
            0 | 1 => {
                let (from, to) = (inside(random, triangle), inside(random, triangle));
                let off = if kind.is_multiple_of(8) { 0.0 } else { power(random, -24, -4) };
                direction = along([0, 1, 2].map(|k| to[k] - from[k]), random.point(1.0), off);
                origin = along(from, direction, 3.0 * random.signed());
            }
            // A sliver.
            2 => {
                let [a, b, _] = triangle;
                let edge = [0, 1, 2].map(|k| b[k] - a[k]);
                triangle[2] = along(a, edge, random.signed());
                if kind % 16 < 8 {
                    let off = power(random, -30, -10);
                    triangle[2] = along(triangle[2], random.point(1.0), off);
                }
            }
            // Started on the triangle, or next to it.
            3 => origin = inside(random, triangle),
            4 => {
                origin = along(inside(random, triangle), random.point(1.0), power(random, -24, -8));
            }
            // Flat on an axis, with corners that are one, or starting at a corner.
            5 => {
                let axis = kind as usize / 8 % 3;
                triangle.iter_mut().for_each(|corner| corner[axis] = 0.25);
                direction[(axis + 1) % 3] = 0.0;
                if kind % 16 < 8 {
                    triangle[1] = triangle[2];
                }
                origin = triangle[0];
            }
            // Coordinates of all sizes.
            6 => {
                let all = triangle.iter_mut().chain([&mut origin, &mut direction]);
                all.flatten().for_each(|x| *x *= power(random, -40, 0));
            }
            _ => {}
        }
        // To the ends of what is in range.
        let scale = match kind / 8 % 4 {
            0 => power(random, -61, -30),
            1 => power(random, 20, 37),
            _ => 1.0,
        };
        let scaled = |p: [f32; 3]| p.map(|x| x * scale);
        (scaled(origin), direction, triangle.map(scaled))
    }

    /// How many planes there were, and how many triangles without.
    #[derive(Default)]
    struct Planes {
        there: usize,
        without: usize,
    }

    impl Compiled for &mut Planes {
        type Output = ();

        #[cfg_attr(not(unoptimised), inline(always))]
        unsafe fn run<S: Simd>(self) {
            let mut random = Random::new(31);
            for round in 0..if cfg!(miri) { 40 } else { 20_000 } {
                let cases: [_; MOST_LANES] =
                    core::array::from_fn(|i| case((round * MOST_LANES + i) as u32, &mut random));
                // SAFETY: the caller's contract; rows have as many elements as any set has lanes.
                let (t, there) = unsafe {
                    let row = |of: &dyn Fn(usize) -> f32| {
                        S::load(core::array::from_fn::<_, MOST_LANES, _>(of).as_ptr())
                    };
                    let plane = Plane::<S> {
                        origin: [0, 1, 2].map(|k| row(&|i| cases[i].0[k])),
                        direction: [0, 1, 2].map(|k| row(&|i| cases[i].1[k])),
                        corners: [0, 1, 2].map(|c| [0, 1, 2].map(|k| row(&|i| cases[i].2[c][k]))),
                    };
                    let (t, there) = plane.distance();
                    let mut row = [0.0; MOST_LANES];
                    S::store(row.as_mut_ptr(), t);
                    (row, there)
                };
                for (i, (origin, direction, triangle)) in cases.iter().enumerate().take(S::N) {
                    let found = (there >> i & 1 != 0).then_some(t[i] + 0.0);
                    let expected = distance_to_plane::<Strict>(origin, direction, triangle);
                    // One zero is as good as the other.
                    let expected = expected.map(|t| t + 0.0);
                    assert_eq!(
                        found.map(f32::to_bits),
                        expected.map(f32::to_bits),
                        "{} {found:?} {expected:?} {:?}",
                        S::N,
                        cases[i]
                    );
                    self.there += usize::from(found.is_some());
                    self.without += usize::from(found.is_none());
                }
            }
        }
    }

    /// Of triangles of all kinds, seen from anywhere.
    #[test]
    fn planes_are_those_of_the_reference() {
        let mut planes = Planes::default();
        for set in InstructionSet::available() {
            // SAFETY: the processor has it.
            unsafe { set.run(&mut planes) };
        }
        assert!(planes.without > 1_000 || cfg!(miri), "{}", planes.without);
        assert!(planes.there > 3 * planes.without, "{} {}", planes.there, planes.without);
    }
}
