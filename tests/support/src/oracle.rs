//! The exact oracle: which triangles a ray meets, and where, in real arithmetic on the given floats.
//!
//! It shares no code with the tracer: other formulas (triple products instead of a shear), other
//! arithmetic (`f64` under a proven bound, exact expansions where that does not decide), another
//! hierarchy (boxes instead of planes, tested without rounding in the wrong direction).
//!
//! Conventions: coordinates are snapped as the library documents (magnitudes below 2^-126 are 0,
//! direction components too). Triangles are closed. A triangle with a non-finite coordinate or
//! without area is met nowhere, and a ray in a triangle's plane does not meet that triangle.

use crate::expansion::Expansion;
use splitplane_core::aabb::Aabb;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Culling, QueryOptions, Ray};
use std::cell::OnceCell;
use std::cmp::Ordering;
use std::collections::HashMap;

/// The library's rule for one coordinate: magnitudes below 2^-126 become +0, and so does -0.
pub fn snap(value: f32) -> f32 {
    if value.abs() < f32::MIN_POSITIVE { 0.0 } else { value }
}

/// What the oracle says of one ray.
#[derive(Clone, Debug, PartialEq)]
pub enum OracleHit {
    /// The ray meets nothing between its limits.
    Miss,
    /// The closest point it meets.
    Hit {
        /// Its distance, rounded from the exact quotient (relative error below 2^-50).
        t: f64,
        /// Every triangle met at exactly this distance, in ascending order.
        triangles: Vec<u32>,
        /// Whether the point lies on the boundary of one of them.
        on_edge: bool,
    },
}

/// The closest hit of real arithmetic, as a single-precision record can hold it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// The exact distance rounded to the nearest float; below 2^-126 it is 0, and at most the
    /// greatest float.
    pub t: f32,
    /// Of all triangles at exactly this distance, the lowest index.
    pub triangle: u32,
}

/// One triangle met by a ray.
#[derive(Clone, Debug)]
pub struct Crossing {
    /// The triangle; of several with the same corners, the lowest index not ignored.
    pub triangle: u32,
    /// The distance, within 2^-40 of the exact quotient.
    pub t: f64,
    /// Whether the ray comes from the side where the corners run counter-clockwise.
    pub front: bool,
    /// Whether the point lies on an edge or a corner.
    pub on_edge: bool,
    unique: u32,
    /// Bound of the error of `t`.
    error: f64,
    ray: ValidRay,
    corners: [[f64; 3]; 3],
    /// Numerator and denominator of the distance, once something needs them.
    exact: OnceCell<(Expansion, Expansion)>,
}

impl Crossing {
    fn exact(&self) -> &(Expansion, Expansion) {
        self.exact.get_or_init(|| quotient(&self.ray, &self.corners))
    }

    /// Where the estimates are further apart than they err, they decide.
    fn decided(&self, other: f64, error: f64) -> Option<Ordering> {
        let rounding = f64::EPSILON * (self.t.abs() + other.abs());
        let apart = (self.t - other).abs() > self.error + error + rounding;
        apart.then(|| self.t.total_cmp(&other))
    }

    /// How two exact distances compare.
    pub fn compare_t(&self, other: &Crossing) -> Ordering {
        if let Some(order) = self.decided(other.t, other.error) {
            return order;
        }
        let ((above, below), (others_above, others_below)) = (self.exact(), other.exact());
        let difference = above.times(others_below).minus(&others_above.times(below)).sign();
        if below.sign() == others_below.sign() { difference } else { difference.reverse() }
    }

    /// How the exact distance compares with a limit of a ray, which is not NaN.
    pub fn compare_limit(&self, limit: f32) -> Ordering {
        if limit.is_infinite() {
            return if limit > 0.0 { Ordering::Less } else { Ordering::Greater };
        }
        self.compare_float(f64::from(limit))
    }

