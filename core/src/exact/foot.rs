//! Which of two triangles is nearer to a point, exactly.
//!
//! The point of a triangle that is closest to a point is one of its corners, or the foot of the perpendicular on an edge, or on its
//! face. Which of these it is, signs of polynomials of degree 2 and 4 in differences of coordinates say (Ericson 2005, section 5.1.5). The squared distance is then a
//! fraction: of degrees 2 and 0, 4 and 2, or 6 and 4. Two are compared by their products crosswise, of degree 10 at most.
//!
//! Each sign is first decided in `f64` with a bound on its error ([`Enclosed`]), coordinates being multiplied by a power of two that brings the
//! farthest corner to about 1; where that does not suffice, in whole numbers ([`Wide`]).
//!
//! Corners may be under a transform: their coordinates in the world are then polynomials of degree 2 in its numbers and theirs, and nothing of that is rounded either.

use core::cmp::Ordering;

use super::enclosed::Enclosed;
use super::integer::Whole;
use super::number::{Number, Vector, at_least_zero, at_most, both, cross, determinant, dot};
use crate::triangle::Triangle;

/// Whole numbers of 88 limbs. A coordinate in the world is a multiple of 2^-298, below 3 * 2^256 + 2^128, so that the difference of two takes 556 bits and that
/// of two such differences 557. The product of a face's numerator and another's denominator takes ten factors, at most 5,582 bits with all sums.
pub(super) type Wide = Whole<88>;

/// The rows of an affine transform.
pub(crate) type Matrix = [[f32; 4]; 3];

/// What part of a triangle the closest point lies on.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    /// A corner.
    Corner([f32; 3]),
    /// Between the ends of an edge, these included.
    Edge([[f32; 3]; 2]),
    /// Within the triangle.
    Face(Triangle),
}

/// The closest point of a triangle, by what part of it has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Foot {
    place: Place,
    transform: Option<Matrix>,
}

/// Numbers that a comparison is made of.
trait Length: Number {
    /// The number times a power of two, the same for all lengths of a comparison.
    fn scaled(self, power: f64) -> Self;
}

impl Length for Enclosed {
    fn scaled(self, power: f64) -> Enclosed {
        Enclosed::scaled(&self, power)
    }
}

impl<const LIMBS: usize> Length for Whole<LIMBS> {
    /// No number is too great or too small for it.
    fn scaled(self, _: f64) -> Self {
        self
    }
}

/// A corner as the point sees it. In whole numbers the unit is 2^-149 in a mesh, and 2^-298 under a transform.
fn seen<N: Number>(corner: &[f32; 3], transform: Option<&Matrix>, point: &[f32; 3]) -> Vector<N> {
    let Some(rows) = transform else {
        return [0, 1, 2].map(|axis| N::difference(corner[axis], point[axis]));
    };
    let one = N::of(1.0);
    [0, 1, 2].map(|axis| {
        let [x, y, z, moved] = rows[axis].map(N::of);
        let products = x.times(&N::of(corner[0])).plus(&y.times(&N::of(corner[1])));
        let turned = products.plus(&z.times(&N::of(corner[2])));
        turned.plus(&moved.times(&one)).minus(&N::of(point[axis]).times(&one))
    })
}

fn minus<N: Number>(a: &Vector<N>, b: &Vector<N>) -> Vector<N> {
    [0, 1, 2].map(|axis| a[axis].minus(&b[axis]))
}

/// A power of two that brings the greatest of some magnitudes to between 1 and 2.
fn unit<'a>(vectors: impl Iterator<Item = &'a Vector<Enclosed>>) -> f64 {
    let most = vectors.flatten().fold(0.0f64, |most, x| most.max(x.about().abs()));
    let exponent = (most.to_bits() >> 52) as i64;
    // Of a normal number with a normal reciprocal.
    if (2..2045).contains(&exponent) {
        f64::from_bits(((2046 - exponent) as u64) << 52)
    } else {
        1.0
    }
}

impl Foot {
    /// Where the point of a triangle is that is closest to a point. All coordinates are finite; those of the triangle are of the object that the transform, if
    /// there is one, brings to the world, where the point is.
    pub(crate) fn of(point: &[f32; 3], corners: &Triangle, transform: Option<&Matrix>) -> Foot {
        let fast = corners.each_ref().map(|corner| seen::<Enclosed>(corner, transform, point));
        let unit = unit(fast.iter());
        let fast = fast.map(|corner| corner.map(|x| x.scaled(unit)));
        let place = place(&fast, corners).unwrap_or_else(|| {
            let whole = corners.each_ref().map(|corner| seen::<Wide>(corner, transform, point));
            // Whole numbers know all signs.
            place(&whole, corners).unwrap_or(Place::Corner(corners[0]))
        });
        Foot { place, transform: transform.copied() }
    }

