//! Bounds against whole numbers, and surfaces crossed once.

use alloc::vec::Vec;
use core::cmp::Ordering;

use super::integer::{self, Integer};
use super::meeting::Edges;
use super::*;
use crate::ray::Culling;
use crate::triangle::Triangle;

/// A small generator: numbers of the given kind.
struct Numbers(u32);

impl Numbers {
    fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        self.0 ^ self.0 >> 16
    }

    /// Whole numbers from -4 to 4, where much is degenerate; or any floats; or neighbours of 1.
    fn float(&mut self, kind: u32) -> f32 {
        let bits = self.bits();
        match kind % 4 {
            0 => (bits % 9) as f32 - 4.0,
            1 => {
                let x = snap(f32::from_bits(bits));
                if x.is_finite() { x } else { 1.0 }
            }
            2 => f32::from_bits(1.0f32.to_bits() + bits % 16),
            _ => (bits >> 8) as f32 / 8_388_608.0 - 1.0,
        }
    }

    fn point(&mut self, kind: u32) -> [f32; 3] {
        core::array::from_fn(|_| self.float(kind))
    }

    fn ray(&mut self, kind: u32) -> Option<ExactRay> {
        ExactRay::new(&Ray::new(self.point(kind), self.point(kind)))
    }

    fn triangle(&mut self, kind: u32) -> Triangle {
        core::array::from_fn(|_| self.point(kind))
    }
}

#[test]
fn what_bounds_decide_is_right() {
    let mut numbers = Numbers(3);
    let (mut decided, mut met, mut zero) = (0, 0, 0);
    for round in 0..20_000 {
        let Some(ray) = numbers.ray(round) else { continue };
        let corners = numbers.triangle(round / 4);
        let edges = Edges::new(&ray, &corners);
        for edge in 0..3 {
            let exact = edges.exactly(edge).sign();
            zero += u32::from(exact.is_eq());
            if let Some(sign) = edges.approximate[edge].sign() {
                assert_eq!(sign, exact, "{ray:?} {corners:?}");
                decided += 1;
            }
        }
        if let Some(meeting) = meet(&ray, &corners, Culling::None) {
            met += 1;
            let (numerator, denominator) = meeting.parts();
            for (known, exact) in edges.plane().iter().zip([&numerator, &denominator]) {
                assert!(known.sign().is_none_or(|sign| sign == exact.sign()));
            }
            assert_eq!(meeting.t(), integer::quotient(&numerator, &denominator));
            // The interval holds the distance: compared with floats around it.
            for limit in [meeting.t().next_down(), meeting.t(), meeting.t().next_up(), 0.0] {
                if limit.is_infinite() {
                    continue;
                }
                let (least, most) = meeting.t_interval();
                let exact = numerator
                    .times(&Integer::from_float(1.0))
                    .minus(&denominator.times(&Integer::from_float(limit)));
                let order = match denominator.sign() {
                    Ordering::Less => exact.sign().reverse(),
                    _ => exact.sign(),
                };
                assert!(f64::from(limit) >= least || order.is_gt());
                assert!(f64::from(limit) <= most || order.is_lt());
                assert_eq!(meeting.compare_limit(limit), order);
            }
        }
    }
    assert!(decided > 20_000 && met > 500 && zero > 100, "{decided} {met} {zero}");
}

/// A closed surface: the eight triangles around a vertex at the origin and their mirror images.
/// Weights from sums of two `f64` are those of whole numbers, from origins that leave too few bits to `f64` alone.
#[test]
fn weights_of_far_hits_are_right() {
    let mut numbers = Numbers(8);
    let (mut met, mut close) = (0, 0);
    for round in 0..40_000 {
        let corners = numbers.triangle([2, 3][round % 2]);
        let far = crate::arithmetic::power_of_two((round / 2 % 40) as i32);
        let [a, b, c] = corners;
        let direction = core::array::from_fn(|k| far * ((a[k] + b[k] + c[k]) / 3.0 - 2.0));
        let Some(ray) = ExactRay::new(&Ray::new(direction.map(|x: f32| -x), direction)) else {
            continue;
        };
        let Some(meeting) = meet(&ray, &corners, Culling::None) else { continue };
        met += 1;
        for i in 0..2 {
            let (found, expected) = (meeting.weight_closely(i), meeting.weight_exactly(i));
            assert!((found - expected).abs() <= 6e-8, "{ray:?} {corners:?}: {found} {expected}");
            close += u32::from(meeting.weights()[i] == found);
        }
    }
    assert!(met > 1_000 && close > met, "{met} {close}");
}

fn octahedron() -> Vec<Triangle> {
    let mut out = Vec::new();
    for octant in 0..8 {
        let sign = |axis: u32| if octant >> axis & 1 == 0 { 1.0 } else { -1.0 };
        let (x, y, z) = ([sign(0), 0.0, 0.0], [0.0, sign(1), 0.0], [0.0, 0.0, sign(2)]);
        // Outside is the front.
        let outward = sign(0) * sign(1) * sign(2) > 0.0;
        out.push(if outward { [x, y, z] } else { [x, z, y] });
    }
    out
}