    /// How the exact distance compares with a number of at most 25 bits, in the range of `f32`.
    fn compare_float(&self, number: f64) -> Ordering {
        if let Some(order) = self.decided(number, 0.0) {
            return order;
        }
        let (above, below) = self.exact();
        let difference = above.minus(&below.scaled(number)).sign();
        match below.sign() {
            Ordering::Less => difference.reverse(),
            _ => difference,
        }
    }

    /// Whether the exact distance lies between the ray's limits, both included.
    pub fn is_within(&self, ray: &Ray) -> bool {
        self.compare_limit(ray.t_min).is_ge() && self.compare_limit(ray.t_max).is_le()
    }

    /// The exact distance, rounded to the nearest float, ties to even; magnitudes below 2^-126
    /// become 0, and those above the greatest float become that.
    pub fn rounded_t(&self) -> f32 {
        let greatest = f64::from(f32::MAX);
        let mut t = self.t.clamp(-greatest, greatest) as f32;
        // Beyond the greatest float there is nothing to choose from.
        if t.abs() < f32::MAX {
            // The estimate may be on the wrong side of the middle between two floats.
            let (low, high) = (t.next_down(), t.next_up());
            let middle = |a: f32, b: f32| (f64::from(a) + f64::from(b)) / 2.0;
            let even = t.to_bits() & 1 == 0;
            match self.compare_float(middle(low, t)) {
                Ordering::Less => t = low,
                Ordering::Equal if !even => t = low,
                _ => match self.compare_float(middle(t, high)) {
                    Ordering::Greater => t = high,
                    Ordering::Equal if !even => t = high,
                    _ => {}
                },
            }
        }
        snap(t)
    }
}

/// A ray the library answers at all, in `f64`; `None` for the invalid ones, which hit nothing.
#[derive(Clone, Copy, Debug)]
pub struct ValidRay {
    /// Origin, snapped.
    pub origin: [f64; 3],
    /// Direction, snapped; at least one component is not 0.
    pub direction: [f64; 3],
}

impl ValidRay {
    /// Checks a ray by the documented rules.
    pub fn new(ray: &Ray) -> Option<ValidRay> {
        let finite = ray.origin.iter().chain(&ray.direction).all(|x| x.is_finite());
        let direction = ray.direction.map(|x| f64::from(snap(x)));
        let valid = finite
            && direction.iter().any(|&x| x != 0.0)
            && !ray.t_min.is_nan()
            && !ray.t_max.is_nan();
        valid.then(|| ValidRay { origin: ray.origin.map(|x| f64::from(snap(x))), direction })
    }
}

/// The oracle of one mesh. Triangles with the same corners in the same order are kept once, and
/// boxes over them make large meshes affordable; [`Oracle::closest_plain`] does without the boxes.
pub struct Oracle {
    unique: Vec<Unique>,
    /// Index into `unique` of every triangle; `u32::MAX` for a non-finite one.
    place: Vec<u32>,
    nodes: Vec<BoxNode>,
    order: Vec<u32>,
}

struct Unique {
    corners: [[f64; 3]; 3],
    /// All triangles with these corners, ascending.
    members: Vec<u32>,
}

struct BoxNode {
    lo: [f64; 3],
    hi: [f64; 3],
    /// Start of a leaf's range of `order`, or with `count` 0 the index of the right child.
    first: u32,
    count: u32,
}

const BOX_LEAF: usize = 4;

impl Oracle {
    /// Prepares a mesh.
    pub fn new(mesh: &Mesh<'_>) -> Oracle {
        let mut unique: Vec<Unique> = Vec::new();
        let mut place = Vec::with_capacity(mesh.len());
        let mut seen: HashMap<[[u32; 3]; 3], u32> = HashMap::new();
        for index in 0..mesh.len() {
            let corners = mesh.triangle(index);
            if corners.as_flattened().iter().any(|x| !x.is_finite()) {
                place.push(u32::MAX);
                continue;
            }
            let corners = corners.map(|corner| corner.map(snap));
            let key = corners.map(|corner| corner.map(f32::to_bits));
            let slot = *seen.entry(key).or_insert(unique.len() as u32);
            if slot as usize == unique.len() {
                let corners = corners.map(|corner| corner.map(f64::from));
                unique.push(Unique { corners, members: Vec::new() });
            }
            unique[slot as usize].members.push(index as u32);
            place.push(slot);
        }
        let mut order: Vec<u32> = (0..unique.len() as u32).collect();
        let mut nodes = Vec::new();
        if !unique.is_empty() {
            build_boxes(&unique, &mut order, 0, &mut nodes);
        }
        Oracle { unique, place, nodes, order }
    }

