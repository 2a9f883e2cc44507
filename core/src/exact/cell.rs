//! Whether a triangle has a part inside a cell, decided exactly.
//!
//! *The question.* A triangle is *flat* on an axis where its three corners have one coordinate. Its
//! *part inside* a cell is what lies strictly between the cell's sides on the axes where it is not
//! flat, and between them or in one of them where it is. On the axes where it is not flat its
//! points on any one plane are no more than a line (of a segment: a point). So a triangle is
//! covered by closed cells if and only if what these leave of it holds no part inside any other
//! cell: see [`tree::validate`](crate::tree::validate).
//!
//! *How.* Two convex sets, one of them with an inside, are disjoint (the triangle and the inside of
//! the cell) if and only if the origin is not inside their Minkowski difference, that is, if some
//! face of the difference has it outside or in its plane. Those faces are perpendicular to the
//! axes, to the normal of the triangle, and to the products of an edge and an axis (separating
//! axes: Gottschalk, Lin and Manocha 1996). With a flat axis everything happens in the plane across
//! it: there only the products of edges and that axis are left; with two, on a line, where the axes
//! suffice. Segments, the kept triangles whose corners are collinear, have no normal, and their
//! products are the same three times.
//!
//! Each of these questions is the sign of a polynomial in differences of floats, of the second
//! degree for edges, of the third for the plane. `f64` with a bound on its error decides nearly all
//! of them; for edges it also compares products without error where the differences have none. The
//! rest is decided in whole numbers.

use core::cmp::Ordering;

use super::integer::Integer;
use super::meeting::{EPSILON, difference_exactly, minus, triple, triple_exactly};
use crate::aabb::Aabb;
use crate::triangle::Triangle;

/// A triangle, prepared for comparison with cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Body {
    corners: Triangle,
    /// Its bounds.
    pub bounds: Aabb,
    /// The axes on which it is flat.
    pub flat: [bool; 3],
    /// Two edges, from the first corner.
    edges: [[f64; 3]; 2],
    /// The signs of the normal's components.
    normal: [Ordering; 3],
    /// The axes along which edges are compared with cells: those whose products with edges are across
    /// faces of the difference.
    along: [bool; 3],
}

impl Body {
    /// Of snapped corners, no two of which are equal.
    pub(crate) fn new(corners: &Triangle) -> Body {
        let [a, b, c] = corners;
        let bounds = Aabb::of_points(corners);
        let flat = [0, 1, 2].map(|axis| bounds.lo[axis] == bounds.hi[axis]);
        let flats = flat.iter().filter(|&&flat| flat).count();
        let normal = [0, 1, 2].map(|axis| {
            let [k, l] = others(axis);
            turn([a[k], a[l]], [b[k], b[l]], [c[k], c[l]])
        });
        let along = flat.map(|flat| flats == 0 || (flats == 1 && flat));
        Body { corners: *corners, bounds, flat, edges: [minus(b, a), minus(c, a)], normal, along }
    }

    /// Whether the triangle has a part inside a cell, which must not be flat.
    pub(crate) fn has_part_inside(&self, cell: &Aabb) -> bool {
        let Aabb { lo, hi } = &self.bounds;
        for axis in 0..3 {
            let beside = if self.flat[axis] {
                hi[axis] < cell.lo[axis] || lo[axis] > cell.hi[axis]
            } else {
                hi[axis] <= cell.lo[axis] || lo[axis] >= cell.hi[axis]
            };
            if beside {
                return false;
            }
        }
        let beside = (0..3).any(|axis| self.along[axis] && self.edge_separates(cell, axis));
        let off = self.flat == [false; 3] && self.plane_separates(cell);
        !beside && !off
    }

    /// Whether the product of an edge and an axis separates: seen along that axis, the cell's inside is
    /// on the outer side of the edge.
    fn edge_separates(&self, cell: &Aabb, axis: usize) -> bool {
        let [k, l] = others(axis);
        let corners = self.corners.map(|corner| [corner[k], corner[l]]);
        (0..3).any(|edge| {
            let (p, q) = (corners[edge], corners[(edge + 1) % 3]);
            // The farthest corner of the cell on the left of the edge, and the one on the right. Where
            // the edge is along a side, both ends of that are as far.
            let (rises, runs) = (q[1] > p[1], q[0] > p[0]);
            let pick = |axis: usize, high: bool| if high { cell.hi[axis] } else { cell.lo[axis] };
            let left = || turn(p, q, [pick(k, !rises), pick(l, runs)]).is_le();
            let right = || turn(p, q, [pick(k, rises), pick(l, !runs)]).is_ge();
            // An edge along the axis is a point: no product.
            p != q
                && match self.normal[axis] {
                    // The triangle is on its left, so it must have nothing of the cell's inside there.
                    Ordering::Greater => left(),
                    Ordering::Less => right(),
                    Ordering::Equal => left() || right(),
                }
        })
    }

