//! Rays and triangles in whole numbers: what checks the oracle.
//!
//! No floats, no hierarchy, no bounds: every coordinate is a whole multiple of 2^-149, as every `f32`
//! is, each question is the sign of a polynomial in big integers, and every triangle is asked. The
//! formulas are not the oracle's either: a triangle is met where the ray crosses its plane at a
//! point on the inner side of its three edges, by Cramer's rule.
//!
//! [`surface_crossings`] counts a surface once where the ray runs through edges and vertices: it
//! really moves the ray, by a vector so small that no sign but that of a zero changes, and so that
//! no zero is left but where an edge is seen end on.

use crate::oracle::{Oracle, snap};
use num_bigint::{BigInt, Sign};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Culling, QueryOptions, Ray};
use std::cmp::Ordering;

/// A quotient of whole numbers, the lower one positive.
#[derive(Clone, Debug)]
pub struct Rational {
    above: BigInt,
    below: BigInt,
}

impl Rational {
    fn new(above: BigInt, below: BigInt) -> Rational {
        if below.sign() == Sign::Minus {
            return Rational { above: -above, below: -below };
        }
        Rational { above, below }
    }

    /// A finite float.
    pub fn from_float(x: f32) -> Rational {
        Rational { above: whole(x), below: BigInt::from(1) << 149 }
    }

    /// How it compares with a float, infinities included, NaN excluded.
    pub fn compare_float(&self, x: f32) -> Ordering {
        match x.is_infinite() {
            true if x > 0.0 => Ordering::Less,
            true => Ordering::Greater,
            false => self.cmp(&Rational::from_float(x)),
        }
    }

    /// The nearest float, ties to even; what is beyond the greatest is that one, and magnitudes
    /// below 2^-126 are 0.
    pub fn rounded(&self) -> f32 {
        // The greatest float not above, by halving an interval of ordered bit patterns.
        let float = |key: i64| {
            let bits = if key >= 0 { key as u32 } else { 0x8000_0000 | (-key) as u32 };
            f32::from_bits(bits)
        };
        let greatest = i64::from(f32::MAX.to_bits());
        let (mut low, mut high) = (-greatest, greatest);
        if self.compare_float(float(low)).is_le() {
            return -f32::MAX;
        }
        if self.compare_float(float(high)).is_ge() {
            return f32::MAX;
        }
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            if self.compare_float(float(middle)).is_ge() { low = middle } else { high = middle }
        }
        let [a, b] = [low, high].map(|key| Rational::from_float(float(key)));
        let middle = Rational::new(&a.above + &b.above, BigInt::from(2) * a.below);
        let nearest = match self.cmp(&middle) {
            Ordering::Less => low,
            Ordering::Greater => high,
            Ordering::Equal => {
                if low % 2 == 0 {
                    low
                } else {
                    high
                }
            }
        };
        snap(float(nearest))
    }
}

impl Rational {
    /// The number as an `f64`, within a part in 2^52 of it, times a power of two: for numbers that are not negative.
    pub fn scaled_to_f64(&self, exponent: i32) -> f64 {
        // A quotient of 60 to 62 bits.
        let shift = 61 + self.below.bits() as i64 - self.above.bits() as i64;
        let part = match shift >= 0 {
            true => (&self.above << shift as u64) / &self.below,
            false => &self.above / (&self.below << -shift as u64),
        };
        let digits = part.to_u64_digits().1;
        let whole = digits.first().map_or(0.0, |&digit| digit as f64);
        // In two steps, since one power might be out of range.
        let power = exponent as i64 - shift;
        whole * 2f64.powi((power / 2) as i32) * 2f64.powi((power - power / 2) as i32)
    }
}