    /// The closest hit between the ray's limits, both included, both sides of triangles counting.
    pub fn closest(&self, ray: &Ray) -> OracleHit {
        self.closest_with(ray, &QueryOptions::default())
    }

    /// The closest hit with culling and ignoring.
    pub fn closest_with(&self, ray: &Ray, options: &QueryOptions<'_>) -> OracleHit {
        self.summarise(self.crossings(ray, options), ray, options)
    }

    /// The closest hit as accuracy `exact` promises it.
    pub fn nearest(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Nearest> {
        let crossings = self.crossings(ray, options);
        let mut within = crossings.iter().filter(|c| c.is_within(ray));
        let best = within.next()?;
        let tied = within.take_while(|other| other.compare_t(best).is_eq());
        let triangle = tied.fold(best.triangle, |least, other| least.min(other.triangle));
        Some(Nearest { t: best.rounded_t(), triangle })
    }

    /// The same without the boxes, testing every triangle: what checks the boxes.
    pub fn closest_plain(&self, ray: &Ray) -> OracleHit {
        let options = QueryOptions::default();
        let mut found = Vec::new();
        if let Some(valid) = ValidRay::new(ray) {
            for slot in 0..self.unique.len() {
                self.cross(&valid, slot as u32, &options, &mut found);
            }
        }
        self.summarise(found, ray, &options)
    }

    fn summarise(
        &self,
        mut found: Vec<Crossing>,
        ray: &Ray,
        options: &QueryOptions<'_>,
    ) -> OracleHit {
        found.retain(|crossing| crossing.is_within(ray));
        let Some(best) = found.iter().min_by(|a, b| a.compare_t(b)) else {
            return OracleHit::Miss;
        };
        let (mut triangles, mut on_edge) = (Vec::new(), false);
        for crossing in found.iter().filter(|other| other.compare_t(best).is_eq()) {
            let members = &self.unique[crossing.unique as usize].members;
            triangles.extend(members.iter().filter(|&&m| options.ignore != Some(m)));
            on_edge |= crossing.on_edge;
        }
        triangles.sort_unstable();
        OracleHit::Hit { t: best.t, triangles, on_edge }
    }

    /// Everything the whole line through the ray meets, its limits set aside, nearest first. Each
    /// group of triangles with the same corners gives one crossing.
    pub fn crossings(&self, ray: &Ray, options: &QueryOptions<'_>) -> Vec<Crossing> {
        let mut found = self.crossings_unsorted(ray, options);
        found.sort_by(|a, b| a.compare_t(b).then(a.triangle.cmp(&b.triangle)));
        found
    }

    /// The same in no order, which spares exact comparisons of distances.
    pub fn crossings_unsorted(&self, ray: &Ray, options: &QueryOptions<'_>) -> Vec<Crossing> {
        let mut found = Vec::new();
        let Some(valid) = ValidRay::new(ray) else { return found };
        let reciprocal = valid.direction.map(|d| 1.0 / d);
        let mut stack = Vec::with_capacity(64);
        stack.push(0u32);
        while let Some(index) = stack.pop() {
            let Some(node) = self.nodes.get(index as usize) else { continue };
            if !meets_box(&valid, &reciprocal, node) {
                continue;
            }
            if node.count == 0 {
                stack.push(node.first);
                stack.push(index + 1);
            } else {
                let range = node.first as usize..(node.first + node.count) as usize;
                for &slot in &self.order[range] {
                    self.cross(&valid, slot, options, &mut found);
                }
            }
        }
        found
    }

    /// All triangles with the corners of a crossing's, in ascending order.
    pub fn alike(&self, crossing: &Crossing) -> &[u32] {
        &self.unique[crossing.unique as usize].members
    }

    /// Whether the line through the ray passes through the closed triangle.
    pub fn covers(&self, ray: &Ray, triangle: u32) -> bool {
        self.crossing_of(ray, triangle).is_some()
    }

    /// The exact distance at which the line through the ray meets the triangle, rounded.
    pub fn t_of(&self, ray: &Ray, triangle: u32) -> Option<f64> {
        self.crossing_of(ray, triangle).map(|crossing| crossing.t)
    }

    /// Barycentric weights of the second and third corner where the line through the ray meets the
    /// triangle, rounded from exact quotients.
    pub fn weights_of(&self, ray: &Ray, triangle: u32) -> Option<[f64; 2]> {
        self.crossing_of(ray, triangle)?;
        let valid = ValidRay::new(ray)?;
        let corners = &self.unique[self.place[triangle as usize] as usize].corners;
        let [a, b, c] = corners.each_ref().map(|corner| exact_offset(corner, &valid.origin));
        let direction = valid.direction.map(Expansion::from);
        let parts = [(&c, &b), (&a, &c), (&b, &a)].map(|(p, q)| exact_triple(&direction, p, q));
        let sum = parts[0].plus(&parts[1]).plus(&parts[2]).estimate();
        Some([parts[1].estimate() / sum, parts[2].estimate() / sum])
    }

    fn crossing_of(&self, ray: &Ray, triangle: u32) -> Option<Crossing> {
        let valid = ValidRay::new(ray)?;
        let slot = *self.place.get(triangle as usize)?;
        let mut found = Vec::new();
        if slot != u32::MAX {
            self.cross(&valid, slot, &QueryOptions::default(), &mut found);
        }
        found.pop()
    }

    fn cross(
        &self,
        ray: &ValidRay,
        slot: u32,
        options: &QueryOptions<'_>,
        found: &mut Vec<Crossing>,
    ) {
        let Unique { corners, members } = &self.unique[slot as usize];
        let Some(&triangle) = members.iter().find(|&&m| options.ignore != Some(m)) else { return };
        let Some((front, on_edge)) = covers(ray, corners) else { return };
        match options.culling {
            Culling::Back if !front => return,
            Culling::Front if front => return,
            _ => {}
        }
        let exact = OnceCell::new();
        let (t, error) = estimate(ray, corners).unwrap_or_else(|| {
            let (above, below) = exact.get_or_init(|| quotient(ray, corners));
            let t = above.estimate() / below.estimate();
            (t, t.abs() * (8.0 * f64::EPSILON))
        });
        let (unique, ray, corners) = (slot, *ray, *corners);
        found.push(Crossing { triangle, t, front, on_edge, unique, error, ray, corners, exact });
    }
}

/// `d . (p x q)` in `f64`, and a bound of its error. The factors of `p` and `q` are differences with
/// relative error u = 2^-53; products, differences and sums add at most five more, so 7 u times the
/// sum of magnitudes holds to first order, and 16 u leaves room for the rest.
fn triple(d: &[f64; 3], p: &[f64; 3], q: &[f64; 3]) -> (f64, f64) {
    let (mut sum, mut magnitude) = (0.0, 0.0);
    for (i, j, k) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
        let (x, y) = (p[j] * q[k], p[k] * q[j]);
        sum += d[i] * (x - y);
        magnitude += d[i].abs() * (x.abs() + y.abs());
    }
    (sum, magnitude * (8.0 * f64::EPSILON))
}

