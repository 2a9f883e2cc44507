//! Rays for tests of scenes.

use splitplane_core::ray::Ray;

/// Rays that hit nothing, whatever there is, or that are odd otherwise.
pub(crate) fn odd(rays: &[Ray]) -> Vec<Ray> {
    let [nan, infinite] = [f32::NAN, f32::INFINITY];
    let change = |(i, ray): (usize, &Ray)| match i % 9 {
        0 => Ray::new([nan, 0.0, 0.0], ray.direction),
        1 => Ray::new(ray.origin, [0.0, infinite, 1.0]),
        2 => Ray::new(ray.origin, [0.0, -0.0, 0.0]),
        3 => ray.with_limits(1.0, 0.5),
        4 => ray.with_limits(nan, 1.0),
        5 => ray.with_limits(-infinite, -0.0),
        6 => Ray::new(ray.origin.map(|x| x + 1e19), ray.direction),
        7 => Ray::new(ray.origin, ray.direction.map(|x| x * 1e20)),
        _ => Ray::new(ray.origin, ray.direction.map(|x| x * 1e-20)),
    };
    rays.iter().enumerate().map(change).collect()
}
