//! What triangles meet, in fractions of whole numbers: no hierarchy, no bounds, no floats.
//!
//! Formulas are not the core's: convex sets are cut out of a triangle half-space by half-space (Sutherland and Hodgman 1974), and distances are
//! computed, by the regions of a triangle (Ericson 2005), as fractions. Coordinates are snapped first.

use crate::oracle::snap;
use num_bigint::{BigInt, Sign};
use splitplane_core::query::overlap::Volume;
use std::cmp::Ordering;

/// A fraction whose lower number is positive.
#[derive(Clone, Debug)]
struct Fraction {
    above: BigInt,
    below: BigInt,
}

type Point = [Fraction; 3];

impl Fraction {
    /// A float, in units of 2^-149.
    fn of(x: f32) -> Fraction {
        let x = snap(x);
        let bits = x.to_bits();
        let (exponent, fraction) = ((bits >> 23 & 0xff) as usize, bits & 0x7f_ffff);
        let whole = match exponent {
            0 => BigInt::from(fraction),
            _ => BigInt::from(fraction | 1 << 23) << (exponent - 1),
        };
        let whole = if x < 0.0 { -whole } else { whole };
        Fraction { above: whole, below: BigInt::from(1) }
    }

    fn plus(&self, other: &Fraction) -> Fraction {
        if self.below == other.below {
            return Fraction { above: &self.above + &other.above, below: self.below.clone() };
        }
        Fraction {
            above: &self.above * &other.below + &other.above * &self.below,
            below: &self.below * &other.below,
        }
    }

    fn minus(&self, other: &Fraction) -> Fraction {
        self.plus(&Fraction { above: -&other.above, below: other.below.clone() })
    }

    fn times(&self, other: &Fraction) -> Fraction {
        Fraction { above: &self.above * &other.above, below: &self.below * &other.below }
    }

    /// By one that is not 0.
    fn over(&self, other: &Fraction) -> Fraction {
        let (above, below) = (&self.above * &other.below, &self.below * &other.above);
        match below.sign() {
            Sign::Minus => Fraction { above: -above, below: -below },
            _ => Fraction { above, below },
        }
    }

    fn sign(&self) -> Ordering {
        match self.above.sign() {
            Sign::Minus => Ordering::Less,
            Sign::NoSign => Ordering::Equal,
            Sign::Plus => Ordering::Greater,
        }
    }

    fn compare(&self, other: &Fraction) -> Ordering {
        self.minus(other).sign()
    }

    fn zero() -> Fraction {
        Fraction { above: BigInt::from(0), below: BigInt::from(1) }
    }
}

fn point(p: [f32; 3]) -> Point {
    p.map(Fraction::of)
}

fn minus(a: &Point, b: &Point) -> Point {
    std::array::from_fn(|i| a[i].minus(&b[i]))
}

fn dot(a: &Point, b: &Point) -> Fraction {
    a[0].times(&b[0]).plus(&a[1].times(&b[1])).plus(&a[2].times(&b[2]))
}

/// `a + t d`.
fn along(a: &Point, d: &Point, t: &Fraction) -> Point {
    std::array::from_fn(|i| a[i].plus(&d[i].times(t)))
}

fn cross(a: &Point, b: &Point) -> Point {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| a[i].times(&b[j]).minus(&a[j].times(&b[i])))
}

fn squared_distance(a: &Point, b: &Point) -> Fraction {
    let between = minus(a, b);
    dot(&between, &between)
}

/// What is left of a convex polygon where `normal . x <= offset`.
fn clipped(polygon: &[Point], normal: &Point, offset: &Fraction) -> Vec<Point> {
    let beyond: Vec<Fraction> = polygon.iter().map(|p| dot(normal, p).minus(offset)).collect();
    let mut left = Vec::new();
    for i in 0..polygon.len() {
        let j = (i + 1) % polygon.len();
        let (a, b) = (beyond[i].sign(), beyond[j].sign());
        if a.is_le() {
            left.push(polygon[i].clone());
        }
        if a != b && a.is_ne() && b.is_ne() {
            let t = beyond[i].over(&beyond[i].minus(&beyond[j]));
            left.push(along(&polygon[i], &minus(&polygon[j], &polygon[i]), &t));
        }
    }
    left
}

/// The squared distance of a point to a segment.
fn to_segment(p: &Point, a: &Point, b: &Point) -> Fraction {
    let d = minus(b, a);
    let length = dot(&d, &d);
    let part = dot(&d, &minus(p, a));
    if part.sign().is_le() {
        return squared_distance(p, a);
    }
    if part.compare(&length).is_ge() {
        return squared_distance(p, b);
    }
    squared_distance(p, &along(a, &d, &part.over(&length)))
}