fn exact_triple(d: &[Expansion; 3], p: &[Expansion; 3], q: &[Expansion; 3]) -> Expansion {
    let mut sum = Expansion::default();
    for (i, j, k) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
        let minor = p[j].times(&q[k]).minus(&p[k].times(&q[j]));
        sum = sum.plus(&minor.times(&d[i]));
    }
    sum
}

fn exact_offset(corner: &[f64; 3], origin: &[f64; 3]) -> [Expansion; 3] {
    [0, 1, 2].map(|axis| Expansion::difference(corner[axis], origin[axis]))
}

/// `Some((front, on_edge))` when the line meets the closed triangle in one point.
fn covers(ray: &ValidRay, corners: &[[f64; 3]; 3]) -> Option<(bool, bool)> {
    let offsets = corners.map(|corner| [0, 1, 2].map(|axis| corner[axis] - ray.origin[axis]));
    let mut signs = [Ordering::Equal; 3];
    let mut decided = [false; 3];
    for edge in 0..3 {
        let (p, q) = (&offsets[(edge + 2) % 3], &offsets[(edge + 1) % 3]);
        let (value, bound) = triple(&ray.direction, p, q);
        if value.abs() > bound {
            signs[edge] = if value > 0.0 { Ordering::Greater } else { Ordering::Less };
            decided[edge] = true;
        }
    }
    let mixed = |signs: &[Ordering; 3]| {
        signs.contains(&Ordering::Greater) && signs.contains(&Ordering::Less)
    };
    if mixed(&signs) {
        return None;
    }
    if decided.contains(&false)
        && let Some(exact) = signs_in_whole_numbers(ray, corners)
    {
        signs = exact;
    } else if decided.contains(&false) {
        let exact = corners.each_ref().map(|corner| exact_offset(corner, &ray.origin));
        let direction = ray.direction.map(Expansion::from);
        for edge in 0..3 {
            if !decided[edge] {
                let (p, q) = (&exact[(edge + 2) % 3], &exact[(edge + 1) % 3]);
                signs[edge] = exact_triple(&direction, p, q).sign();
            }
        }
    }
    // The three values sum to minus n . d, so all zero is a ray in the plane, or no area.
    if mixed(&signs) || signs == [Ordering::Equal; 3] {
        return None;
    }
    Some((signs.contains(&Ordering::Greater), signs.contains(&Ordering::Equal)))
}

