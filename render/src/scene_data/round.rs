//! Where rays meet shapes: spheres, capsules and those of the user's own, which have no corners.

use splitplane_core::ray::{Hit, Ray};
use splitplane_core::scene::Transform;
use splitplane_core::scene::shape::{SHAPE_SLACK, Shapes};

/// A place on a shape, in the world.
pub(crate) struct RoundPlace {
    pub(crate) point: [f32; 3],
    /// Outwards, of length 1; zero where the shape has no direction there.
    pub(crate) normal: [f32; 3],
    /// How far off the surface a new ray must start.
    pub(crate) offset: f32,
}

/// An instance's ways between its space and the world.
pub(super) struct Ways<'a> {
    pub(super) transform: &'a Transform,
    /// From the world to the object.
    pub(super) inverse: &'a Transform,
    /// How much larger roundings in the object's space are in the world.
    pub(super) stretch: f32,
}

/// Roundings of the point and of a ray's way into the object's space, in units of 2^-24 of what goes into them: as for triangles.
const UNITS: f64 = 64.0 / 16_777_216.0;

/// The place of a hit on a primitive of an instance's shapes.
///
/// It is computed in `f64`, by sums and products in this order and square roots, and rounded once. The ray's point in the object's space is
/// brought onto the sphere or capsule along its normal `n`, so it is as near to the surface as `f64` can tell. A ray
/// that starts there must be farther from the surface than the test of it errs, `e` in the object's space ([`SHAPE_SLACK`]). An offset `h` along
/// the world's normal, `M^T n` over its length, M the inverse, moves by `h |M^T n|` along `n`. So `h` is `e / |M^T n|`.
pub(super) fn place(shapes: &Shapes, ways: &Ways<'_>, ray: &Ray, hit: &Hit) -> RoundPlace {
    let inverse = ways.inverse.map(|row| row.map(f64::from));
    let t = f64::from(hit.t);
    let [origin, direction] = [ray.origin, ray.direction].map(|x| x.map(f64::from));
    let met = [0, 1, 2].map(|k| {
        let [a, b, c, d] = inverse[k];
        let from = ((a * origin[0] + b * origin[1]) + c * origin[2]) + d;
        from + t * ((a * direction[0] + b * direction[1]) + c * direction[2])
    });
    let primitive = hit.triangle as usize;
    let axis = match shapes {
        Shapes::Spheres(all) => {
            all.get(primitive).map(|own| (own.centre.map(f64::from), f64::from(own.radius)))
        }
        Shapes::Capsules(all) => all.get(primitive).map(|own| {
            let [a, b] = own.ends.map(|end| end.map(f64::from));
            let along = f64::from(hit.u);
            ([0, 1, 2].map(|k| a[k] + along * (b[k] - a[k])), f64::from(own.radius))
        }),
        Shapes::Own(_) => None,
    };
    let (outwards, local) = match axis {
        Some((centre, radius)) => {
            let out = unit([0, 1, 2].map(|k| met[k] - centre[k]));
            (out, [0, 1, 2].map(|k| centre[k] + radius * out[k]))
        }
        None => {
            let point = met.map(|x| x as f32);
            (unit(shapes.normal(hit.triangle, point, hit.u, hit.v).map(f64::from)), met)
        }
    };
    // Through the inverse's transpose, which keeps outside what is outside, under reflections too.
    let normal = [0, 1, 2].map(|k| {
        let [a, b, c] = [inverse[0][k], inverse[1][k], inverse[2][k]];
        (a * outwards[0] + b * outwards[1]) + c * outwards[2]
    });
    let (mut point, mut reach) = ([0.0; 3], 0.0f64);
    for (to, row) in point.iter_mut().zip(ways.transform) {
        let [a, b, c, d] = row.map(f64::from);
        let parts = [a * local[0], b * local[1], c * local[2], d];
        *to = (((parts[0] + parts[1]) + parts[2]) + parts[3]) as f32;
        reach = reach.max(parts.iter().map(|part| part.abs()).sum());
    }
    let bounds = shapes.bounds(hit.triangle);
    // The greatest coordinate of the primitive's box and its extent, each for the origin of the next ray too.
    let size = bounds.map_or(0.0, |own| {
        let ends = (0..3).map(|k| (f64::from(own.lo[k]), f64::from(own.hi[k])));
        let sizes = ends.map(|(lo, hi)| lo.abs().max(hi.abs()) + (hi - lo));
        2.0 * sizes.fold(0.0, f64::max)
    });
    let stretched = length(normal);
    let within = if stretched > 0.0 { SHAPE_SLACK * size / stretched } else { 0.0 };
    let offset = within + reach * f64::from(ways.stretch) * UNITS;
    RoundPlace { point, normal: unit(normal).map(|x| x as f32), offset: offset as f32 }
}

fn length([x, y, z]: [f64; 3]) -> f64 {
    ((x * x + y * y) + z * z).sqrt()
}

/// The same direction of length 1; zero for none.
fn unit(vector: [f64; 3]) -> [f64; 3] {
    let greatest = vector.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    if !(greatest > 0.0 && greatest.is_finite()) {
        return [0.0; 3];
    }
    let near = vector.map(|x| x / greatest);
    let long = length(near);
    near.map(|x| x / long)
}