#[test]
fn closed_surfaces_are_crossed_in_and_out() {
    let surface = octahedron();
    let mut through_edges = 0;
    for round in 0..2_000 {
        let mut numbers = Numbers(round);
        let kind = [0, 3][round as usize % 2];
        let Some(ray) = numbers.ray(kind) else { continue };
        let crossed: Vec<_> =
            surface.iter().filter_map(|corners| cross(&ray, corners, Culling::None)).collect();
        let fronts = crossed.iter().filter(|met| met.is_front()).count();
        assert_eq!(crossed.len(), 2 * fronts, "{ray:?}");
        let touched =
            surface.iter().filter(|corners| meet(&ray, corners, Culling::None).is_some()).count();
        assert!(
            crossed.len() <= 2 && touched >= crossed.len(),
            "{} {touched} {ray:?}",
            crossed.len()
        );
        through_edges += u32::from(touched > crossed.len());
    }
    assert!(through_edges > 20, "{through_edges}");
}

#[test]
fn rays_in_a_plane_meet_nothing_there() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let ray = ExactRay::new(&Ray::new([-1.0, 0.25, 0.0], [1.0, 0.0, 0.0])).unwrap();
    assert!(meet(&ray, &corners, Culling::None).is_none());
    assert!(cross(&ray, &corners, Culling::None).is_none());
    let line = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [2.0, 2.0, 2.0]];
    let across = ExactRay::new(&Ray::new([1.0, 1.0, 0.0], [0.0, 0.0, 1.0])).unwrap();
    assert!(meet(&across, &line, Culling::None).is_none());
    assert!(cross(&across, &line, Culling::None).is_none());
}

/// x and y with `a x - b y = 1`, of numbers without a common factor.
fn bezout(a: i64, b: i64) -> (i64, i64) {
    let ((mut r, mut x), (mut next_r, mut next_x)) = ((a, 1i64), (b, 0i64));
    while next_r != 0 {
        let part = r / next_r;
        (r, next_r) = (next_r, r - part * next_r);
        (x, next_x) = (next_x, x - part * next_x);
    }
    (x, (a * x - 1) / b)
}

/// Rays that pass an edge by so little that its function is 1, where its terms are of the order of
/// 2^68: rounding alone would give any sign. No float is rounded on the way here.
#[test]
fn edges_missed_by_one_part_in_2_to_68() {
    let mut numbers = Numbers(11);
    let (mut tried, mut undecided) = (0, 0);
    while tried < 2_000 {
        let mut next = || i64::from(numbers.bits() >> 10);
        let [cx, cy, cz, bz, ax, ay, az] = [(); 7].map(|()| next() | 1);
        let gcd = |mut a: i64, mut b: i64| {
            while b != 0 {
                (a, b) = (b, a % b);
            }
            a
        };
        if gcd(cx, cy) != 1 {
            continue;
        }
        tried += 1;
        // The z of C x B is then 1 and the ray, in the plane of both, is moved along z by 1, 0 or -1.
        let (by, bx) = bezout(cx, cy);
        let by_z = tried % 3 - 1;
        let d = [bx + cx, by + cy, bz + cz + by_z];
        let point = |p: [i64; 3]| p.map(|x| x as f32);
        assert!(d.iter().all(|x| x.abs() < 1 << 24));
        let Some(ray) = ExactRay::new(&Ray::new([0.0; 3], point(d))) else { continue };
        let (a, b, c) = (point([ax, ay, az]), point([bx, by, bz]), point([cx, cy, cz]));
        for (edge, corners) in [(0, [a, b, c]), (1, [c, a, b]), (2, [b, c, a])] {
            // Counted from the corner across: the edge of B and C is the first one of A B C.
            let edges = Edges::new(&ray, &corners);
            assert_eq!(edges.exactly(edge).sign(), by_z.cmp(&0), "{ray:?} {corners:?}");
            assert_eq!(edges.sign(edge), by_z.cmp(&0), "{ray:?} {corners:?}");
            undecided += u32::from(edges.approximate[edge].sign().is_none());
        }
    }
    assert!(undecided > 5_000, "{undecided}");
}

