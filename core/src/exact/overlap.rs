//! Whether a triangle meets a box, a ball, a capsule, a convex set or another triangle, decided exactly.
//!
//! All sets are closed: what touches meets. A triangle without area is the segment or point that its corners make. Coordinates are
//! snapped and finite.

use core::cmp::Ordering;

use super::number::{
    Number, Predicate, Vector, at_least_zero, at_most, both, cross, determinant, dot, either,
    vector,
};
use crate::aabb::Aabb;
use crate::triangle::Triangle;
use alloc::vec::Vec;

/// Whether a triangle and a box share a point: no axis separates them (Akenine-Moeller 2001), of the box's faces, the triangle's plane, and
/// the products of their edges.
pub fn meets_box(triangle: &Triangle, bounds: &Aabb) -> bool {
    for axis in 0..3 {
        let [a, b, c] = triangle.map(|corner| corner[axis]);
        if a.min(b).min(c) > bounds.hi[axis] || a.max(b).max(c) < bounds.lo[axis] {
            return false;
        }
    }
    let inside = |corner: &[f32; 3]| {
        (0..3).all(|axis| (bounds.lo[axis]..=bounds.hi[axis]).contains(&corner[axis]))
    };
    triangle.iter().any(inside) || InBox(triangle, bounds).decide()
}

struct InBox<'a>(&'a Triangle, &'a Aabb);

impl Predicate for InBox<'_> {
    fn answer<N: Number>(&self) -> Option<bool> {
        let InBox([a, b, c], bounds) = *self;
        let mut meets = Some(true);
        let normal = cross(&vector::<N>(b, a), &vector(c, a));
        let signs = [normal[0].sign(), normal[1].sign(), normal[2].sign()];
        let known = signs.iter().all(Option::is_some);
        // The box's corners farthest along the normal and against it.
        let corner = |along: Ordering| {
            [0, 1, 2].map(|axis| {
                let is_high = signs[axis] == Some(along);
                if is_high { bounds.hi[axis] } else { bounds.lo[axis] }
            })
        };
        let side = |corner: [f32; 3]| dot(&normal, &vector(&corner, a));
        meets = both(meets, || {
            if !known {
                return None;
            }
            let far = at_least_zero(&side(corner(Ordering::Greater)));
            both(far, || side(corner(Ordering::Less)).sign().map(Ordering::is_le))
        });
        for [from, to, other] in [[a, b, c], [b, c, a], [c, a, b]] {
            for axis in 0..3 {
                meets = both(meets, || not_apart::<N>(from, to, other, bounds, axis));
                if meets == Some(false) {
                    return meets;
                }
            }
        }
        meets
    }
}

/// Whether a box and a triangle, seen along an axis, are not separated by a line along the triangle's edge.
fn not_apart<N: Number>(
    from: &[f32; 3],
    to: &[f32; 3],
    other: &[f32; 3],
    bounds: &Aabb,
    axis: usize,
) -> Option<bool> {
    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
    let edge = [N::difference(to[i], from[i]), N::difference(to[j], from[j])];
    // Which side of the edge a point is on: the edge itself is at 0.
    let side = |x: f32, y: f32| {
        determinant(&edge[0], &N::difference(y, from[j]), &edge[1], &N::difference(x, from[i]))
    };
    let third = side(other[i], other[j]);
    // It grows with y where the edge goes up in x, and falls with x where the edge goes up in y.
    let (up, right) = (to[i] > from[i], to[j] > from[j]);
    let pick = |high: bool, axis: usize| if high { bounds.hi[axis] } else { bounds.lo[axis] };
    let most = side(pick(!right, i), pick(up, j));
    let least = side(pick(right, i), pick(!up, j));
    // Apart where all of the box is above both, or below both.
    let above =
        both(least.sign().map(Ordering::is_gt), || least.minus(&third).sign().map(Ordering::is_gt));
    let below =
        both(most.sign().map(Ordering::is_lt), || most.minus(&third).sign().map(Ordering::is_lt));
    either(above, || below).map(|apart| !apart)
}

/// Whether a point of a triangle is within a distance, at least 0, of a point.
pub fn meets_ball(triangle: &Triangle, centre: &[f32; 3], radius: f32) -> bool {
    InBall(triangle, centre, radius).decide()
}

struct InBall<'a>(&'a Triangle, &'a [f32; 3], f32);

impl Predicate for InBall<'_> {
    fn answer<N: Number>(&self) -> Option<bool> {
        near_triangle::<N>(self.0, self.1, self.2)
    }
}

fn squared<N: Number>(x: f32) -> N {
    let x = N::of(x);
    x.times(&x)
}

