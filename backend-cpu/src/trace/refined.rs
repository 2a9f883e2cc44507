//! Where rays meet the planes of triangles, a triangle and a ray per lane, for those that are seen
//! at too grazing an angle or from too near for interpolation, and for slivers.
//!
//! The operations are those of [`splitplane_core::query::intersect::refined`] in its order, on sums
//! of two floats that do not overlap (Dekker 1971), so the numbers are the same bit for bit. Left out
//! is only what adds zero: a zero may have the other sign here, which no other number depends on, since
//! divisors are not 0.

use splitplane_core::query::intersect::{DISTANCE_LEAST, T_LEAST};

use crate::simd::Simd;

/// Rays and triangles, a pair per lane; on the axes of the mesh.
pub(crate) struct Pairs<S: Simd> {
    /// Where the rays start.
    pub origin: [S::Floats; 3],
    /// Inner directions.
    pub direction: [S::Floats; 3],
    /// Corners, each on three axes.
    pub corners: [[S::Floats; 3]; 3],
}

/// The values of a meeting, a number per lane.
pub(crate) struct Refined<S: Simd> {
    /// Inner `t`.
    pub t: S::Floats,
    /// Weights of the second and the third corner, and the divisor of both.
    pub v: S::Floats,
    pub w: S::Floats,
    pub det: S::Floats,
}

impl<S: Simd> Pairs<S> {
    /// The same with corners at 0 in all other lanes: leftover contents may be subnormal numbers,
    /// for which processors take a hundred times as long.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn only(mut self, lanes: u32) -> Pairs<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let mask = S::mask(lanes);
            for corner in &mut self.corners {
                for x in corner {
                    *x = S::keep(mask, *x);
                }
            }
        }
        self
    }

    /// Where the rays meet the planes. For lanes that are robust, with sheared coordinates that need no scaling,
    /// and no needles.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn refined(&self) -> Refined<S> {
        // SAFETY: the caller's contract.
        unsafe {
            // No closures: they would not have the set's instructions.
            let [a, b, c] = self.corners;
            let (ab, ac) = (difference::<S>(b, a), difference::<S>(c, a));
            let oa = difference::<S>(a, self.origin);
            let d = self.direction;
            let (mut normal, mut across) = (ab, oa);
            for k in 0..3 {
                let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                normal[k] = ab[i].times(ac[j]).minus(ab[j].times(ac[i]));
                across[k] = oa[j].times_float(d[i]).minus(oa[i].times_float(d[j]));
            }
            let [x, y, z] = normal;
            let det = dot([x.times_float(d[0]), y.times_float(d[1]), z.times_float(d[2])]);
            let distance = dot([x.times(oa[0]), y.times(oa[1]), z.times(oa[2])]);
            let known = S::le(S::splat(DISTANCE_LEAST), S::abs(distance));
            let distance = S::select(known, distance, S::splat(0.0));
            let t = S::div(distance, det);
            let t = S::select(S::le(S::splat(T_LEAST), S::abs(t)), t, S::splat(0.0));
            let [x, y, z] = across;
            let v = dot([x.times(ac[0]), y.times(ac[1]), z.times(ac[2])]);
            let w = dot([x.times(ab[0]), y.times(ab[1]), z.times(ab[2])]);
            Refined { t, v: S::sub(S::splat(0.0), v), w, det }
        }
    }
}

/// The sum of three products, rounded.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn dot<S: Simd>([x, y, z]: [Double<S>; 3]) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe {
        let first = Double::<S>::sum_of(x.high, y.high);
        let second = Double::<S>::sum_of(first.high, z.high);
        let low = S::add(S::add(x.low, y.low), z.low);
        S::add(second.high, S::add(low, S::add(first.low, second.low)))
    }
}

/// Differences without error, on three axes.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn difference<S: Simd>(p: [S::Floats; 3], q: [S::Floats; 3]) -> [Double<S>; 3] {
    // SAFETY: the caller's contract.
    unsafe {
        [
            Double::difference_of(p[0], q[0]),
            Double::difference_of(p[1], q[1]),
            Double::difference_of(p[2], q[2]),
        ]
    }
}