    /// How the distance from the point compares with another one's. Both are under a transform, or neither.
    pub(crate) fn compare(&self, other: &Foot, point: &[f32; 3]) -> Ordering {
        if self.is_that_of(other) {
            return Ordering::Equal;
        }
        let unit = unit(self.vectors(point).iter().chain(&other.vectors(point)));
        let fast = self.against::<Enclosed>(other, point, unit);
        fast.or_else(|| self.against::<Wide>(other, point, 1.0)).unwrap_or(Ordering::Equal)
    }

    /// Whether the distance from the point is at most this one, which is at least 0.
    pub(crate) fn is_within(&self, point: &[f32; 3], distance: f32) -> bool {
        if distance == f32::INFINITY {
            return true;
        }
        let unit = unit(self.vectors(point).iter());
        let fast = self.within::<Enclosed>(point, distance, unit);
        fast.or_else(|| self.within::<Wide>(point, distance, 1.0)).unwrap_or(false)
    }

    /// Whether it is the same point: that of the same corner, edge or face.
    fn is_that_of(&self, other: &Foot) -> bool {
        let [own, others] = [self, other].map(Foot::corners);
        let all_in =
            |these: &[[f32; 3]], those: &[[f32; 3]]| these.iter().all(|x| those.contains(x));
        self.transform == other.transform
            && own.len() == others.len()
            && all_in(own, others)
            && all_in(others, own)
    }

    fn corners(&self) -> &[[f32; 3]] {
        match &self.place {
            Place::Corner(corner) => core::slice::from_ref(corner),
            Place::Edge(ends) => ends,
            Place::Face(corners) => corners,
        }
    }

    /// About where the corners are.
    fn vectors(&self, point: &[f32; 3]) -> [Vector<Enclosed>; 3] {
        let corners = self.corners();
        [0, 1, 2].map(|i| seen(&corners[i.min(corners.len() - 1)], self.transform.as_ref(), point))
    }

    /// The squared distance: numerator, and denominator if that is not 1.
    fn squared<N: Length>(&self, point: &[f32; 3], unit: f64) -> (N, Option<N>) {
        let seen = |corner: &[f32; 3]| {
            seen::<N>(corner, self.transform.as_ref(), point).map(|x| x.scaled(unit))
        };
        match &self.place {
            Place::Corner(corner) => {
                let a = seen(corner);
                (dot(&a, &a), None)
            }
            Place::Edge([a, b]) => {
                let (a, b) = (seen(a), seen(b));
                let edge = minus(&b, &a);
                let area = cross(&a, &edge);
                (dot(&area, &area), Some(dot(&edge, &edge)))
            }
            Place::Face([a, b, c]) => {
                let (a, b, c) = (seen(a), seen(b), seen(c));
                let normal = cross(&minus(&b, &a), &minus(&c, &a));
                let height = dot(&normal, &a);
                (height.times(&height), Some(dot(&normal, &normal)))
            }
        }
    }

    fn against<N: Length>(&self, other: &Foot, point: &[f32; 3], unit: f64) -> Option<Ordering> {
        let ((above, below), (others_above, others_below)) =
            (self.squared::<N>(point, unit), other.squared::<N>(point, unit));
        let product = |above: N, below: Option<N>| match below {
            Some(below) => above.times(&below),
            None => above,
        };
        product(above, others_below).minus(&product(others_above, below)).sign()
    }

    fn within<N: Length>(&self, point: &[f32; 3], distance: f32, unit: f64) -> Option<bool> {
        let (above, below) = self.squared::<N>(point, unit);
        let distance = match self.transform {
            Some(_) => N::of(distance).times(&N::of(1.0)),
            None => N::of(distance),
        };
        let distance = distance.scaled(unit);
        let squared = distance.times(&distance);
        at_most(&above, &below.map_or_else(|| squared.clone(), |below| below.times(&squared)))
    }
}

