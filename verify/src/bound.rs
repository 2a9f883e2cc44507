//! How far an answer in f32 may be from the answer.

use super::reference::{Hit64, Ray64};
use splitplane_core::ray::Hit;

type Point = [f64; 3];

/// The error that a triangle test in f32 may make on one triangle and one ray.
#[derive(Clone, Copy, Debug)]
pub struct Bound {
    /// Across the ray, in units of the scene.
    pub across: f64,
    /// Along the ray, in units of `t`.
    pub along: f64,
    corners: [Point; 3],
    length: f64,
    /// Twice the area that the ray sees.
    facing: f64,
}

impl Bound {
    pub fn new(ray: &Ray64, corners: [[f32; 3]; 3]) -> Bound {
        let corners = corners.map(|corner| corner.map(f64::from));
        let length = dot(ray.direction, ray.direction).sqrt();
        let unit = ray.direction.map(|x| x / length);
        let [a, b, c] = corners.map(|corner| sub(corner, ray.origin));
        let reach = [a, b, c].as_flattened().iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let across = reach / f64::from(1 << 20);
        let normal = cross(sub(b, a), sub(c, a));
        let facing = dot(normal, unit);
        let slant = (dot(normal, normal) - facing * facing).max(0.0).sqrt() / facing.abs();
        // However slanted, a hit stays between the nearest and the farthest corner.
        let depths = [a, b, c].map(|corner| dot(corner, unit));
        let range = depths.iter().fold(f64::NEG_INFINITY, |m, x| m.max(*x))
            - depths.iter().fold(f64::INFINITY, |m, x| m.min(*x));
        // A NaN slant belongs to a triangle without area: min takes the range then.
        let along = ((across * slant).min(range) + across) / length;
        Bound { across, along, corners, length, facing }
    }

    /// Whether the hit's `t`, `u` and `v` mean the same point.
    pub fn holds(&self, ray: &Ray64, hit: &Hit) -> bool {
        let (u, v) = (f64::from(hit.u), f64::from(hit.v));
        let within = u >= 0.0 && v >= 0.0 && u + v <= 1.0 + 1e-6;
        if !within || !hit.t.is_finite() {
            return false;
        }
        let t = f64::from(hit.t);
        let on_triangle = self.point(hit);
        let [a, b, c] = self.corners;
        let on_ray: Point = std::array::from_fn(|k| ray.origin[k] + t * ray.direction[k]);
        let apart = sub(on_triangle, on_ray);
        // Seen from its edge, a triangle's weights say little about the place: an error across the
        // ray moves the point by that times (longest side)^2 over the area seen, and at most by the
        // side itself.
        let side =
            [sub(b, a), sub(c, b), sub(a, c)].map(|s| dot(s, s)).into_iter().fold(0.0, f64::max);
        let weights = (self.across * side / self.facing.abs()).min(side.sqrt());
        let allowed = 4.0 * (self.across + self.along * self.length + weights);
        dot(apart, apart).sqrt() <= allowed
    }

    /// Whether the ray passes within the bound of the point that the hit's weights mean.
    pub fn touches(&self, ray: &Ray64, hit: &Hit) -> bool {
        let from_origin = sub(self.point(hit), ray.origin);
        let unit = ray.direction.map(|x| x / self.length);
        let aside = cross(from_origin, unit);
        dot(aside, aside).sqrt() <= self.across
    }

    fn point(&self, hit: &Hit) -> Point {
        let (u, v) = (f64::from(hit.u), f64::from(hit.v));
        let [a, b, c] = self.corners;
        std::array::from_fn(|k| a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]))
    }
}

/// The edges of a triangle that pass, as the ray sees them, within `distance` of a hit on it.
pub fn edges_within(
    ray: &Ray64,
    hit: &Hit64,
    corners: [[f32; 3]; 3],
    distance: f64,
) -> Vec<[[f32; 3]; 2]> {
    let unit = normalize(ray.direction);
    let point: Point = std::array::from_fn(|k| ray.origin[k] + hit.t * ray.direction[k]);
    let flat = |corner: [f32; 3]| {
        let from_hit = sub(corner.map(f64::from), point);
        let depth = dot(from_hit, unit);
        std::array::from_fn::<f64, 3, _>(|k| from_hit[k] - depth * unit[k])
    };
    let edges = [[corners[0], corners[1]], [corners[1], corners[2]], [corners[2], corners[0]]];
    let close = |[a, b]: &[[f32; 3]; 2]| {
        let along = sub(flat(*b), flat(*a));
        let area = cross(along, flat(*a));
        dot(area, area) <= distance * distance * dot(along, along)
    };
    edges.into_iter().filter(close).collect()
}

/// Rays parallel to the given one, on rings around it: each a third of the one before, since cracks
/// between triangles that share no vertex may be much narrower than the distance.
pub fn rings(ray: &Ray64, distance: f64) -> impl Iterator<Item = Ray64> {
    const RINGS: u32 = 7;
    const AROUND: u32 = 12;
    let ray = *ray;
    let d = ray.direction;
    let least = (0..3).fold(0, |best, k| if d[k].abs() < d[best].abs() { k } else { best });
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let p = normalize(cross(d, axis));
    let q = normalize(cross(d, p));
    (0..RINGS * AROUND).map(move |i| {
        let turns = f64::from(i) / f64::from(AROUND) + 0.37 * f64::from(i / AROUND);
        let (sin, cos) = (turns * std::f64::consts::TAU).sin_cos();
        let radius = distance / f64::from(3u32.pow(i / AROUND));
        let origin = std::array::from_fn(|k| ray.origin[k] + radius * (cos * p[k] + sin * q[k]));
        Ray64 { origin, ..ray }
    })
}

pub(super) fn sub(a: Point, b: Point) -> Point {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn normalize(a: Point) -> Point {
    let length = dot(a, a).sqrt();
    a.map(|x| x / length)
}