/// Whether two points are within a distance.
fn near_point<N: Number>(a: &[f32; 3], b: &[f32; 3], radius: f32) -> Option<bool> {
    let between = vector::<N>(a, b);
    at_most(&dot(&between, &between), &squared(radius))
}

/// Whether a point's foot lies on a segment's line between its ends, within a distance.
fn near_edge<N: Number>(
    point: &[f32; 3],
    from: &[f32; 3],
    to: &[f32; 3],
    radius: f32,
) -> Option<bool> {
    let (edge, to_point) = (vector::<N>(to, from), vector::<N>(point, from));
    let (along, length) = (dot(&edge, &to_point), dot(&edge, &edge));
    let there = both(length.sign().map(Ordering::is_gt), || {
        both(at_least_zero(&along), || at_most(&along, &length))
    });
    both(there, || {
        let area = cross(&edge, &to_point);
        at_most(&dot(&area, &area), &squared::<N>(radius).times(&length))
    })
}

fn near_triangle<N: Number>(triangle: &Triangle, point: &[f32; 3], radius: f32) -> Option<bool> {
    let [a, b, c] = triangle;
    let mut near = Some(false);
    for corner in triangle {
        near = either(near, || near_point::<N>(corner, point, radius));
    }
    for [from, to] in [[a, b], [b, c], [c, a]] {
        near = either(near, || near_edge::<N>(point, from, to, radius));
    }
    either(near, || {
        let normal = cross(&vector::<N>(b, a), &vector(c, a));
        let length = dot(&normal, &normal);
        let mut over = length.sign().map(Ordering::is_gt);
        for [from, to] in [[a, b], [b, c], [c, a]] {
            over = both(over, || {
                let out = cross(&vector::<N>(to, from), &vector(point, from));
                at_least_zero(&dot(&normal, &out))
            });
        }
        both(over, || {
            let height = dot(&normal, &vector(point, a));
            at_most(&height.times(&height), &squared::<N>(radius).times(&length))
        })
    })
}

/// Whether a point of a triangle is within a distance, at least 0, of a segment.
pub fn meets_capsule(triangle: &Triangle, from: &[f32; 3], to: &[f32; 3], radius: f32) -> bool {
    InCapsule(triangle, from, to, radius).decide()
}

struct InCapsule<'a>(&'a Triangle, &'a [f32; 3], &'a [f32; 3], f32);

impl Predicate for InCapsule<'_> {
    fn answer<N: Number>(&self) -> Option<bool> {
        let InCapsule(triangle, from, to, radius) = *self;
        let [a, b, c] = triangle;
        let mut near = near_triangle::<N>(triangle, from, radius);
        near = either(near, || near_triangle::<N>(triangle, to, radius));
        for corner in triangle {
            near = either(near, || near_edge::<N>(corner, from, to, radius));
        }
        for [p, q] in [[a, b], [b, c], [c, a]] {
            near = either(near, || near_across::<N>([from, to], [p, q], radius));
        }
        either(near, || segment_meets::<N>(from, to, triangle))
    }
}

/// Whether the lines of two segments are within a distance, and nearest where the segments are.
fn near_across<N: Number>(
    [p, q]: [&[f32; 3]; 2],
    [r, s]: [&[f32; 3]; 2],
    radius: f32,
) -> Option<bool> {
    let (d, e, w) = (vector::<N>(q, p), vector::<N>(s, r), vector::<N>(p, r));
    let (dd, de, ee, dw, ew) = (dot(&d, &d), dot(&d, &e), dot(&e, &e), dot(&d, &w), dot(&e, &w));
    let whole = determinant(&dd, &ee, &de, &de);
    let mut within = whole.sign().map(Ordering::is_gt);
    for along in [determinant(&de, &ew, &ee, &dw), determinant(&dd, &ew, &de, &dw)] {
        within = both(within, || both(at_least_zero(&along), || at_most(&along, &whole)));
    }
    both(within, || {
        let across = cross(&d, &e);
        let distance = dot(&w, &across);
        let length = squared::<N>(radius).times(&dot(&across, &across));
        at_most(&distance.times(&distance), &length)
    })
}

/// Whether two triangles share a point.
pub fn meets_triangle(one: &Triangle, other: &Triangle) -> bool {
    for axis in 0..3 {
        let [a, b] = [one, other].map(|own| own.map(|corner| corner[axis]));
        let least = |x: [f32; 3]| x[0].min(x[1]).min(x[2]);
        let most = |x: [f32; 3]| x[0].max(x[1]).max(x[2]);
        if least(a) > most(b) || least(b) > most(a) {
            return false;
        }
    }
    Both(one, other).decide()
}