fn least(distances: impl IntoIterator<Item = Fraction>) -> Fraction {
    let mut all = distances.into_iter();
    let first = all.next().expect("a distance");
    all.fold(first, |least, own| if own.compare(&least).is_lt() { own } else { least })
}

/// The squared distance of a point to a triangle.
fn to_triangle(p: &Point, triangle: &[Point; 3]) -> Fraction {
    let [a, b, c] = triangle;
    let normal = cross(&minus(b, a), &minus(c, a));
    let length = dot(&normal, &normal);
    if length.sign().is_gt() {
        let height = dot(&normal, &minus(p, a)).over(&length);
        let back = Fraction::zero().minus(&height);
        let foot = along(p, &normal, &back);
        let inner = |from: &Point, to: &Point| {
            dot(&normal, &cross(&minus(to, from), &minus(&foot, from))).sign().is_ge()
        };
        if inner(a, b) && inner(b, c) && inner(c, a) {
            return squared_distance(p, &foot);
        }
    }
    least([to_segment(p, a, b), to_segment(p, b, c), to_segment(p, c, a)])
}

/// The squared distance of two segments.
fn between_segments(p: &Point, q: &Point, r: &Point, s: &Point) -> Fraction {
    let ends = [to_segment(p, r, s), to_segment(q, r, s), to_segment(r, p, q), to_segment(s, p, q)];
    let mut nearest = least(ends);
    let (d, e) = (minus(q, p), minus(s, r));
    let across = cross(&d, &e);
    let length = dot(&across, &across);
    if length.sign().is_gt() {
        // The feet of the common perpendicular, by Cramer's rule.
        let w = minus(r, p);
        let t = dot(&cross(&w, &e), &across).over(&length);
        let u = dot(&cross(&w, &d), &across).over(&length);
        let one = Fraction { above: BigInt::from(1), below: BigInt::from(1) };
        let within = |x: &Fraction| x.sign().is_ge() && x.compare(&one).is_le();
        if within(&t) && within(&u) {
            let own = squared_distance(&along(p, &d, &t), &along(r, &e, &u));
            nearest = least([nearest, own]);
        }
    }
    nearest
}

/// The squared distance of a segment to a triangle.
fn from_segment(p: &Point, q: &Point, triangle: &[Point; 3]) -> Fraction {
    let [a, b, c] = triangle;
    let normal = cross(&minus(b, a), &minus(c, a));
    let (above, below) = (dot(&normal, &minus(p, a)), dot(&normal, &minus(q, a)));
    let mut all = vec![to_triangle(p, triangle), to_triangle(q, triangle)];
    for [from, to] in [[a, b], [b, c], [c, a]] {
        all.push(between_segments(p, q, from, to));
    }
    if above.compare(&below).is_ne() {
        let t = above.over(&above.minus(&below));
        let one = Fraction { above: BigInt::from(1), below: BigInt::from(1) };
        if t.sign().is_ge() && t.compare(&one).is_le() {
            all.push(to_triangle(&along(p, &minus(q, p), &t), triangle));
        }
    }
    least(all)
}

/// Whether a triangle, snapped and finite, meets a volume whose numbers are finite.
pub fn meets(volume: &Volume<'_>, corners: &[[f32; 3]; 3]) -> bool {
    let triangle = corners.map(point);
    let within = |distance: &Fraction, radius: f32| {
        let radius = Fraction::of(radius);
        distance.compare(&radius.times(&radius)).is_le()
    };
    match *volume {
        Volume::Box(bounds) => {
            let mut polygon = triangle.to_vec();
            for axis in 0..3 {
                for (side, bound) in [(1.0f32, bounds.hi[axis]), (-1.0, bounds.lo[axis])] {
                    let mut normal = [0.0; 3];
                    normal[axis] = side;
                    let normal = point(normal);
                    let offset = Fraction::of(bound).times(&Fraction::of(side));
                    polygon = clipped(&polygon, &normal, &offset);
                }
            }
            !polygon.is_empty()
        }
        Volume::Planes(planes) => {
            let mut polygon = triangle.to_vec();
            for plane in planes {
                // The offset in the units of the product.
                let offset = Fraction::of(plane.offset).times(&Fraction::of(1.0));
                polygon = clipped(&polygon, &point(plane.normal), &offset);
            }
            !polygon.is_empty()
        }
        Volume::Ball { centre, radius } => within(&to_triangle(&point(centre), &triangle), radius),
        Volume::Capsule { from, to, radius } => {
            within(&from_segment(&point(from), &point(to), &triangle), radius)
        }
        Volume::Triangle(other) => {
            let other = other.map(point);
            let touch = |one: &[Point; 3], other: &[Point; 3]| {
                (0..3).any(|i| from_segment(&one[i], &one[(i + 1) % 3], other).sign().is_eq())
            };
            touch(&triangle, &other) || touch(&other, &triangle)
        }
        _ => panic!("a volume that the oracle does not know"),
    }
}
