//! Seeded surfaces and rays that run along them: in the planes of triangles, along edges, from corner to corner,
//! and from inside closed surfaces past their own faces. Where a ray lies in the plane of a triangle, rounding
//! decides whether and where it meets it, and answers that depend on more than ray and mesh come apart.

mod rays;
mod shapes;

pub use rays::{Grazer, Kind, Volley};
pub use shapes::{Shape, Surface};

use crate::random::Random;

pub(crate) fn minus(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| p[k] - q[k])
}

pub(crate) fn dot(p: [f64; 3], q: [f64; 3]) -> f64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

pub(crate) fn cross(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
}

pub(crate) fn length(p: [f64; 3]) -> f64 {
    dot(p, p).sqrt()
}

/// `p + s (q - p)`.
fn between(p: [f64; 3], q: [f64; 3], s: f64) -> [f64; 3] {
    [0, 1, 2].map(|k| p[k] + s * (q[k] - p[k]))
}

/// The point of these weights.
pub(crate) fn weighted(corners: &[[f64; 3]; 3], weights: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| (0..3).map(|i| weights[i] * corners[i][k]).sum())
}

/// The square of the distance of a point from a triangle (Ericson 2005, section 5.1.5).
pub(crate) fn squared_distance(point: [f64; 3], [a, b, c]: &[[f64; 3]; 3]) -> f64 {
    let (ab, ac, ap) = (minus(*b, *a), minus(*c, *a), minus(point, *a));
    let normal = cross(ab, ac);
    let area = dot(normal, normal);
    if area > 0.0 {
        let (u, v) = (dot(cross(ap, ac), normal) / area, dot(cross(ab, ap), normal) / area);
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
            let height = dot(ap, normal);
            return height * height / area;
        }
    }
    let from_edge = |p: [f64; 3], q: [f64; 3]| {
        let (edge, way) = (minus(q, p), minus(point, p));
        let along = dot(edge, edge);
        let s = if along > 0.0 { (dot(way, edge) / along).clamp(0.0, 1.0) } else { 0.0 };
        let apart = minus(point, between(p, q, s));
        dot(apart, apart)
    };
    from_edge(*a, *b).min(from_edge(*b, *c)).min(from_edge(*c, *a))
}

/// How often closed surfaces go around a point, by the sum of solid angles (Van Oosterom and Strackee 1983).
pub(crate) fn winding(point: [f64; 3], triangles: &[[[f64; 3]; 3]]) -> i32 {
    let mut sum = 0.0;
    for corners in triangles {
        let [a, b, c] = corners.map(|corner| minus(corner, point));
        let (la, lb, lc) = (length(a), length(b), length(c));
        let above = dot(a, cross(b, c));
        let below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
        sum += 2.0 * above.atan2(below);
    }
    (sum / (4.0 * std::f64::consts::PI)).round() as i32
}

/// A random rotation, by a random unit quaternion.
fn rotation(random: &mut Random) -> [[f64; 3]; 3] {
    let [x, y, z] = random.direction();
    let turn = random.unit();
    let (cos, sin) = crate::scenes::cos_sin(std::f64::consts::PI * turn);
    let (w, [x, y, z]) = (cos, [x, y, z].map(|k| k * sin));
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_and_windings() {
        let triangle = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        assert_eq!(squared_distance([0.5, 0.5, 3.0], &triangle), 9.0);
        assert_eq!(squared_distance([-3.0, 1.0, 4.0], &triangle), 25.0);
        assert_eq!(squared_distance([5.0, 0.0, 4.0], &triangle), 25.0);
        let surface = Surface::new(Shape::Shells, 1);
        let corners = surface.corners();
        let middle: [f64; 3] = [0, 1, 2].map(|k| {
            corners.as_flattened().iter().map(|corner| corner[k]).sum::<f64>()
                / (3 * corners.len()) as f64
        });
        assert!(winding(middle, &corners) > 1);
        assert_eq!(winding(middle.map(|x| x + 10.0 * surface.extent), &corners), 0);
    }
}