/// The ray moved by what is less than anything, but for these triangles is a float: by (e, e^2) along the first and second of
/// the axes that a shear puts across it.
#[test]
fn crossings_are_those_of_a_ray_moved_a_little() {
    const LITTLE: f32 = 1.0 / 256.0;
    let (mut crossed, mut beside) = ([0; 2], 0);
    for round in 0..40_000 {
        let mut numbers = Numbers(round);
        let (origin, direction, corners) =
            (numbers.point(0), numbers.point(0), numbers.triangle(0));
        let Some(ray) = ExactRay::new(&Ray::new(origin, direction)) else { continue };
        let greatest = direction.iter().fold(0.0, |most: f32, x| most.max(x.abs()));
        let z = direction.iter().position(|x| x.abs() == greatest).expect("one of them");
        let mut across = [(z + 1) % 3, (z + 2) % 3];
        if direction[z] < 0.0 {
            across.reverse();
        }
        let mut moved = ray;
        moved.origin[across[0]] += LITTLE;
        moved.origin[across[1]] += LITTLE * LITTLE;
        for culling in [Culling::None, Culling::Back, Culling::Front] {
            let expected = meet(&moved, &corners, culling).map(|met| met.is_front());
            let found = cross(&ray, &corners, culling);
            assert_eq!(found.map(|met| met.is_front()), expected, "{ray:?} {corners:?}");
            crossed[usize::from(expected.is_some())] += 1;
            beside += u32::from(expected.is_some() != meet(&ray, &corners, culling).is_some());
        }
    }
    assert!(crossed.iter().all(|&count| count > 1_000) && beside > 500, "{crossed:?} {beside}");
}

/// Distances between whole numbers, as fractions. Equal ones are often those of other triangles.
#[test]
fn distances_compare_as_fractions() {
    let mut orders = [0; 3];
    for round in 0..2_000 {
        let mut numbers = Numbers(round);
        let Some(ray) = numbers.ray(0) else { continue };
        let whole = |p: [f32; 3]| p.map(|x| x as i64);
        let mut met = Vec::new();
        for _ in 0..40 {
            let corners = numbers.triangle(0);
            let Some(meeting) = meet(&ray, &corners, Culling::None) else { continue };
            let [a, b, c] = corners.map(whole);
            let minus = |p: [i64; 3], q: [i64; 3]| [0, 1, 2].map(|k| p[k] - q[k]);
            let dot = |p: [i64; 3], q: [i64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
            let (ab, ac) = (minus(b, a), minus(c, a));
            let normal = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| ab[i] * ac[j] - ab[j] * ac[i]);
            let numerator = dot(normal, minus(a, whole(ray.origin)));
            let denominator = dot(normal, whole(ray.direction));
            met.push((meeting, numerator * denominator.signum(), denominator.abs()));
        }
        for (one, n, d) in &met {
            for (other, m, e) in &met {
                let expected = (n * e).cmp(&(m * d));
                assert_eq!(one.compare_t(other), expected, "{n}/{d} {m}/{e}");
                orders[(expected as i8 + 1) as usize] += 1;
            }
            let limit = f32::from_bits(numbers.bits() % 3 + 1.0f32.to_bits()) * numbers.float(0);
            let expected = (*n as f64).total_cmp(&(f64::from(limit) * *d as f64));
            // The product is of 32 bits, and exact; zeros are equal.
            let expected =
                if *n as f64 == f64::from(limit) * *d as f64 { Ordering::Equal } else { expected };
            assert_eq!(one.compare_limit(limit), expected, "{n}/{d} {limit}");
        }
        for (one, ..) in &met {
            assert!(one.compare_limit(f32::INFINITY).is_lt());
            assert!(one.compare_limit(f32::NEG_INFINITY).is_gt());
        }
    }
    assert!(orders.iter().all(|&count| count > 1_000), "{orders:?}");
}

/// Planes perpendicular to an axis are in the order of whole numbers, for rays of all kinds.
#[test]
fn planes_perpendicular_to_an_axis_are_in_order() {
    let mut numbers = Numbers(11);
    let (mut seen, mut none) = ([0; 3], 0);
    for round in 0..100_000 {
        let Some(ray) = numbers.ray(round) else { continue };
        let mut both = [0, 1].map(|_| numbers.triangle(round / 4));
        let axis = (round / 16) as usize % 3;
        for (triangle, at) in both.iter_mut().zip([numbers.float(round), numbers.float(round)]) {
            // Every fourth time both are in one plane, and every eighth none is perpendicular.
            let at = if round % 4 == 3 { 0.5 } else { at };
            triangle.iter_mut().for_each(|corner| corner[axis] = at);
            triangle[0][axis] += f32::from(u8::from(round % 8 == 6));
        }
        let [one, other] = both.map(|corners| meet(&ray, &corners, Culling::None));
        let (Some(one), Some(other)) = (one, other) else { continue };
        match one.compare_planes(&other) {
            Some(order) => {
                assert_eq!(order, one.compare_t_by_integers(&other), "{ray:?} {both:?}");
                assert_eq!(order, one.compare_t(&other), "{ray:?} {both:?}");
                seen[(order as i8 + 1) as usize] += 1;
            }
            None => none += 1,
        }
    }
    assert!(seen.iter().all(|&count| count > 100) && none > 100, "{seen:?} {none}");
}