struct Both<'a>(&'a Triangle, &'a Triangle);

impl Predicate for Both<'_> {
    /// Where convex sets meet, an edge of one meets the other, or they lie in one plane and a corner does.
    fn answer<N: Number>(&self) -> Option<bool> {
        let mut meets = Some(false);
        for (own, other) in [(self.0, self.1), (self.1, self.0)] {
            let [a, b, c] = own;
            for [from, to] in [[a, b], [b, c], [c, a]] {
                meets = either(meets, || segment_meets::<N>(from, to, other));
            }
        }
        meets
    }
}

/// The volume that four points span, times six.
fn volume<N: Number>(a: &[f32; 3], b: &[f32; 3], c: &[f32; 3], d: &[f32; 3]) -> N {
    dot(&cross(&vector::<N>(b, a), &vector(c, a)), &vector(d, a))
}

/// Whether a segment and a triangle share a point.
fn segment_meets<N: Number>(p: &[f32; 3], q: &[f32; 3], triangle: &Triangle) -> Option<bool> {
    let [a, b, c] = triangle;
    let sides = [volume::<N>(a, b, c, p).sign(), volume::<N>(a, b, c, q).sign()];
    match sides {
        [Some(x), Some(y)] if x == y && x.is_ne() => return Some(false),
        [Some(Ordering::Equal), Some(Ordering::Equal)] => {
            return in_one_plane::<N>(p, q, triangle);
        }
        [Some(_), Some(_)] => {}
        _ => return None,
    }
    // The line goes through the plane once: on the same side of all edges, or on one.
    let turns = [[a, b], [b, c], [c, a]].map(|[from, to]| volume::<N>(p, q, from, to).sign());
    let all = |test: fn(Ordering) -> bool| {
        let known = |sign: &Option<Ordering>| sign.map(test);
        let mut all = Some(true);
        for sign in &turns {
            all = both(all, || known(sign));
        }
        all
    };
    either(all(Ordering::is_ge), || all(Ordering::is_le))
}

/// The same where all lie in one plane, or the triangle has no area.
fn in_one_plane<N: Number>(p: &[f32; 3], q: &[f32; 3], triangle: &Triangle) -> Option<bool> {
    let [a, b, c] = triangle;
    let mut meets = Some(false);
    for [from, to] in [[a, b], [b, c], [c, a]] {
        meets = either(meets, || segments_meet::<N>(p, q, from, to));
    }
    // A segment that meets no edge lies within, or outside.
    either(meets, || {
        let normal = cross(&vector::<N>(b, a), &vector(c, a));
        let mut within = dot(&normal, &normal).sign().map(Ordering::is_gt);
        for [from, to] in [[a, b], [b, c], [c, a]] {
            within = both(within, || {
                at_least_zero(&dot(&normal, &cross(&vector::<N>(to, from), &vector(p, from))))
            });
        }
        within
    })
}

/// Whether two segments share a point.
fn segments_meet<N: Number>(
    p: &[f32; 3],
    q: &[f32; 3],
    r: &[f32; 3],
    s: &[f32; 3],
) -> Option<bool> {
    for axis in 0..3 {
        if p[axis].max(q[axis]) < r[axis].min(s[axis])
            || r[axis].max(s[axis]) < p[axis].min(q[axis])
        {
            return Some(false);
        }
    }
    // In one plane, and on each line's both sides: seen along each axis.
    let mut meets = volume::<N>(p, q, r, s).sign().map(Ordering::is_eq);
    for axis in 0..3 {
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let turn = |a: &[f32; 3], b: &[f32; 3], x: &[f32; 3]| {
            let d = |to: &[f32; 3], k: usize| N::difference(to[k], a[k]);
            determinant(&d(b, i), &d(x, j), &d(b, j), &d(x, i)).sign()
        };
        let apart = |a: Option<Ordering>, b: Option<Ordering>| match (a, b) {
            (Some(a), Some(b)) => Some(a == b && a.is_ne()),
            _ => None,
        };
        meets = both(meets, || apart(turn(p, q, r), turn(p, q, s)).map(|apart| !apart));
        meets = both(meets, || apart(turn(r, s, p), turn(r, s, q)).map(|apart| !apart));
    }
    meets
}

/// A half of space: the points x with `normal . x <= offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Out of the half, of any length.
    pub normal: [f32; 3],
    /// Where the plane is, in lengths of the normal times units.
    pub offset: f32,
}

/// Whether a triangle and a set of half-spaces share a point. Time grows with the number of planes on average over orders of the planes; the order is
/// shuffled.
pub fn meets_planes(triangle: &Triangle, planes: &[Plane]) -> bool {
    InPlanes(triangle, planes).decide()
}

