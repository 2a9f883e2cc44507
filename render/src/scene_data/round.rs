//! Where rays meet shapes: spheres, capsules and those of the user's own, which have no corners.

use crate::vector::exponent;
use crate::warp::{Basis, cap};
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
    /// One over the density by area with which [`sample`] draws this place, times four to the power below; 0 for shapes of the user's own.
    pub(crate) scaled_area: f32,
    pub(crate) power: i32,
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
    let place = match axis {
        Some((centre, radius)) => {
            let out = unit([0, 1, 2].map(|k| met[k] - centre[k]));
            (out, [0, 1, 2].map(|k| centre[k] + radius * out[k]))
        }
        None => {
            let point = met.map(|x| x as f32);
            (unit(shapes.normal(hit.triangle, point, hit.u, hit.v).map(f64::from)), met)
        }
    };
    in_world(shapes, ways, hit.triangle, place)
}

/// The place in the world of one in the object's space, given by its normal of length 1 and its point.
fn in_world(
    shapes: &Shapes,
    ways: &Ways<'_>,
    primitive: u32,
    (outwards, local): ([f64; 3], [f64; 3]),
) -> RoundPlace {
    let inverse = ways.inverse.map(|row| row.map(f64::from));
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
    let bounds = shapes.bounds(primitive);
    // The greatest coordinate of the primitive's box and its extent, each for the origin of the next ray too.
    let size = bounds.map_or(0.0, |own| {
        let ends = (0..3).map(|k| (f64::from(own.lo[k]), f64::from(own.hi[k])));
        let sizes = ends.map(|(lo, hi)| lo.abs().max(hi.abs()) + (hi - lo));
        2.0 * sizes.fold(0.0, f64::max)
    });
    let stretched = length(normal);
    let within = if stretched > 0.0 { SHAPE_SLACK * size / stretched } else { 0.0 };
    let offset = within + reach * f64::from(ways.stretch) * UNITS;
    // A transform A makes |det A| |A^-T n| of an area with the normal n.
    let area = area(shapes, primitive) * determinant(ways.transform) * stretched;
    let (scaled_area, power) = match area.sqrt() as f32 {
        side if side > 0.0 && side.is_finite() => {
            let power = -exponent(side);
            ((area * f64::from(power).exp2().powi(2)) as f32, power)
        }
        _ => (0.0, 0),
    };
    let normal = unit(normal).map(|x| x as f32);
    RoundPlace { point, normal, offset: offset as f32, scaled_area, power }
}

/// A place of a sphere or capsule, evenly over its surface in the object's space; `None` for shapes of the user's own.
pub(super) fn sample(
    shapes: &Shapes,
    ways: &Ways<'_>,
    primitive: u32,
    [u, v]: [f32; 2],
) -> Option<RoundPlace> {
    let any = |numbers: [f32; 2]| unit(cap(numbers, 2.0).map(f64::from));
    let (centre, radius, outwards) = match shapes {
        Shapes::Spheres(all) => {
            let own = all.get(primitive as usize)?;
            (own.centre.map(f64::from), f64::from(own.radius), any([u, v]))
        }
        Shapes::Capsules(all) => {
            let own = all.get(primitive as usize)?;
            let ([a, b], radius) = (own.ends.map(|end| end.map(f64::from)), f64::from(own.radius));
            let axis = [0, 1, 2].map(|k| b[k] - a[k]);
            let along = unit(axis);
            // The part of its surface that its two ends have, a whole sphere.
            let ends = (2.0 * radius / (length(axis) + 2.0 * radius)) as f32;
            if u < ends {
                let outwards = any([u / ends, v]);
                let side = (0..3).map(|k| outwards[k] * along[k]).sum::<f64>();
                (if side < 0.0 { a } else { b }, radius, outwards)
            } else {
                // The height of an even direction is even, and so is its angle, on its own.
                let [x, y, z] = cap([(u - ends) / (1.0 - ends), v], 2.0);
                let around = if x == 0.0 && y == 0.0 { [1.0, 0.0, 0.0] } else { [x, y, 0.0] };
                let basis = Basis::around(along.map(|x| x as f32));
                let outwards = unit(basis.to_world(around).map(f64::from));
                let part = (f64::from(z) + 1.0) * 0.5;
                ([0, 1, 2].map(|k| a[k] + part * axis[k]), radius, outwards)
            }
        }
        Shapes::Own(_) => return None,
    };
    let local = [0, 1, 2].map(|k| centre[k] + radius * outwards[k]);
    Some(in_world(shapes, ways, primitive, (outwards, local)))
}

/// The area of a sphere or capsule in the object's space; 0 for a shape that has none to sample.
fn area(shapes: &Shapes, primitive: u32) -> f64 {
    let of = |radius: f32, length: f64| {
        let radius = f64::from(radius);
        core::f64::consts::TAU * radius * (length + 2.0 * radius)
    };
    match shapes {
        Shapes::Spheres(all) => match all.get(primitive as usize) {
            Some(own) if own.counts() => of(own.radius, 0.0),
            _ => 0.0,
        },
        Shapes::Capsules(all) => match all.get(primitive as usize) {
            Some(own) if own.counts() => {
                let [a, b] = own.ends.map(|end| end.map(f64::from));
                of(own.radius, length([0, 1, 2].map(|k| b[k] - a[k])))
            }
            _ => 0.0,
        },
        Shapes::Own(_) => 0.0,
    }
}

/// About the area of a sphere or capsule in the world: by the mean stretch of three directions, so exact where all are stretched alike.
pub(super) fn area_in_world(shapes: &Shapes, ways: &Ways<'_>, primitive: u32) -> f64 {
    let inverse = ways.inverse.map(|row| row.map(f64::from));
    let mean = inverse.map(|[a, b, c, _]| length([a, b, c])).iter().sum::<f64>() / 3.0;
    area(shapes, primitive) * determinant(ways.transform) * mean
}

/// By how much a transform multiplies volumes; not negative.
fn determinant(transform: &Transform) -> f64 {
    let [[a, b, c, _], [d, e, f, _], [g, h, i, _]] = transform.map(|row| row.map(f64::from));
    (a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)).abs()
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