/// The exponents of the lowest and of one above the highest bit of any of these; `None` for zeros.
fn span(values: &[f64]) -> Option<(i32, i32)> {
    values.iter().filter(|&&x| x != 0.0).fold(None, |span, x| {
        let (fraction, exponent) =
            (x.to_bits() & ((1 << 52) - 1), (x.to_bits() >> 52) as i32 & 0x7ff);
        // Nothing here is subnormal in `f64`.
        let low = exponent - 1075 + (fraction | 1 << 52).trailing_zeros() as i32;
        let (least, most) = span.unwrap_or((low, exponent - 1022));
        Some((low.min(least), (exponent - 1022).max(most)))
    })
}

/// The signs of the three edge values in 128-bit integers, for rays and corners of which all bits
/// are near enough to one another: much faster than expansions, and most that are aimed exactly are.
fn signs_in_whole_numbers(ray: &ValidRay, corners: &[[f64; 3]; 3]) -> Option<[Ordering; 3]> {
    let mut points = [0.0; 12];
    points[..9].copy_from_slice(corners.as_flattened());
    points[9..].copy_from_slice(&ray.origin);
    let (low, high) = span(&points)?;
    let (direction_low, direction_high) = span(&ray.direction)?;
    // A difference has a bit more; a sum of six products of three factors three more.
    if 2 * (high - low + 1) + (direction_high - direction_low) + 3 > 126 {
        return None;
    }
    let whole = |x: f64, unit: i32| (x * 2f64.powi(-unit)) as i128;
    let direction = ray.direction.map(|x| whole(x, direction_low));
    let origin = ray.origin.map(|x| whole(x, low));
    let offsets = corners.map(|p| [0, 1, 2].map(|axis| whole(p[axis], low) - origin[axis]));
    Some([0, 1, 2].map(|edge| {
        let (p, q) = (&offsets[(edge + 2) % 3], &offsets[(edge + 1) % 3]);
        let parts = [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
            .map(|(i, j, k)| direction[i] * (p[j] * q[k] - p[k] * q[j]));
        parts.iter().sum::<i128>().cmp(&0)
    }))
}

/// The distance by `f64` and a bound of its error, where that is below 2^-40 of it.
fn estimate(ray: &ValidRay, corners: &[[f64; 3]; 3]) -> Option<(f64, f64)> {
    let minus = |p: &[f64; 3], q: &[f64; 3]| [0, 1, 2].map(|axis| p[axis] - q[axis]);
    let [a, b, c] = corners.each_ref().map(|corner| minus(corner, &ray.origin));
    // One more factor is a rounded difference than `triple` counts; its bound has room for it.
    let (above, above_error) = triple(&a, &b, &c);
    let sides = [1, 2].map(|k| minus(&corners[k], &corners[0]));
    let (below, below_error) = triple(&ray.direction, &sides[0], &sides[1]);
    if below.abs() <= 2.0 * below_error {
        return None;
    }
    let t = above / below;
    let error = (above_error + t.abs() * below_error) / (below.abs() - below_error);
    // The roundings of the quotient and of this very bound.
    let error = error * (1.0 + 1e-9) + t.abs() * f64::EPSILON;
    (error <= t.abs() * 2f64.powi(-40)).then_some((t, error))
}

/// `n . a` and `n . d`, with `a` a corner seen from the origin: the distance is their quotient.
fn quotient(ray: &ValidRay, corners: &[[f64; 3]; 3]) -> (Expansion, Expansion) {
    let [a, b, c] = corners.each_ref().map(|corner| exact_offset(corner, &ray.origin));
    let numerator = exact_triple(&a, &b, &c);
    let side = |p: &[f64; 3]| exact_offset(p, &corners[0]);
    let direction = ray.direction.map(Expansion::from);
    let denominator = exact_triple(&direction, &side(&corners[1]), &side(&corners[2]));
    (numerator, denominator)
}

fn build_boxes(unique: &[Unique], order: &mut [u32], first: usize, nodes: &mut Vec<BoxNode>) {
    let (mut lo, mut hi) = ([f64::MAX; 3], [-f64::MAX; 3]);
    let (mut centre_lo, mut centre_hi) = (lo, hi);
    let centre = |slot: u32, axis: usize| {
        unique[slot as usize].corners.iter().map(|corner| corner[axis]).sum::<f64>()
    };
    for &slot in order.iter() {
        for axis in 0..3 {
            for corner in &unique[slot as usize].corners {
                lo[axis] = lo[axis].min(corner[axis]);
                hi[axis] = hi[axis].max(corner[axis]);
            }
            centre_lo[axis] = centre_lo[axis].min(centre(slot, axis));
            centre_hi[axis] = centre_hi[axis].max(centre(slot, axis));
        }
    }
    let here = nodes.len();
    nodes.push(BoxNode { lo, hi, first: first as u32, count: order.len() as u32 });
    if order.len() <= BOX_LEAF {
        return;
    }
    let extent = [0, 1, 2].map(|axis| centre_hi[axis] - centre_lo[axis]);
    let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        centre(a, axis).total_cmp(&centre(b, axis)).then(a.cmp(&b))
    });
    let (left, right) = order.split_at_mut(middle);
    build_boxes(unique, left, first, nodes);
    nodes[here].first = nodes.len() as u32;
    nodes[here].count = 0;
    build_boxes(unique, right, first + middle, nodes);
}