impl PartialEq for Rational {
    fn eq(&self, other: &Rational) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Rational {}

impl PartialOrd for Rational {
    fn partial_cmp(&self, other: &Rational) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Rational {
    fn cmp(&self, other: &Rational) -> Ordering {
        (&self.above * &other.below).cmp(&(&other.above * &self.below))
    }
}

/// A float as a multiple of 2^-149.
fn whole(x: f32) -> BigInt {
    let bits = x.to_bits();
    let (exponent, fraction) = (bits >> 23 & 0xff, bits & 0x7f_ffff);
    assert!(exponent < 0xff, "{x} is not finite");
    let magnitude = match exponent {
        0 => BigInt::from(fraction),
        _ => BigInt::from(fraction | 0x80_0000) << (exponent - 1),
    };
    if x < 0.0 { -magnitude } else { magnitude }
}

type Vector = [BigInt; 3];

fn vector(p: [f32; 3]) -> Vector {
    p.map(|x| whole(snap(x)))
}

fn minus(a: &Vector, b: &Vector) -> Vector {
    [0, 1, 2].map(|i| &a[i] - &b[i])
}

fn cross(a: &Vector, b: &Vector) -> Vector {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| &a[i] * &b[j] - &a[j] * &b[i])
}

fn dot(a: &Vector, b: &Vector) -> BigInt {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

/// The square of the distance from a point to a triangle, exactly: to its plane above the inside, else to the nearest edge.
pub fn distance_squared(corners: &[[f32; 3]; 3], point: [f32; 3]) -> f64 {
    // Of multiples of 2^-149, squared.
    squared_distance(corners, point).scaled_to_f64(-298)
}

/// [`distance_squared`], in squares of 2^-149.
pub fn squared_distance(corners: &[[f32; 3]; 3], point: [f32; 3]) -> Rational {
    least_squared(&corners.map(vector), &vector(point))
}

/// The same of a triangle under a transform, in squares of 2^-298. The transform's numbers count as they are.
pub fn squared_distance_in_world(
    transform: &[[f32; 4]; 3],
    corners: &[[f32; 3]; 3],
    point: [f32; 3],
) -> Rational {
    let corners = corners.map(|corner| {
        let corner = vector(corner);
        transform.map(|[x, y, z, moved]| {
            let turned = dot(&[x, y, z].map(whole), &corner);
            turned + (whole(moved) << 149)
        })
    });
    least_squared(&corners, &vector(point).map(|x| x << 149))
}

/// The square of a float, in squares of 2^-149; of 2^-298 in the world.
pub fn square(x: f32, in_world: bool) -> Rational {
    let x = whole(x) << if in_world { 149 } else { 0 };
    Rational::new(&x * &x, BigInt::from(1))
}

fn least_squared([a, b, c]: &[Vector; 3], point: &Vector) -> Rational {
    let mut least: Option<Rational> = None;
    let mut consider = |found: Rational| {
        if least.as_ref().is_none_or(|least| found < *least) {
            least = Some(found);
        }
    };
    let edges = [(a, b), (b, c), (c, a)];
    for (from, to) in edges {
        let (way, edge) = (minus(point, from), minus(to, from));
        let (along, length) = (dot(&way, &edge), dot(&edge, &edge));
        consider(Rational::new(dot(&way, &way), BigInt::from(1)));
        if along.sign() == Sign::Plus && along < length {
            let above = dot(&way, &way) * &length - &along * &along;
            consider(Rational::new(above, length));
        }
    }
    let normal = cross(&minus(b, a), &minus(c, a));
    let squared = dot(&normal, &normal);
    let inside = edges.iter().all(|(from, to)| {
        let turn = cross(&minus(to, from), &minus(point, from));
        dot(&normal, &turn).sign() != Sign::Minus
    });
    if squared.sign() == Sign::Plus && inside {
        let height = dot(&normal, &minus(point, a));
        consider(Rational::new(&height * &height, squared));
    }
    least.expect("an edge")
}

/// A ray in whole numbers.
#[derive(Clone, Debug)]
struct Line {
    origin: Vector,
    direction: Vector,
}

impl Line {
    /// `None` for rays that hit nothing by definition.
    fn new(ray: &Ray) -> Option<Line> {
        let finite = ray.origin.iter().chain(&ray.direction).all(|x| x.is_finite());
        if !finite || ray.t_min.is_nan() || ray.t_max.is_nan() {
            return None;
        }
        let line = Line { origin: vector(ray.origin), direction: vector(ray.direction) };
        line.direction.iter().any(|x| x.sign() != Sign::NoSign).then_some(line)
    }
}

fn corners_of(mesh: &Mesh<'_>, triangle: usize) -> Option<[Vector; 3]> {
    let corners = mesh.triangle(triangle);
    let finite = corners.as_flattened().iter().all(|x| x.is_finite());
    finite.then(|| corners.map(vector))
}

/// A triangle that the line through a ray meets.
#[derive(Clone, Debug)]
pub struct Met {
    /// Which one.
    pub triangle: u32,
    /// The distance.
    pub t: Rational,
    /// Whether the ray comes from the side where the corners run counter-clockwise.
    pub front: bool,
    /// Whether the point lies on an edge or a corner.
    pub on_edge: bool,
}

/// Where the line meets the plane of a triangle and how that point lies to the three edges: a sign
/// each, positive within.
fn against_edges(line: &Line, corners: &[Vector; 3]) -> Option<(Rational, bool, [Sign; 3])> {
    let [a, b, c] = corners;
    let normal = cross(&minus(b, a), &minus(c, a));
    let speed = dot(&normal, &line.direction);
    if speed.sign() == Sign::NoSign {
        return None;
    }
    let t = Rational::new(dot(&normal, &minus(a, &line.origin)), speed.clone());
    // The point is (below * origin + above * direction) / below; below is positive.
    let point = [0, 1, 2].map(|i| &t.below * &line.origin[i] + &t.above * &line.direction[i]);
    let signs = [(a, b), (b, c), (c, a)].map(|(p, q)| {
        let from = [0, 1, 2].map(|i| &point[i] - &t.below * &p[i]);
        dot(&normal, &cross(&minus(q, p), &from)).sign()
    });
    // From the front the ray goes against the normal.
    Some((t, speed.sign() == Sign::Minus, signs))
}

fn is_culled(front: bool, options: &QueryOptions<'_>) -> bool {
    match options.culling {
        Culling::None => false,
        Culling::Back => !front,
        Culling::Front => front,
    }
}

/// Every triangle that the line through a ray meets, its limits set aside, by distance, then index.
pub fn crossings(mesh: &Mesh<'_>, ray: &Ray, options: &QueryOptions<'_>) -> Vec<Met> {
    let mut found = Vec::new();
    let Some(line) = Line::new(ray) else { return found };
    for index in 0..mesh.len() {
        let triangle = index as u32;
        let Some(corners) = corners_of(mesh, index) else { continue };
        let Some((t, front, signs)) = against_edges(&line, &corners) else { continue };
        let met = !signs.contains(&Sign::Minus);
        if met && options.ignore != Some(triangle) && !is_culled(front, options) {
            found.push(Met { triangle, t, front, on_edge: signs.contains(&Sign::NoSign) });
        }
    }
    found.sort_by(|a, b| a.t.cmp(&b.t).then(a.triangle.cmp(&b.triangle)));
    found
}

/// Whether a distance lies between the limits of a ray, both included.
pub fn is_within(t: &Rational, ray: &Ray) -> bool {
    t.compare_float(ray.t_min).is_ge() && t.compare_float(ray.t_max).is_le()
}

/// How a ray is moved off edges and vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shift {
    /// The ray moves by 2^-`exponent` along one axis and by the square of that along another.
    pub exponent: u32,
    /// The other way round: first axis and second axis change places.
    pub swapped: bool,
}

impl Shift {
    /// What suffices: an edge function that is not zero is at least 2^-447, and moving the ray by a
    /// unit changes it by less than 2^259; each of the two changes, if it is not zero, is at least
    /// 2^-298 times the shift. So 2^-720, and 2^-1440, change no sign, the first outweighs the second,
    /// and any smaller shift gives the same signs.
    pub const TINY: Shift = Shift { exponent: 720, swapped: false };
    /// A smaller one.
    pub const TINIER: Shift = Shift { exponent: 900, swapped: false };
    /// Along the axes in the other order.
    pub const OTHER: Shift = Shift { exponent: 720, swapped: true };

