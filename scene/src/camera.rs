//! A pinhole camera.

use glam::DVec3;
use splitplane_core::ray::Ray;
use splitplane_float_state::standard;
use std::ops::Range;
use thiserror::Error;

/// A pinhole camera. Its rays start at the eye and go through pixel centres, row by row from the
/// top left; their directions have length 1, so `t` is a distance in units of the scene.
///
/// Everything is computed in f64 and rounded to f32 once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    eye: DVec3,
    look_at: DVec3,
    up: DVec3,
    fov_degrees: f64,
}

/// Why values are not a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CameraError {
    /// A coordinate is NaN or infinite.
    #[error("the camera has a coordinate that is not a finite number")]
    NotFinite,
    /// The eye is where it looks.
    #[error("the camera's eye and the point it looks at are the same; move one of them")]
    NoDirection,
    /// The up direction has no length.
    #[error("the camera's up direction is zero; give one such as 0,1,0")]
    NoUp,
    /// The field of view is not an angle a pinhole can have.
    #[error("the field of view must be more than 0 and less than 180 degrees")]
    FieldOfView,
}

/// The camera's axes: unit right, up and forward.
#[derive(Clone, Copy, Debug)]
struct Frame {
    right: DVec3,
    up: DVec3,
    forward: DVec3,
}

impl Camera {
    /// A camera at `eye` that looks at `look_at`. `up` need not be perpendicular to the view nor
    /// have length 1; when it is parallel to the view, an axis takes its place. `fov_degrees` is
    /// the angle from the bottom of the picture to its top.
    ///
    /// # Errors
    /// Values that are not finite, no direction to look in, no up, or an angle not in (0, 180).
    pub fn new(
        eye: [f32; 3],
        look_at: [f32; 3],
        up: [f32; 3],
        fov_degrees: f32,
    ) -> Result<Camera, CameraError> {
        standard(|| {
            let [eye, look_at, up] =
                [eye, look_at, up].map(|v| DVec3::from_array(v.map(f64::from)));
            if !(eye.is_finite() && look_at.is_finite() && up.is_finite()) {
                return Err(CameraError::NotFinite);
            }
            if eye == look_at {
                return Err(CameraError::NoDirection);
            }
            if up == DVec3::ZERO {
                return Err(CameraError::NoUp);
            }
            if !(fov_degrees > 0.0 && fov_degrees < 180.0) {
                return Err(CameraError::FieldOfView);
            }
            Ok(Camera { eye, look_at, up, fov_degrees: f64::from(fov_degrees) })
        })
    }

    /// Where the rays start.
    pub fn eye(&self) -> [f32; 3] {
        self.eye.as_vec3().to_array()
    }

    /// The point in the middle of the picture.
    pub fn look_at(&self) -> [f32; 3] {
        self.look_at.as_vec3().to_array()
    }

    /// The direction that points up in the picture, as given.
    pub fn up(&self) -> [f32; 3] {
        self.up.as_vec3().to_array()
    }

    /// Angle from the bottom of the picture to its top, in degrees.
    pub fn fov_degrees(&self) -> f32 {
        self.fov_degrees as f32
    }

    /// Unit vectors to the right and upwards in the picture.
    pub fn picture_axes(&self) -> [[f32; 3]; 2] {
        standard(|| {
            let frame = self.frame();
            [frame.right, frame.up].map(|v| v.as_vec3().to_array())
        })
    }

    fn frame(&self) -> Frame {
        let forward = (self.look_at - self.eye).normalize();
        let mut side = forward.cross(self.up.normalize());
        if side.length_squared() < 1e-12 {
            // Looking along `up`: the axis that leans least on the view serves as well.
            let axes = [DVec3::Z, DVec3::X, DVec3::Y];
            let other = axes.into_iter().find(|axis| axis.dot(forward).abs() < 0.8);
            side = forward.cross(other.unwrap_or(DVec3::X));
        }
        let right = side.normalize();
        Frame { right, up: right.cross(forward), forward }
    }