    /// Whether the triangle's plane separates: all of the cell's inside is on one side of it.
    fn plane_separates(&self, cell: &Aabb) -> bool {
        if self.normal == [Ordering::Equal; 3] {
            return false;
        }
        let end = |low: Ordering| {
            core::array::from_fn(|axis| {
                if self.normal[axis] == low { cell.lo[axis] } else { cell.hi[axis] }
            })
        };
        self.side(&end(Ordering::Less)).is_le() || self.side(&end(Ordering::Greater)).is_ge()
    }

    /// On which side of the triangle's plane a point is: greater where the normal points to.
    fn side(&self, point: &[f32; 3]) -> Ordering {
        let [a, b, c] = &self.corners;
        // Planes often pass through corners of triangles.
        if self.corners.contains(point) {
            return Ordering::Equal;
        }
        let [ab, ac] = &self.edges;
        triple(&minus(point, a), ab, ac).sign().unwrap_or_else(|| {
            let away = difference_exactly(point, a);
            triple_exactly(&away, &difference_exactly(b, a), &difference_exactly(c, a)).sign()
        })
    }
}

/// The two axes across an axis, so that they turn counter-clockwise as it points at the eye.
fn others(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
}

/// Which way the path from `p` over `q` to `r` turns: greater to the left, counter-clockwise.
fn turn(p: [f32; 2], q: [f32; 2], r: [f32; 2]) -> Ordering {
    let wide = |x: [f32; 2]| x.map(f64::from);
    let ([px, py], [qx, qy], [rx, ry]) = (wide(p), wide(q), wide(r));
    let (left, right) = ((qx - px) * (ry - py), (qy - py) * (rx - px));
    // Three roundings per product (two differences, itself), and those of their difference and of
    // this; no result of floats is so small or large that `f64` would lose more.
    let error = 4.0 * EPSILON * (left.abs() + right.abs());
    let difference = left - right;
    if difference > error {
        Ordering::Greater
    } else if difference < -error {
        Ordering::Less
    } else {
        turn_closely(p, q, r)
    }
}

#[cold]
fn turn_closely(p: [f32; 2], q: [f32; 2], r: [f32; 2]) -> Ordering {
    let differences = [(q[0], p[0]), (r[1], p[1]), (q[1], p[1]), (r[0], p[0])];
    if let [Some(a), Some(b), Some(c), Some(d)] =
        differences.map(|(x, y)| exact_difference(f64::from(x), f64::from(y)))
    {
        // Rounding is monotonic: of two products that come out different, the greater one is
        // greater. Equal ones are distinguished by their rounding errors.
        let compare = |x: f64, y: f64| x.partial_cmp(&y).unwrap_or(Ordering::Equal);
        return compare(a * b, c * d).then_with(|| compare(rounded_off(a, b), rounded_off(c, d)));
    }
    let [a, b, c, d] = differences.map(|(x, y)| Integer::difference(x, y));
    a.times(&b).minus(&c.times(&d)).sign()
}

/// The difference, if it has no rounding error (Knuth 1969).
fn exact_difference(a: f64, b: f64) -> Option<f64> {
    let difference = a - b;
    let taken = a - difference;
    let error = (a - (difference + taken)) + (taken - b);
    (error == 0.0).then_some(difference)
}

/// The exact product less the rounded one (Dekker 1971). Differences of floats are neither so large nor so
/// small that anything is lost on the way.
fn rounded_off(a: f64, b: f64) -> f64 {
    let split = |x: f64| {
        let scaled = x * 134_217_729.0; // 2^27 + 1
        let high = scaled - (scaled - x);
        (high, x - high)
    };
    let ((ah, al), (bh, bl)) = (split(a), split(b));
    al * bl - (((a * b - ah * bh) - al * bh) - ah * bl)
}

#[cfg(all(test, feature = "alloc"))]
mod tests {
    use super::*;
    use alloc::vec;
    use alloc::vec::Vec;

    struct Random(u32);

    impl Random {
        fn bits(&mut self) -> u32 {
            self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            let word = ((self.0 >> ((self.0 >> 28) + 4)) ^ self.0).wrapping_mul(277_803_737);
            (word >> 22) ^ word
        }

