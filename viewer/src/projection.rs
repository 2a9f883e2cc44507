//! From points of the scene to points of the picture.

use glam::DVec3;
use splitplane::scene::Camera;

/// A camera's view of the scene: lines are clipped to what it sees, then projected.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projection {
    eye: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    /// Half the picture's width and height at distance 1.
    half: [f64; 2],
    /// Nothing nearer than this is drawn.
    near: f64,
}

impl Projection {
    /// The view of a picture of this shape. `near` is more than 0.
    pub(super) fn new(camera: &Camera, aspect: f64, near: f64) -> Projection {
        let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let [right, up] = camera.picture_axes().map(vector);
        let tan = (0.5 * f64::from(camera.fov_degrees()).to_radians()).tan();
        Projection {
            eye: vector(camera.eye()),
            right,
            up,
            forward: up.cross(right),
            half: [tan * aspect, tan],
            near,
        }
    }

    /// The part of a line that is in the picture, as points from [0, 0] at the top left to [1, 1] at
    /// the bottom right.
    pub(super) fn line(&self, a: [f32; 3], b: [f32; 3]) -> Option<[[f64; 2]; 2]> {
        let [a, b] = [a, b].map(|point| self.towards(point));
        // The line is a + t (b - a); each side of the view leaves an interval of t.
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for (at_a, at_b) in self.inside(a).into_iter().zip(self.inside(b)) {
            if at_a < 0.0 && at_b < 0.0 {
                return None;
            }
            let t = at_a / (at_a - at_b);
            if at_a < 0.0 {
                from = from.max(t);
            } else if at_b < 0.0 {
                to = to.min(t);
            }
        }
        let seen = from <= to;
        seen.then(|| [from, to].map(|t| self.project(a + (b - a) * t)))
    }

    /// A point along the camera's axes.
    fn towards(&self, point: [f32; 3]) -> DVec3 {
        let to = DVec3::from_array(point.map(f64::from)) - self.eye;
        DVec3::new(to.dot(self.right), to.dot(self.up), to.dot(self.forward))
    }

    /// How far inside each of the five sides of the view a point is; negative outside.
    fn inside(&self, p: DVec3) -> [f64; 5] {
        let [x, y] = self.half.map(|half| half * p.z);
        [p.z - self.near, x - p.x, x + p.x, y - p.y, y + p.y]
    }

    fn project(&self, p: DVec3) -> [f64; 2] {
        let z = p.z.max(self.near);
        [0.5 + 0.5 * p.x / (self.half[0] * z), 0.5 - 0.5 * p.y / (self.half[1] * z)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn projection() -> Projection {
        let camera = Camera::new([0.0, 0.0, 5.0], [0.0; 3], [0.0, 1.0, 0.0], 90.0).unwrap();
        Projection::new(&camera, 2.0, 0.01)
    }

    fn close(a: [f64; 2], b: [f64; 2]) -> bool {
        (a[0] - b[0]).abs() < 1e-6 && (a[1] - b[1]).abs() < 1e-6
    }

    #[test]
    fn the_ray_through_a_pixel_goes_where_the_pixel_is() {
        let camera = Camera::new([1.0, 2.0, 3.0], [0.3, -1.0, 0.2], [0.1, 1.0, 0.0], 50.0).unwrap();
        let projection = Projection::new(&camera, 4.0 / 3.0, 1e-3);
        let rays = camera.rays(4, 3);
        for (index, ray) in rays.iter().enumerate() {
            let at = |t: f32| [0, 1, 2].map(|axis| ray.origin[axis] + t * ray.direction[axis]);
            let [a, b] = projection.line(at(1.0), at(7.0)).unwrap();
            let pixel = [(index % 4) as f64, (index / 4) as f64];
            let centre = [(pixel[0] + 0.5) / 4.0, (pixel[1] + 0.5) / 3.0];
            assert!(close(a, centre) && close(b, centre), "{a:?} {b:?} {centre:?}");
        }
    }

    #[test]
    fn lines_are_cut_at_the_eye_and_at_the_sides() {
        let projection = projection();
        let [a, b] = projection.line([0.0; 3], [0.0, 0.0, 50.0]).unwrap();
        assert!(close(a, [0.5, 0.5]) && close(b, [0.5, 0.5]));
        assert_eq!(projection.line([0.0, 0.0, 6.0], [0.0, 0.0, 50.0]), None);
        let [a, b] = projection.line([-1e9, 0.0, 0.0], [1e9, 0.0, 0.0]).unwrap();
        assert!(close(a, [0.0, 0.5]) && close(b, [1.0, 0.5]), "{a:?} {b:?}");
        assert_eq!(projection.line([0.0, 9.0, 0.0], [3.0, 9.0, 0.0]), None);
        let [a, b] = projection.line([0.0, -1.0, -5.0], [0.0, 1.0, 5.1]).unwrap();
        assert!(a.into_iter().chain(b).all(|x| (-1e-9..=1.0 + 1e-9).contains(&x)), "{a:?} {b:?}");
    }
}