    /// The rays of some rows of a picture of `width` by `height` pixels, from the left end of the
    /// first row on. Rows outside the picture are rays outside the view, not an error.
    pub fn rows(&self, width: u32, height: u32, rows: Range<u32>) -> Vec<Ray> {
        standard(|| {
            let centres = rows
                .flat_map(|y| (0..width).map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]));
            self.through(width, height, centres)
        })
    }

    /// The rays through points of a picture of `width` by `height` pixels: `[0.0, 0.0]` is its top
    /// left corner, `[0.5, 0.5]` the centre of its first pixel.
    pub fn through(
        &self,
        width: u32,
        height: u32,
        points: impl IntoIterator<Item = [f64; 2]>,
    ) -> Vec<Ray> {
        standard(|| {
            let frame = self.frame();
            let tan = (0.5 * self.fov_degrees.to_radians()).tan();
            let (w, h) = (f64::from(width), f64::from(height));
            let eye = self.eye();
            let ray = |[x, y]: [f64; 2]| {
                let u = (2.0 * x - w) / h * tan;
                let v = (h - 2.0 * y) / h * tan;
                let direction = (frame.forward + frame.right * u + frame.up * v).normalize();
                Ray::new(eye, direction.as_vec3().to_array())
            };
            points.into_iter().map(ray).collect()
        })
    }

    /// The camera as frames of this size take it.
    pub fn pinhole(&self, size: splitplane_render::Size) -> splitplane_render::Pinhole {
        standard(|| {
            let frame = self.frame();
            let tan = (0.5 * self.fov_degrees.to_radians()).tan();
            let (w, h) = (f64::from(size.width()), f64::from(size.height()));
            let step = 2.0 * tan / h;
            let corner = frame.forward - frame.right * (0.5 * w * step) + frame.up * tan;
            splitplane_render::Pinhole {
                eye: self.eye(),
                corner: corner.as_vec3().to_array(),
                step_x: (frame.right * step).as_vec3().to_array(),
                step_y: (frame.up * -step).as_vec3().to_array(),
            }
        })
    }

    /// All rays of a picture of `width` by `height` pixels, row by row from the top left.
    pub fn rays(&self, width: u32, height: u32) -> Vec<Ray> {
        standard(|| self.rows(width, height, 0..height))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::new([0.0, 0.0, 5.0], [0.0; 3], [0.0, 1.0, 0.0], 90.0).unwrap()
    }

    /// Rays take the vectors of glam as they are.
    #[test]
    fn rays_are_made_of_vectors() {
        use glam::Vec3;
        use splitplane_core::ray::Ray;

        let (a, b) = (Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 6.0, 8.0));
        assert_eq!(Ray::new(a, b), Ray::new([1.0, 2.0, 3.0], [4.0, 6.0, 8.0]));
        assert_eq!(Ray::segment(a, b), Ray::new(a, b - a).with_limits(0.0, 1.0));
    }

    #[test]
    fn the_first_ray_is_the_top_left_pixel() {
        let rays = camera().rays(4, 2);
        assert_eq!(rays.len(), 8);
        let first = rays[0].direction;
        assert!(first[0] < 0.0 && first[1] > 0.0 && first[2] < 0.0, "{first:?}");
        // Half a picture high is tan 45 = 1, so the pixel centre is at (-1.5, 0.5, -1).
        let length = (1.5f32 * 1.5 + 0.5 * 0.5 + 1.0).sqrt();
        for (got, want) in first.into_iter().zip([-1.5 / length, 0.5 / length, -1.0 / length]) {
            assert!((got - want).abs() < 1e-6);
        }
        assert!(rays[7].direction[0] > 0.0 && rays[7].direction[1] < 0.0);
    }

    #[test]
    fn rows_are_slices_of_the_whole() {
        let camera = camera();
        assert_eq!(camera.rows(5, 7, 2..4), camera.rays(5, 7)[10..20]);
    }

    #[test]
    fn bad_values_are_refused_and_straight_down_is_fine() {
        let up = [0.0, 1.0, 0.0];
        assert_eq!(Camera::new([1.0; 3], [1.0; 3], up, 40.0), Err(CameraError::NoDirection));
        assert_eq!(Camera::new([1.0; 3], [0.0; 3], [0.0; 3], 40.0), Err(CameraError::NoUp));
        assert_eq!(Camera::new([f32::NAN; 3], [0.0; 3], up, 40.0), Err(CameraError::NotFinite));
        for fov in [0.0, 180.0, f32::NAN] {
            assert_eq!(Camera::new([1.0; 3], [0.0; 3], up, fov), Err(CameraError::FieldOfView));
        }
        let down = Camera::new([0.0, 9.0, 0.0], [0.0; 3], up, 40.0).unwrap();
        assert!(down.rays(3, 3).iter().all(|ray| ray.direction.iter().all(|c| c.is_finite())));
    }
}