        fn below(&mut self, n: u32) -> i32 {
            (self.bits() % n) as i32
        }
    }

    /// By whole numbers of up to 53 bits.
    #[test]
    fn products_are_known_to_the_last_bit() {
        let mut random = Random(7);
        let mut inexact = 0;
        for _ in 0..10_000 {
            let [a, b] = [(); 2].map(|()| {
                let bits = u64::from(random.bits()) << 32 | u64::from(random.bits());
                let size = 11 + random.bits() % 53;
                (bits >> size) as i64 * if random.bits() & 1 == 0 { 1 } else { -1 }
            });
            let rest = i128::from(a) * i128::from(b) - (a as f64 * b as f64) as i128;
            assert_eq!(rounded_off(a as f64, b as f64), rest as f64, "{a} {b}");
            inexact += u32::from(rest != 0);
        }
        assert!(inexact > 2_000, "{inexact}");
    }

    /// A fraction in lowest terms, its denominator positive.
    #[derive(Clone, Copy, PartialEq)]
    struct Fraction(i128, i128);

    fn fraction(p: i128, q: i128) -> Fraction {
        let (mut a, mut b) = (p.abs(), q.abs());
        while b != 0 {
            (a, b) = (b, a % b);
        }
        let by = a.max(1) * q.signum();
        Fraction(p / by, q / by)
    }

    impl Fraction {
        fn plus(self, x: Fraction) -> Fraction {
            fraction(self.0 * x.1 + x.0 * self.1, self.1 * x.1)
        }

        fn times(self, x: Fraction) -> Fraction {
            fraction(self.0 * x.0, self.1 * x.1)
        }

        fn minus(self, x: Fraction) -> Fraction {
            self.plus(Fraction(-x.0, x.1))
        }

        fn over(self, x: Fraction) -> Fraction {
            self.times(fraction(x.1, x.0))
        }
    }

    /// The same answer by another way: the triangle is cut by the six sides in fractions, and the
    /// middle of the corners that are left is asked where it is.
    fn has_part_by_cutting(corners: &[[i128; 3]; 3], lo: &[i128; 3], hi: &[i128; 3]) -> bool {
        let mut polygon: Vec<[Fraction; 3]> =
            corners.iter().map(|corner| corner.map(|x| Fraction(x, 1))).collect();
        for (axis, plane, sign) in
            (0..3).flat_map(|axis| [(axis, lo[axis], 1), (axis, hi[axis], -1)])
        {
            let depth =
                |p: &[Fraction; 3]| p[axis].minus(Fraction(plane, 1)).times(Fraction(sign, 1));
            let mut cut = vec![];
            for (i, p) in polygon.iter().enumerate() {
                let q = &polygon[(i + 1) % polygon.len()];
                let (dp, dq) = (depth(p), depth(q));
                if dp.0 >= 0 {
                    cut.push(*p);
                }
                if dp.0.signum() * dq.0.signum() < 0 {
                    let ratio = dp.over(dp.minus(dq));
                    cut.push([0, 1, 2].map(|k| p[k].plus(ratio.times(q[k].minus(p[k])))));
                }
            }
            polygon = cut;
        }
        let whole = |x: i128| Fraction(x, 1);
        !polygon.is_empty()
            && (0..3).all(|k| {
                let flat = corners.iter().all(|corner| corner[k] == corners[0][k]);
                let sum = polygon.iter().fold(whole(0), |sum, p| sum.plus(p[k]));
                let middle = sum.over(whole(polygon.len() as i128));
                let (above, below) = (middle.minus(whole(lo[k])).0, whole(hi[k]).minus(middle).0);
                if flat { above >= 0 && below >= 0 } else { above > 0 && below > 0 }
            })
    }

