//! The plane of a triangle, and how far off it the rays start that leave it. Twin of `plane.wgsl`
//! and `surface.wgsl`.

use crate::layout::Surface;
use crate::vector::{Vector, add, cross, exponent, greatest, power_of_two, reach, scaled, sub};
use splitplane_core::triangle::Triangle;

/// In units of 2^-24 of the greatest coordinate of a triangle's corners: how far off its plane a ray
/// starts that leaves it. Rounding the point moves it by less than 8 of them, and a triangle test errs
/// by a few units of the distance from the start to the corners.
const OFFSET_UNITS: f32 = 64.0;
/// Half a unit in the last place of 1.
const UNIT: f32 = 1.0 / 16_777_216.0;

/// A triangle's edges, brought near 1 by a power of two, and its unit normal.
#[derive(Clone, Copy)]
pub(crate) struct Plane {
    pub(crate) edges: [Vector; 2],
    /// The cross product of the edges, each times the power of two.
    pub(crate) scaled_normal: Vector,
    /// The power of two is two to this.
    pub(crate) power: i32,
    /// How far off the plane a new ray must start.
    pub(crate) offset: f32,
}

impl Plane {
    /// No plane: one without area.
    pub(crate) const NONE: Plane =
        Plane { edges: [[0.0; 3]; 2], scaled_normal: [0.0; 3], power: 0, offset: 0.0 };

    #[inline]
    pub(crate) fn of(corners: &Triangle) -> Plane {
        let [a, b, c] = *corners;
        let edges = [sub(b, a), sub(c, a)];
        let [first, second] = edges.map(reach);
        let power = -exponent(if second > first { second } else { first });
        let factor = power_of_two(power);
        let scaled_normal = cross(scaled(edges[0], factor), scaled(edges[1], factor));
        let [x, y, z] = [reach(a), reach(b), reach(c)];
        Plane { edges, scaled_normal, power, offset: 0.0 }.within_reach(greatest([x, y, z]))
    }

    /// The same plane, where what went into the corners was of this magnitude.
    #[inline]
    pub(crate) fn within_reach(self, reach: f32) -> Plane {
        Plane { offset: reach * (OFFSET_UNITS * UNIT), ..self }
    }
}

/// The start of a ray that leaves the surface: on the side that the path came from (1) or behind
/// (-1), off the triangle by more than all rounding, so that it does not meet it again.
pub(crate) fn start(surface: &Surface, side: f32) -> Vector {
    add(surface.point, scaled(surface.geometric_normal, surface.offset * side))
}