struct InPlanes<'a>(&'a Triangle, &'a [Plane]);

impl Predicate for InPlanes<'_> {
    /// In weights of the corners each half-space is a half-plane, and so are the triangle's sides. Whether half-planes share a point is a linear program of
    /// two variables, solved by adding one half-plane at a time (Seidel 1991).
    fn answer<N: Number>(&self) -> Option<bool> {
        let InPlanes(triangle, planes) = *self;
        let (minus, zero) = (N::of(-1.0), N::of(0.0));
        let mut halves: Vec<Vector<N>> = Vec::new();
        for place in 0..3 {
            let mut half = [zero.clone(), zero.clone(), zero.clone()];
            half[place] = minus.clone();
            halves.push(half);
        }
        for plane in planes {
            let one = N::of(1.0);
            let normal = plane.normal.map(N::of);
            let offset = N::of(plane.offset).times(&one);
            let beyond = triangle.map(|corner| dot(&normal, &corner.map(N::of)).minus(&offset));
            let signs = [beyond[0].sign(), beyond[1].sign(), beyond[2].sign()];
            if signs.iter().all(|sign| *sign == Some(Ordering::Greater)) {
                return Some(false);
            }
            // What holds for all corners holds for all of the triangle.
            if !signs.iter().all(|sign| sign.is_some_and(Ordering::is_le)) {
                halves.push(beyond);
            }
        }
        shuffle(&mut halves[3..]);
        // Of all points in the halves so far, the one with the greatest first weight: at first the first corner.
        let mut best = Crossing::of(&halves, 1, 2)?;
        for added in 3..halves.len() {
            if best.is_within(&halves[added])? {
                continue;
            }
            match best_on_line(&halves, added)? {
                Some(next) => best = next,
                None => return Some(false),
            }
        }
        Some(true)
    }
}

/// Puts halves into an order that no caller chose.
fn shuffle<T>(halves: &mut [T]) {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    for last in (1..halves.len()).rev() {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let at = (u128::from(state) * (last as u128 + 1)) >> 64;
        halves.swap(last, at as usize);
    }
}

/// Where the lines of two halves cross.
struct Crossing<N> {
    /// Weights of the corners, up to a factor.
    point: Vector<N>,
    /// The sign of the factor; equal where the lines are parallel, and cross nowhere.
    side: Ordering,
}

impl<N: Number> Crossing<N> {
    fn of(halves: &[Vector<N>], i: usize, j: usize) -> Option<Crossing<N>> {
        let point = cross(&halves[i], &halves[j]);
        let side = point[0].plus(&point[1]).plus(&point[2]).sign()?;
        Some(Crossing { point, side })
    }

    /// Whether the point is in a half.
    fn is_within(&self, half: &Vector<N>) -> Option<bool> {
        Some(dot(half, &self.point).sign()? != self.side)
    }
}

/// The best point on the line of a half that is in all halves before it, if there is one. That of all these halves is there, since the best point of the halves before
/// is not in this one.
///
/// Along the line, what a half measures grows or falls as the sign of the crossing with its line says. So each half bounds the points on the line
/// from below or above, or holds for all of them or none.
fn best_on_line<N: Number>(halves: &[Vector<N>], added: usize) -> Option<Option<Crossing<N>>> {
    let mut lower: Option<Crossing<N>> = None;
    let mut upper: Option<(Crossing<N>, usize)> = None;
    let mut parallel = Vec::new();
    for (number, half) in halves[..added].iter().enumerate() {
        let own = Crossing::of(halves, added, number)?;
        match own.side {
            Ordering::Greater => {
                let is_tighter = match &lower {
                    Some(lower) => !lower.is_within(half)?,
                    None => true,
                };
                if is_tighter {
                    lower = Some(own);
                }
            }
            Ordering::Less => {
                let is_tighter = match &upper {
                    Some((upper, _)) => !upper.is_within(half)?,
                    None => true,
                };
                if is_tighter {
                    upper = Some((own, number));
                }
            }
            Ordering::Equal => parallel.push(number),
        }
    }
    // The triangle bounds every line from both sides.
    let (lower, (upper, by)) = lower.zip(upper)?;
    for number in parallel {
        if !lower.is_within(&halves[number])? {
            return Some(None);
        }
    }
    if !lower.is_within(&halves[by])? {
        return Some(None);
    }
    // The first weight grows along the line as this does.
    let growth = halves[added][1].minus(&halves[added][2]).sign()?;
    Some(Some(if growth.is_gt() { upper } else { lower }))
}

#[cfg(test)]
mod counted;