    /// The moved ray and the corners, in units of 2^-149 times 2^-(2 exponent). The axes are the
    /// two along which the direction is not longest, in cyclic order, exchanged for a negative one.
    fn apply(self, line: &Line) -> Line {
        let mut z = 0;
        for axis in 1..3 {
            if line.direction[axis].magnitude() > line.direction[z].magnitude() {
                z = axis;
            }
        }
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if (line.direction[z].sign() == Sign::Minus) != self.swapped {
            (x, y) = (y, x);
        }
        let mut origin = line.origin.clone().map(|v| v << (2 * self.exponent));
        // 2^-exponent is 2^149 units of 2^-149, and so on.
        origin[x] += BigInt::from(1) << (149 + self.exponent);
        origin[y] += BigInt::from(1) << 149;
        Line { origin, direction: line.direction.clone() }
    }

    fn scaled(self, corners: &[Vector; 3]) -> [Vector; 3] {
        corners.clone().map(|p| p.map(|v| v << (2 * self.exponent)))
    }
}

/// Whether the moved line crosses the triangle. It has to be strictly inside.
fn crosses_moved(moved: &Line, corners: &[Vector; 3]) -> bool {
    // Triple products: this is asked of few triangles, but of long numbers.
    let [a, b, c] = corners.each_ref().map(|p| minus(p, &moved.origin));
    let signs =
        [(&a, &b), (&b, &c), (&c, &a)].map(|(p, q)| dot(&moved.direction, &cross(p, q)).sign());
    signs[0] != Sign::NoSign && signs[0] == signs[1] && signs[1] == signs[2]
}

/// The crossings of surfaces: those of the ray moved by almost nothing, at the distances of the ray
/// as it is; by distance, then index. Limits are set aside.
pub fn surface_crossings(
    mesh: &Mesh<'_>,
    ray: &Ray,
    options: &QueryOptions<'_>,
    shift: Shift,
) -> Vec<Met> {
    let mut met = crossings(mesh, ray, options);
    let Some(line) = Line::new(ray) else { return met };
    let moved = shift.apply(&line);
    // What the line as it is stays clear of, it stays clear of when moved.
    met.retain(|met| {
        corners_of(mesh, met.triangle as usize)
            .is_some_and(|corners| crosses_moved(&moved, &shift.scaled(&corners)))
    });
    met
}

/// The same by the oracle's hierarchy: for meshes too large to ask every triangle in whole numbers.
/// Gives triangle and side of each crossing, with its distance rounded as accuracy `exact` rounds.
pub fn surface_crossings_by(
    oracle: &Oracle,
    mesh: &Mesh<'_>,
    ray: &Ray,
    options: &QueryOptions<'_>,
) -> Vec<(f32, u32, bool)> {
    let Some(line) = Line::new(ray) else { return Vec::new() };
    let moved = Shift::TINY.apply(&line);
    let met = oracle.crossings(ray, options);
    let crossed = met.iter().filter(|met| met.is_within(ray)).filter(|met| {
        !met.on_edge
            || corners_of(mesh, met.triangle as usize)
                .is_some_and(|corners| crosses_moved(&moved, &Shift::TINY.scaled(&corners)))
    });
    let mut found: Vec<(&crate::oracle::Crossing, u32)> = crossed
        .flat_map(|met| oracle.alike(met).iter().map(move |&triangle| (met, triangle)))
        .filter(|&(_, triangle)| options.ignore != Some(triangle))
        .collect();
    found.sort_by(|(a, i), (b, j)| a.compare_t(b).then(i.cmp(j)));
    found.into_iter().map(|(met, triangle)| (met.rounded_t(), triangle, met.front)).collect()
}

/// How often a closed mesh winds around a point that is not on it: 1 within one surface whose corners
/// run counter-clockwise seen from outside, 0 outside.
pub fn winding(mesh: &Mesh<'_>, point: [f32; 3]) -> i32 {
    // Any direction will do, since the ray is moved off edges.
    let ray = Ray::new(point, [1.0, 0.0, 0.0]);
    surface_crossings(mesh, &ray, &QueryOptions::default(), Shift::TINY)
        .iter()
        .filter(|met| met.t.compare_float(0.0).is_gt())
        .map(|met| if met.front { -1 } else { 1 })
        .sum()
}

/// The first triangle that holds a point, triangles without area included.
pub fn on_surface(mesh: &Mesh<'_>, point: [f32; 3]) -> Option<u32> {
    let point = vector(point);
    let holds = |index: &usize| {
        let Some([a, b, c]) = corners_of(mesh, *index) else { return false };
        let normal = cross(&minus(&b, &a), &minus(&c, &a));
        let edges = [(&a, &b), (&b, &c), (&c, &a)];
        if normal.iter().all(|x| x.sign() == Sign::NoSign) {
            // On the line of the longest edge, and within the bounds of all corners.
            let within = (0..3).all(|i| {
                let least = (&a[i]).min(&b[i]).min(&c[i]);
                let most = (&a[i]).max(&b[i]).max(&c[i]);
                *least <= point[i] && point[i] <= *most
            });
            return within
                && edges.iter().all(|(p, q)| {
                    let turn = cross(&minus(q, p), &minus(&point, p));
                    turn.iter().all(|x| x.sign() == Sign::NoSign)
                });
        }
        dot(&normal, &minus(&point, &a)).sign() == Sign::NoSign
            && edges.iter().all(|(p, q)| {
                let turn = cross(&minus(q, p), &minus(&point, p));
                dot(&normal, &turn).sign() != Sign::Minus
            })
    };
    (0..mesh.len()).find(holds).map(|index| index as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aim::{self, Aim, Kind};
    use crate::oracle::OracleHit;
    use crate::random::Random;
    use crate::scenes::{self, Scene};

    #[test]
    fn rounding_is_to_nearest_and_even() {
        let quotient = |a: i64, b: i64| Rational::new(BigInt::from(a), BigInt::from(b));
        assert_eq!(quotient(1, 3).rounded(), 1.0 / 3.0);
        assert_eq!(quotient(-2, -3).rounded(), 2.0 / 3.0);
        assert_eq!(quotient(-(1 << 24) - 1, 1).rounded(), -16_777_216.0);
        assert_eq!(quotient((1 << 24) + 3, 1).rounded(), 16_777_220.0);
        assert_eq!(quotient(0, 5).rounded().to_bits(), 0);
        let mut random = Random::new(1);
        for _ in 0..2_000 {
            let x = f32::from_bits(random.bits());
            if x.is_finite() {
                assert_eq!(Rational::from_float(x).rounded(), snap(x));
                let next = Rational::from_float(x.next_up().min(f32::MAX));
                assert!(next >= Rational::from_float(x));
            }
        }
        let beyond = Rational::new(BigInt::from(1) << 200, BigInt::from(1));
        assert_eq!(beyond.rounded(), f32::MAX);
    }

    /// Floats of all sizes in one scene, many equal to one another, some with simple sums.
    fn mixed_float(random: &mut Random) -> f32 {
        let few = [
            0.0,
            -0.0,
            1.0,
            -1.0,
            0.5,
            2.0,
            3.0,
            1e-38,
            -1e-38,
            1e-30,
            1e30,
            1e38,
            -1e38,
            3.4e38,
            1e-40,
            9.5e-7,
            16_777_216.0,
            1.000_000_1,
        ];
        match random.below(4) {
            0 | 1 => random.pick(&few),
            2 => (random.below(9) as f32 - 4.0) * 0.25,
            _ => {
                let power = random.between(-38.0, 38.0);
                (random.between(-1.0, 1.0) * 10f64.powf(power)) as f32
            }
        }
    }

    fn mixed_point(random: &mut Random) -> [f32; 3] {
        [(); 3].map(|()| mixed_float(random))
    }

    /// Tetrahedra and lone triangles over few points, so that much is shared, coplanar or flat.
    fn mixed_scene(random: &mut Random) -> Scene {
        let points: Vec<[f32; 3]> = (0..7).map(|_| mixed_point(random)).collect();
        let mut soup: Vec<[[f32; 3]; 3]> = Vec::new();
        for _ in 0..3 {
            let [a, b, c, d] = [(); 4].map(|()| random.pick(&points));
            soup.extend([[a, b, c], [a, c, d], [a, d, b], [b, d, c]]);
        }
        for _ in 0..4 {
            soup.push([(); 3].map(|()| random.pick(&points)));
        }
        let twice = soup[random.below(soup.len())];
        soup.push(twice);
        Scene { name: "mixed".into(), positions: soup.as_flattened().to_vec(), indices: None }
    }

    /// Through one corner from another, from anywhere, to the middle of an edge, or any way at all.
    fn mixed_ray(random: &mut Random, scene: &Scene) -> Ray {
        let point = |random: &mut Random| random.pick(&scene.positions);
        let (a, b) = (point(random), point(random));
        let from = if random.below(2) == 0 { point(random) } else { mixed_point(random) };
        let target = match random.below(3) {
            0 => a.map(f64::from),
            1 => [0, 1, 2].map(|i| (f64::from(a[i]) + f64::from(b[i])) / 2.0),
            _ => [0, 1, 2].map(|i| 0.3 * f64::from(a[i]) + 0.7 * f64::from(b[i])),
        };
        let ray = match random.below(4) {
            0 => Ray::new(from, mixed_point(random)),
            _ => aim::aimed(from, target),
        };
        let whole = ray.with_limits(f32::NEG_INFINITY, f32::INFINITY);
        if random.below(3) == 0 { ray } else { whole }
    }

    /// Everything the oracle says of a ray, against whole numbers. Gives how many triangles it meets.
    fn compare(scene: &Scene, oracle: &Oracle, ray: &Ray, options: &QueryOptions<'_>) -> usize {
        let mesh = scene.mesh();
        let expected = crossings(&mesh, ray, options);
        let given = oracle.crossings(ray, options);
        let mut all: Vec<(u32, bool, bool, f32)> = given
            .iter()
            .flat_map(|met| oracle.alike(met).iter().map(move |&triangle| (met, triangle)))
            .filter(|&(_, triangle)| options.ignore != Some(triangle))
            .map(|(met, triangle)| (triangle, met.front, met.on_edge, met.rounded_t()))
            .collect();
        // The order of distances, by the list; equal ones by index.
        for pair in given.windows(2) {
            assert!(pair[0].compare_t(&pair[1]).is_le(), "{} {ray:?}", scene.name);
        }
        let mut listed: Vec<(u32, bool, bool, f32)> = expected
            .iter()
            .map(|met| (met.triangle, met.front, met.on_edge, met.t.rounded()))
            .collect();
        all.sort_by_key(|met| met.0);
        listed.sort_by_key(|met| met.0);
        assert_eq!(all, listed, "{} {ray:?}", scene.name);
        let within = |met: &&Met| is_within(&met.t, ray);
        let answer = match expected.iter().find(within) {
            None => None,
            Some(best) => {
                let tied: Vec<u32> =
                    expected.iter().filter(|met| met.t == best.t).map(|met| met.triangle).collect();
                Some((best.t.rounded(), tied))
            }
        };
        let nearest = oracle.nearest(ray, options).map(|n| (n.t, n.triangle));
        assert_eq!(nearest, answer.as_ref().map(|(t, tied)| (*t, tied[0])), "{ray:?}");
        match (oracle.closest_with(ray, options), answer) {
            (OracleHit::Miss, None) => {}
            (OracleHit::Hit { triangles, .. }, Some((_, tied))) => assert_eq!(triangles, tied),
            (oracles, ours) => panic!("{} {ray:?}: {oracles:?}, not {ours:?}", scene.name),
        }
        expected.len()
    }

    /// The options that a test goes through in turn.
    fn options(round: usize) -> QueryOptions<'static> {
        let culling = [Culling::None, Culling::None, Culling::Back, Culling::Front][round % 4];
        let ignore = (round.is_multiple_of(5)).then_some(round as u32 % 17);
        QueryOptions { culling, ignore, ..QueryOptions::default() }
    }

    #[test]
    fn the_oracle_equals_whole_numbers_on_mixed_magnitudes() {
        let mut random = Random::new(2);
        let (mut met, mut limited) = (0, 0);
        for round in 0..400 {
            let scene = mixed_scene(&mut random);
            let mesh = scene.mesh();
            let oracle = Oracle::new(&mesh);
            for number in 0..12 {
                let ray = mixed_ray(&mut random, &scene);
                let options = options(round + number);
                met += compare(&scene, &oracle, &ray, &options);
                // The limits at the rounded distance, and one float to either side of it.
                if let Some(nearest) = oracle.nearest(&ray, &options) {
                    let t = nearest.t;
                    for (low, high) in [
                        (t, t),
                        (t.next_up(), f32::INFINITY),
                        (f32::NEG_INFINITY, t.next_down()),
                        (t.next_down(), t),
                    ] {
                        compare(&scene, &oracle, &ray.with_limits(low, high), &options);
                        limited += 1;
                    }
                }
            }
        }
        assert!(met > 8_000 && limited > 4_000, "{met} {limited}");
    }

    #[test]
    fn the_oracle_equals_whole_numbers_on_awkward_scenes() {
        let mut met = 0;
        let shrunk = |scene: Scene, factor: f32| scenes::scaled(&scene, factor, "scaled");
        for scene in [
            scenes::soup(60, 0.4, 3),
            scenes::seams(true),
            scenes::seams(false),
            scenes::sphere(5, [1e7, -1e7, 1e7], 1000.0),
            scenes::sphere(5, [0.0; 3], 1.0),
            scenes::coplanar_oblique(60),
            scenes::collinear(),
            scenes::zeros_and_subnormals(),
            scenes::grid_boxes(2),
            scenes::stairs(8),
            shrunk(scenes::soup(60, 0.3, 4), 3e-38),
            shrunk(scenes::soup(60, 0.3, 5), 2e38),
        ] {
            let mesh = scene.mesh();
            let oracle = Oracle::new(&mesh);
            for kind in Kind::ALL {
                for (number, ray) in aim::rays(&mesh, kind, 8, 5).iter().enumerate() {
                    met += compare(&scene, &oracle, ray, &options(number));
                }
            }
        }
        assert!(met > 1_500, "{met}");
    }

    /// Distances exactly in the middle between two floats, on planes for which `f64` errs to either
    /// side of it.
    #[test]
    fn distances_between_two_floats() {
        let mut random = Random::new(9);
        let mut met = 0;
        for _ in 0..2_000 {
            let coarse =
                |random: &mut Random| (random.below(1 << 22) as f32 - 2_097_152.0) / 65_536.0;
            // A point with half a unit, on the edge between two corners about it.
            let way = [(); 3].map(|()| coarse(&mut random));
            let point = [0.5, coarse(&mut random), coarse(&mut random)];
            let a = [0, 1, 2].map(|i| point[i] + way[i]);
            let b = [0, 1, 2].map(|i| point[i] - way[i]);
            let c = [(); 3].map(|()| coarse(&mut random));
            let exact =
                (0..3).all(|i| f64::from(a[i]) + f64::from(b[i]) == 2.0 * f64::from(point[i]));
            let steps = 8_388_608.0 + random.below(8_000_000) as f32;
            let ray = Ray::new([-steps, point[1], point[2]], [1.0, 0.0, 0.0]);
            let scene = Scene { name: "between".into(), positions: vec![a, b, c], indices: None };
            let mesh = scene.mesh();
            let oracle = Oracle::new(&mesh);
            compare(&scene, &oracle, &ray, &QueryOptions::default());
            if let Some(nearest) = oracle.nearest(&ray, &QueryOptions::default())
                && exact
            {
                let even = if steps % 2.0 == 0.0 { steps } else { steps + 1.0 };
                assert_eq!(nearest.t, even, "{ray:?}");
                met += 1;
            }
        }
        assert!(met > 1_000, "{met}");
    }

    /// Of a closed mesh a line crosses as many fronts as backs, however it is moved, and how far makes
    /// no difference.
    #[test]
    fn surfaces_are_crossed_once() {
        let mut random = Random::new(6);
        let mut scenes: Vec<Scene> = (0..150)
            .map(|_| {
                let points: Vec<[f32; 3]> = (0..6).map(|_| mixed_point(&mut random)).collect();
                let mut soup = Vec::new();
                for _ in 0..3 {
                    let [a, b, c, d] = [(); 4].map(|()| random.pick(&points));
                    soup.extend([[a, b, c], [a, c, d], [a, d, b], [b, d, c]]);
                }
                let positions = soup.as_flattened().to_vec();
                Scene { name: "tetrahedra".into(), positions, indices: None }
            })
            .collect();
        scenes.extend([scenes::seams(true), scenes::seams(false), scenes::grid_boxes(2)]);
        scenes.extend([scenes::sphere(4, [0.25; 3], 1.0)]);
        let (mut crossed, mut touched) = (0, 0);
        let options = QueryOptions::default();
        for scene in &scenes {
            let mesh = scene.mesh();
            let oracle = Oracle::new(&mesh);
            for _ in 0..if scene.name == "tetrahedra" { 8 } else { 40 } {
                let ray = mixed_ray(&mut random, scene);
                let ray = ray.with_limits(f32::NEG_INFINITY, f32::INFINITY);
                let tiny = surface_crossings(&mesh, &ray, &options, Shift::TINY);
                let names = |met: &[Met]| met.iter().map(|m| m.triangle).collect::<Vec<_>>();
                let tinier = surface_crossings(&mesh, &ray, &options, Shift::TINIER);
                assert_eq!(names(&tiny), names(&tinier), "{} {ray:?}", scene.name);
                for met in [&tiny, &surface_crossings(&mesh, &ray, &options, Shift::OTHER)] {
                    let fronts = met.iter().filter(|met| met.front).count();
                    // The seams are closed, but not turned one way.
                    let even = match scene.name.starts_with("seams") {
                        true => met.len() % 2 == 0,
                        false => met.len() == 2 * fronts,
                    };
                    assert!(even, "{} {ray:?}: {met:?}", scene.name);
                }
                let by_oracle: Vec<u32> = surface_crossings_by(&oracle, &mesh, &ray, &options)
                    .iter()
                    .map(|met| met.1)
                    .collect();
                assert_eq!(by_oracle, names(&tiny), "{} {ray:?}", scene.name);
                crossed += tiny.len();
                touched += crossings(&mesh, &ray, &options).len() - tiny.len();
            }
        }
        assert!(crossed > 1_500 && touched > 1_500, "{crossed} {touched}");
    }

    #[test]
    fn winding_numbers() {
        let boxes = scenes::grid_boxes(2);
        let mesh = boxes.mesh();
        for (point, expected) in
            [([0.5; 3], 1), ([1.5, 0.25, 0.75], 1), ([2.5, 0.5, 0.5], 0), ([-1.0; 3], 0)]
        {
            assert_eq!(on_surface(&mesh, point), None);
            assert_eq!(winding(&mesh, point), expected, "{point:?}");
        }
        assert!(on_surface(&mesh, [1.0, 0.5, 0.25]).is_some());
        assert!(on_surface(&mesh, [2.0; 3]).is_some());
        let nested = scenes::sphere(4, [0.0; 3], 1.0).joined(&scenes::sphere(6, [0.0; 3], 2.0), "");
        let mesh = nested.mesh();
        for (point, expected) in [([0.0; 3], 2), ([0.0, 1.5, 0.0], 1), ([0.0, 2.5, 0.0], 0)] {
            assert_eq!(winding(&mesh, point), expected, "{point:?}");
        }
        assert!(on_surface(&mesh, nested.positions[4]).is_some());
        let line = Scene {
            name: "line".into(),
            positions: vec![[0.0; 3], [1.0; 3], [2.0; 3]],
            indices: None,
        };
        assert_eq!(on_surface(&line.mesh(), [1.5; 3]), Some(0));
        assert_eq!(on_surface(&line.mesh(), [1.5, 1.5, 1.25]), None);
        assert_eq!(on_surface(&line.mesh(), [2.5; 3]), None);
        // A reversed surface winds the other way.
        let mut random = Random::new(7);
        let sphere = scenes::sphere(4, [0.5; 3], 1.0);
        let mut reversed = sphere.clone();
        for corners in reversed.indices.iter_mut().flatten() {
            corners.swap(0, 1);
        }
        for _ in 0..40 {
            let point = [(); 3].map(|()| random.between(-1.0, 2.0) as f32);
            let around = winding(&sphere.mesh(), point);
            assert!((0..=1).contains(&around));
            assert_eq!(winding(&reversed.mesh(), point), -around);
        }
        let mut aim = Aim::new(&sphere.mesh(), 8);
        let corner = aim.corner();
        assert!(on_surface(&sphere.mesh(), corner).is_some());
    }
}