/// The part of a triangle with the point that is closest to the origin, if these numbers know it.
///
/// An edge of no length has no part of its own, and a triangle without area no face.
fn place<N: Number>([a, b, c]: &[Vector<N>; 3], corners: &Triangle) -> Option<Place> {
    let [own_a, own_b, own_c] = *corners;
    let (ab, ac) = (minus(b, a), minus(c, a));
    // How far the origin lies along an edge from a corner, backwards.
    let back = |edge: &Vector<N>, from: &Vector<N>| dot(edge, from);
    let at_most_zero = |x: &N| x.sign().map(Ordering::is_le);
    let (ab_a, ac_a) = (back(&ab, a), back(&ac, a));
    if both(at_least_zero(&ab_a), || at_least_zero(&ac_a))? {
        return Some(Place::Corner(own_a));
    }
    let (ab_b, ac_b) = (back(&ab, b), back(&ac, b));
    if both(at_most_zero(&ab_b), || at_most(&ab_b, &ac_b))? {
        return Some(Place::Corner(own_b));
    }
    // The origin is not on the inner side of an edge where its weight for the third corner is not above 0.
    let beyond = |whole: N, ends: Option<bool>| both(at_most_zero(&whole), || ends);
    let along_ab = both(at_most_zero(&ab_a), || at_least_zero(&ab_b));
    if both(beyond(determinant(&ab_a, &ac_b, &ab_b, &ac_a), along_ab), || has_length(&ab))? {
        return Some(Place::Edge([own_a, own_b]));
    }
    let (ab_c, ac_c) = (back(&ab, c), back(&ac, c));
    if both(at_most_zero(&ac_c), || at_most(&ac_c, &ab_c))? {
        return Some(Place::Corner(own_c));
    }
    let along_ac = both(at_most_zero(&ac_a), || at_least_zero(&ac_c));
    if both(beyond(determinant(&ab_c, &ac_a, &ab_a, &ac_c), along_ac), || has_length(&ac))? {
        return Some(Place::Edge([own_a, own_c]));
    }
    let along_bc = both(at_most(&ac_b, &ab_b), || at_most(&ab_c, &ac_c));
    if beyond(determinant(&ab_b, &ac_c, &ab_c, &ac_b), along_bc)? {
        return Some(Place::Edge([own_b, own_c]));
    }
    Some(Place::Face([own_a, own_b, own_c]))
}

fn has_length<N: Number>(edge: &Vector<N>) -> Option<bool> {
    dot(edge, edge).sign().map(Ordering::is_gt)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The widest products of a comparison, a face against a face under a transform, in numbers of so many limbs.
    fn widest<const LIMBS: usize>() {
        let most = f32::MAX;
        let rows =
            [[most, most, most, most], [-most, most, -most, most], [most, -most, -most, -most]];
        let own = |signs: [f32; 3]| signs.map(|sign| sign * most);
        let face = [own([1.0, 1.0, 1.0]), own([-1.0, 1.0, -1.0]), own([1.0, -1.0, -1.0])];
        let other = face.map(|corner| [corner[1], -corner[2], corner[0]]);
        let point = own([-1.0, -1.0, 1.0]);
        let foot = |corners| Foot { place: Place::Face(corners), transform: Some(rows) };
        let (face, other) = (foot(face), foot(other));
        let compared = |one: &Foot, other: &Foot| {
            one.against::<Whole<LIMBS>>(other, &point, 1.0).expect("whole numbers know")
        };
        assert_eq!(compared(&face, &face), Ordering::Equal);
        assert_eq!(compared(&face, &other), compared(&other, &face).reverse());
        assert!(compared(&face, &other).is_ne());
    }

    #[test]
    fn the_widest_products_fit() {
        widest::<88>();
    }

    #[test]
    #[should_panic(expected = "out of bounds")]
    fn narrower_numbers_would_not_hold_them() {
        widest::<85>();
    }

    /// Each part of a triangle, by points whose closest point is known; and of triangles without area.
    #[test]
    fn parts_are_those_that_are_seen() {
        let (a, b, c) = ([0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]);
        let of = |point: [f32; 3], corners: [[f32; 3]; 3]| Foot::of(&point, &corners, None).place;
        assert_eq!(of([1.0, 1.0, 5.0], [a, b, c]), Place::Face([a, b, c]));
        assert_eq!(of([1.0, -1.0, 5.0], [a, b, c]), Place::Edge([a, b]));
        assert_eq!(of([-1.0, 1.0, 5.0], [a, b, c]), Place::Edge([a, c]));
        assert_eq!(of([3.0, 3.0, -2.0], [a, b, c]), Place::Edge([b, c]));
        assert_eq!(of([-1.0, -1.0, 0.0], [a, b, c]), Place::Corner(a));
        assert_eq!(of([9.0, 1.0, 0.0], [a, b, c]), Place::Corner(b));
        assert_eq!(of([1.0, 9.0, 3.0], [a, b, c]), Place::Corner(c));
        let middle = [1.0, 0.0, 0.0];
        for corners in [[a, middle, b], [middle, a, b], [b, a, middle], [a, b, b], [b, a, b]] {
            for (x, square) in [(-1.0f32, 1.0f32), (0.5, 0.0), (2.0, 0.0), (4.0, 0.0), (6.0, 4.0)] {
                let foot = Foot::of(&[x, 2.0, 0.0], &corners, None);
                let (above, below) = foot.squared::<Wide>(&[x, 2.0, 0.0], 1.0);
                let whole = Wide::from_float(square + 4.0).times(&Wide::from_float(1.0));
                let found = below.map_or(above.minus(&whole).sign(), |below| {
                    above.minus(&whole.times(&below)).sign()
                });
                assert_eq!(found, Ordering::Equal, "{corners:?} {x}");
            }
        }
        assert_eq!(of([1.0, 1.0, 1.0], [b, b, b]), Place::Corner(b));
    }
}