/// Whether the whole line may meet the box. Each slab distance is a product of a rounded difference
/// and a rounded reciprocal, so it errs by less than 2^-51 of itself; widening by 2^-49 is safe.
fn meets_box(ray: &ValidRay, reciprocal: &[f64; 3], node: &BoxNode) -> bool {
    let widen = 8.0 * f64::EPSILON;
    let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..3 {
        let (o, d) = (ray.origin[axis], ray.direction[axis]);
        if d == 0.0 {
            if o < node.lo[axis] || o > node.hi[axis] {
                return false;
            }
            continue;
        }
        let r = reciprocal[axis];
        let (a, b) = ((node.lo[axis] - o) * r, (node.hi[axis] - o) * r);
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        near = near.max(low - low.abs() * widen);
        far = far.min(high + high.abs() * widen);
    }
    near <= far
}

/// Bounds of all finite corners of a mesh, snapped; [`Aabb::EMPTY`] without any.
pub fn finite_bounds(mesh: &Mesh<'_>) -> Aabb {
    (0..mesh.len())
        .map(|index| mesh.triangle(index))
        .filter(|corners| corners.as_flattened().iter().all(|x| x.is_finite()))
        .fold(Aabb::EMPTY, |bounds, corners| {
            bounds.union(&Aabb::of_points(&corners.map(|corner| corner.map(snap))))
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::{aim, scenes};
    use num_bigint::{BigInt, Sign};

    /// A float as an integer multiple of 2^-149, which every `f32` is.
    fn big(value: f64) -> BigInt {
        assert!(value.is_finite());
        if value == 0.0 {
            return BigInt::ZERO;
        }
        let bits = value.to_bits();
        let mantissa = BigInt::from((bits & ((1 << 52) - 1)) | (1 << 52));
        let shift = ((bits >> 52) & 0x7ff) as i32 - 1075 + 149;
        let magnitude: BigInt = if shift >= 0 {
            mantissa << shift.unsigned_abs()
        } else {
            mantissa >> shift.unsigned_abs()
        };
        if value < 0.0 { -magnitude } else { magnitude }
    }

    fn big_triple(d: &[BigInt; 3], p: &[BigInt; 3], q: &[BigInt; 3]) -> BigInt {
        &d[0] * (&p[1] * &q[2] - &p[2] * &q[1])
            + &d[1] * (&p[2] * &q[0] - &p[0] * &q[2])
            + &d[2] * (&p[0] * &q[1] - &p[1] * &q[0])
    }

    fn order(value: &BigInt) -> Ordering {
        match value.sign() {
            Sign::Minus => Ordering::Less,
            Sign::NoSign => Ordering::Equal,
            Sign::Plus => Ordering::Greater,
        }
    }

    fn nasty(random: &mut Random) -> f32 {
        let values =
            [0.0, 1.0, -1.0, 2.0, 0.5, 9.536_743e-7, 1e-30, 1e30, -1e-38, 3e38, 16777216.0];
        match random.below(3) {
            0 => random.pick(&values),
            1 => (random.below(9) as f32 - 4.0) * 0.25,
            _ => f32::from_bits(random.bits() % 0x7f00_0000) * random.pick(&[1.0, -1.0]),
        }
    }

    /// Signs and comparisons of expansions equal those of big integers, on inputs of every size.
    #[test]
    fn expansions_equal_big_integers() {
        let mut random = Random::new(1);
        let mut zeros = 0;
        for round in 0..20_000 {
            let mut take = || [(); 3].map(|()| f64::from(snap(nasty(&mut random))));
            let mut points = [take(), take(), take(), take(), take()];
            if round % 4 == 0 {
                // Provoke zeros: the line through the origin and a corner.
                points[4] = [0, 1, 2].map(|axis| points[1][axis] - points[0][axis]);
                let most = f64::from(f32::MAX);
                points[4] = points[4].map(|x| f64::from(x.clamp(-most, most) as f32));
            }
            let [o, a, b, c, d] = points;
            let expansions = [a, b, c].map(|p| exact_offset(&p, &o));
            let direction = d.map(Expansion::from);
            let offset = |p: &[f64; 3]| [0, 1, 2].map(|i| big(p[i]) - big(o[i]));
            let bigs = [offset(&a), offset(&b), offset(&c)];
            let big_direction = d.map(big);
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                let ours = exact_triple(&direction, &expansions[i], &expansions[j]);
                let theirs = order(&big_triple(&big_direction, &bigs[i], &bigs[j]));
                assert_eq!(ours.sign(), theirs, "{o:?} {a:?} {b:?} {c:?} {d:?}");
                zeros += usize::from(theirs.is_eq());
                let plain = [a, b, c].map(|p| [0, 1, 2].map(|x| p[x] - o[x]));
                let (value, bound) = triple(&d, &plain[i], &plain[j]);
                if value.abs() > bound {
                    assert_eq!(value.partial_cmp(&0.0), Some(theirs), "the filter lies");
                }
            }
            // The comparison of two distances, as numerators and denominators.
            let one = exact_triple(&expansions[0], &expansions[1], &expansions[2]);
            let two = exact_triple(&direction, &expansions[1], &expansions[2]);
            let big_one = big_triple(&bigs[0], &bigs[1], &bigs[2]);
            let big_two = big_triple(&big_direction, &bigs[1], &bigs[2]);
            let ours = one.times(&two).minus(&two.times(&two)).sign();
            assert_eq!(ours, order(&(&big_one * &big_two - &big_two * &big_two)));
        }
        assert!(zeros > 1000, "only {zeros} zeros: the exact branch was hardly tried");
    }

    /// The boxes never hide a triangle from a ray.
    #[test]
    fn boxes_equal_plain_brute_force() {
        let mut hits = 0;
        for scene in [
            scenes::soup(700, 0.2, 3),
            scenes::sphere(8, [1e3, 1e3, 1e3], 2.0),
            scenes::grid_boxes(3),
            scenes::coplanar(1, 200),
            scenes::scaled(&scenes::soup(300, 0.3, 5), 1e-30, "tiny"),
            scenes::scaled(&scenes::soup(300, 0.3, 6), 1e30, "huge"),
        ] {
            let mesh = scene.mesh();
            let oracle = Oracle::new(&mesh);
            for kind in aim::Kind::ALL {
                for ray in aim::rays(&mesh, kind, 60, 17) {
                    let answer = oracle.closest(&ray);
                    assert_eq!(answer, oracle.closest_plain(&ray), "{} {ray:?}", scene.name);
                    hits += usize::from(answer != OracleHit::Miss);
                }
            }
        }
        assert!(hits > 500, "{hits}");
    }

    /// A case small enough to work out by hand.
    #[test]
    fn a_square_in_two_triangles() {
        let positions = [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 2.0, 1.0], [0.0, 2.0, 1.0]];
        let mesh = Mesh::indexed(&positions, &[[0, 1, 2], [0, 2, 3], [0, 1, 1]]).unwrap();
        let oracle = Oracle::new(&mesh);
        let on_diagonal = Ray::new([1.0, 1.0, 3.0], [0.0, 0.0, -2.0]);
        let both = OracleHit::Hit { t: 1.0, triangles: vec![0, 1], on_edge: true };
        assert_eq!(oracle.closest(&on_diagonal), both);
        assert_eq!(oracle.closest(&on_diagonal.with_limits(1.0, 1.0)), both);
        let beyond = on_diagonal.with_limits(1.0f32.next_up(), 9.0);
        assert_eq!(oracle.closest(&beyond), OracleHit::Miss);
        let inside = Ray::new([1.5, 1.0, 3.0], [0.0, 0.0, -1.0]);
        let first = OracleHit::Hit { t: 2.0, triangles: vec![0], on_edge: false };
        assert_eq!(oracle.closest(&inside), first);
        let back = QueryOptions { culling: Culling::Front, ..Default::default() };
        assert_eq!(oracle.closest_with(&inside, &back), OracleHit::Miss);
        let in_plane = Ray::new([-1.0, 1.0, 1.0], [1.0, 0.0, 0.0]);
        assert_eq!(oracle.closest(&in_plane), OracleHit::Miss);
    }
}