/// Sums of two floats that do not overlap, one sum per lane: see
/// [`splitplane_core::arithmetic::Double`].
#[derive(Clone, Copy)]
struct Double<S: Simd> {
    high: S::Floats,
    low: S::Floats,
}

/// # Safety
/// All methods: the processor must have the set.
impl<S: Simd> Double<S> {
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

    /// `a + b` without error: Knuth's two-sum.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn sum_of(a: S::Floats, b: S::Floats) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let high = S::add(a, b);
            let b_part = S::sub(high, a);
            let a_part = S::sub(high, b_part);
            Double { high, low: S::add(S::sub(a, a_part), S::sub(b, b_part)) }
        }
    }

    /// The product, with its two parts not yet added.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn times(self, other: Double<S>) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let low = S::product_error(self.high, other.high);
            let low = S::add(low, S::mul(self.high, other.low));
            let low = S::add(low, S::mul(self.low, other.high));
            Double { high: S::mul(self.high, other.high), low }
        }
    }

    /// The product with floats, with its two parts not yet added.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn times_float(self, other: S::Floats) -> Double<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let low = S::product_error(self.high, other);
            let low = S::add(low, S::mul(self.low, other));
            Double { high: S::mul(self.high, other), low }
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
    use splitplane_core::query::intersect::refined;
    use splitplane_core::triangle::Triangle;
    use splitplane_test_support::random::Random;

    use super::*;
    use crate::simd::{Compiled, InstructionSet, MOST_LANES};

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

    /// How many meetings were compared, and how many pairs left out.
    #[derive(Default)]
    struct Compared {
        same: usize,
        left_out: usize,
    }

    impl Compiled for &mut Compared {
        type Output = ();

        #[cfg_attr(not(unoptimised), inline(always))]
        unsafe fn run<S: Simd>(self) {
            let mut random = Random::new(31);
            for round in 0..if cfg!(miri) { 40 } else { 20_000 } {
                let cases: [_; MOST_LANES] = core::array::from_fn(|i| {
                    let (origin, direction, triangle) =
                        case((round * MOST_LANES + i) as u32, &mut random);
                    (origin, direction, triangle)
                });
                // SAFETY: the caller's contract; rows have as many elements as any set has lanes.
                let found = unsafe {
                    let row = |of: &dyn Fn(usize) -> f32| {
                        S::load(core::array::from_fn::<_, MOST_LANES, _>(of).as_ptr())
                    };
                    let pairs = Pairs::<S> {
                        origin: [0, 1, 2].map(|k| row(&|i| cases[i].0[k])),
                        direction: [0, 1, 2].map(|k| row(&|i| cases[i].1[k])),
                        corners: [0, 1, 2].map(|c| [0, 1, 2].map(|k| row(&|i| cases[i].2[c][k]))),
                    };
                    let Refined { t, v, w, det } = pairs.refined();
                    [t, v, w, det].map(|of| {
                        let mut row = [0.0; MOST_LANES];
                        S::store(row.as_mut_ptr(), of);
                        row
                    })
                };
                for (i, (origin, direction, triangle)) in cases.iter().enumerate().take(S::N) {
                    let expected = refined::<Strict>(origin, direction, triangle, 1.0);
                    let expected = [expected.t, expected.u, expected.v];
                    // Not reached for triangles without area.
                    if !expected.iter().all(|x| x.is_finite()) {
                        self.left_out += 1;
                        continue;
                    }
                    let [t, v, w, det] = [0, 1, 2, 3].map(|k| found[k][i]);
                    // One zero is as good as the other.
                    assert_eq!(
                        [t, v / det, w / det].map(|x| (x + 0.0).to_bits()),
                        expected.map(|x| (x + 0.0).to_bits()),
                        "{} {:?}",
                        S::N,
                        cases[i]
                    );
                    self.same += 1;
                }
            }
        }
    }

    /// Of triangles of all kinds, seen from anywhere.
    #[test]
    fn numbers_are_those_of_the_reference() {
        let mut compared = Compared::default();
        for set in InstructionSet::available() {
            // SAFETY: the processor has it.
            unsafe { set.run(&mut compared) };
        }
        let Compared { same, left_out } = compared;
        assert!(same > 8 * left_out, "{same} {left_out}");
        assert!(same > 10_000 || cfg!(miri), "{same}");
    }
}
