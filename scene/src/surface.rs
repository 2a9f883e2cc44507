//! Where a ray meets a surface, and where the next ray may start from.

use glam::DVec3;
use splitplane_core::ray::Hit;
use splitplane_float_state::standard;

/// A point on a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// The point, from the corners and the hit's weights: it lies in the triangle's plane to within
    /// f64, whatever the error of `t`.
    pub point: DVec3,
    /// Unit normal on the side that was asked for.
    pub normal: DVec3,
    /// How far off the plane a new ray must start.
    offset: f64,
}

impl Surface {
    /// The point of a hit, its normal turned against `direction`. `None` for a triangle without
    /// area, which has no normal.
    pub fn new(corners: [[f32; 3]; 3], hit: &Hit, direction: [f32; 3]) -> Option<Surface> {
        standard(|| {
            let [a, b, c] = corners.map(|p| DVec3::from_array(p.map(f64::from)));
            let (u, v) = (f64::from(hit.u), f64::from(hit.v));
            let point = a + (b - a) * u + (c - a) * v;
            let mut normal = (b - a).cross(c - a).try_normalize()?;
            if normal.dot(DVec3::from_array(direction.map(f64::from))) > 0.0 {
                normal = -normal;
            }
            // Rounding the start to f32 moves it by half a unit in the last place of its coordinates;
            // a triangle test errs by a few units of the distance from the start to the corners. Both
            // are below some units of the greatest coordinate of the corners; 32 of them are ample.
            let reach = [a, b, c].map(|p| p.abs().max_element()).into_iter().fold(0.0, f64::max);
            Some(Surface { point, normal, offset: 32.0 * f64::from(f32::EPSILON) * reach })
        })
    }

    /// Where a ray that leaves this side of the surface starts: off the plane by more than the
    /// rounding of its own coordinates and of the triangle test, so that it does not meet the
    /// triangle it leaves.
    pub fn start(&self) -> [f32; 3] {
        standard(|| (self.point + self.normal * self.offset).as_vec3().to_array())
    }
}