    /// Small whole numbers, so that all that touches does: corners in sides, edges through edges and
    /// corners of the cell, flat triangles, segments along axes and askew. Axes are scaled apart by powers of
    /// two, which changes no answer.
    #[test]
    fn parts_inside_are_those_of_another_way() {
        let mut random = Random(1);
        // By flat axes: how many had a part inside, and how many had not though their bounds did.
        let mut seen = [[0; 2]; 3];
        let mut segments = [0; 2];
        for round in 0..60_000 {
            let reach = [3, 5, 9][round % 3];
            let mut next = || i128::from(random.below(reach)) - i128::from(reach / 2);
            let mut corners = [(); 3].map(|()| [(); 3].map(|()| next()));
            let [a, b] = [corners[0], corners[1]];
            if round % 5 == 0 {
                let times = next();
                corners[2] = [0, 1, 2].map(|k| a[k] + times * (b[k] - a[k]));
            }
            if round % 7 == 0 {
                let axis = round / 7 % 3;
                corners.iter_mut().for_each(|corner| corner[axis] = a[axis]);
            }
            let [a, b, c] = corners;
            if a == b || b == c || c == a {
                continue;
            }
            let ends = [(); 3].map(|()| [next(), next()]);
            if ends.iter().any(|[p, q]| p == q) {
                continue;
            }
            let (lo, hi) = (ends.map(|[p, q]| p.min(q)), ends.map(|[p, q]| p.max(q)));
            let expected = has_part_by_cutting(&corners, &lo, &hi);
            for scales in [[1.0, 1.0, 1.0], [1.2e-38, 1.0, 1e36f32], [1e30, 3.0, 1e-30]] {
                // Rounded once, and then exact.
                let scales = scales.map(|x| f32::from_bits(x.to_bits() & 0xff80_0000));
                let float = |p: &[i128; 3]| core::array::from_fn(|k| p[k] as f32 * scales[k]);
                let body = Body::new(&corners.map(|corner| float(&corner)));
                let cell = Aabb { lo: float(&lo), hi: float(&hi) };
                assert_eq!(body.has_part_inside(&cell), expected, "{corners:?} {lo:?} {hi:?}");
                let flats = body.flat.iter().filter(|&&flat| flat).count();
                let near = (0..3).all(|k| {
                    body.flat[k]
                        || (body.bounds.lo[k] < cell.hi[k] && body.bounds.hi[k] > cell.lo[k])
                });
                if expected || near {
                    seen[flats][usize::from(!expected)] += 1;
                    if body.normal == [Ordering::Equal; 3] {
                        segments[usize::from(!expected)] += 1;
                    }
                }
            }
        }
        let flat = seen.as_flattened();
        assert!(flat.iter().chain(&segments).all(|&count| count > 300), "{seen:?} {segments:?}");
    }

    /// Turns and sides are those of whole numbers, also where `f64` cannot tell.
    #[test]
    fn turns_and_sides_are_exact() {
        let mut random = Random(2);
        let mut float = |wide: bool| {
            let bits = random.bits();
            let (mantissa, sign) = (bits & 0xff_ffff, 1.0 - 2.0 * (bits >> 31) as f32);
            let shift = if wide { random.below(200) - 100 } else { random.below(3) - 30 };
            sign * mantissa as f32 * f32::from_bits(((shift + 127) as u32) << 23)
        };
        let mut equal = [0; 2];
        for round in 0..20_000 {
            let wide = round % 2 == 0;
            let mut point = || [float(wide), float(wide), float(wide)];
            let [a, b, mut c, mut d] = [point(), point(), point(), point()];
            match round % 3 {
                // On a line through the origin, and in its plane: doubled.
                1 => c = a.map(|x| 2.0 * x),
                // Next to it.
                2 => c = [2.0 * a[0], (2.0 * a[1]).next_up(), 2.0 * a[2]],
                _ => {}
            }
            let o = [0.0; 3];
            let exactly = |p: [f32; 3], q: [f32; 3], r: [f32; 3]| {
                let [x, y] = [0, 1].map(|k| Integer::difference(q[k], p[k]));
                let [z, w] = [0, 1].map(|k| Integer::difference(r[k], p[k]));
                x.times(&w).minus(&y.times(&z)).sign()
            };
            let plain = |p: [f32; 3]| [p[0], p[1]];
            for (p, q, r) in [(o, a, c), (a, c, o), (c, o, a), (a, b, c), (b, d, a)] {
                let found = turn(plain(p), plain(q), plain(r));
                assert_eq!(found, exactly(p, q, r), "{p:?} {q:?} {r:?}");
                equal[0] += usize::from(found.is_eq());
            }
            if round % 4 == 0 {
                d = [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
            }
            let body = Body::new(&[o, a, b]);
            let edges = [a, b].map(|p| p.map(Integer::from_float));
            let expected = triple_exactly(&d.map(Integer::from_float), &edges[0], &edges[1]).sign();
            assert_eq!(body.side(&d), expected, "{a:?} {b:?} {d:?}");
            equal[1] += usize::from(expected.is_eq());
        }
        assert!(equal.iter().all(|&count| count > 100), "{equal:?}");
    }
}
