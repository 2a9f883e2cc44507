//! The test of a capsule.

use super::ray::{
    NOTHING, ShapeRay, Span, dot, greatest, minus, quarter, ratio, times, within_radius,
};
use super::set::Capsule;
use crate::arithmetic::{Arithmetic, exponent, power_of_two};

impl Capsule {
    /// Where a line is in the capsule, which must be one that counts ([`Capsule::counts`]); `None` for nowhere.
    ///
    /// A capsule is the union of a ball about each end and of the cylinder between them, and a line is in it from the first place where it is in
    /// one of these to the last, since the whole is convex. The balls are tested as spheres are. The cylinder is a circle seen along the axis:
    /// what is left of `f` and `d` when their parts along the axis are taken away goes through the same test. Lengths are divided by a
    /// power of two.
    pub fn span<A: Arithmetic>(&self, ray: &ShapeRay) -> Option<Span> {
        let ends = self.ends.map(|end| end.map(quarter::<A>));
        let (from, axis) = (minus::<A>(ray.origin, ends[0]), minus::<A>(ends[1], ends[0]));
        let radius = quarter::<A>(self.radius);
        let size = exponent(greatest([greatest(from), greatest(axis), radius]));
        let factor = power_of_two(-size);
        let (from, axis) = (times::<A>(from, factor), times::<A>(axis, factor));
        let radius = A::snapped_product(radius, factor);

        let length = dot::<A>(axis, axis);
        let first = ray.in_ball::<A>(from, radius);
        if length < NOTHING {
            // The ends are one point, to within far less than a rounding.
            let t = first?.map(|t| ray.outer::<A>(t, size));
            return Some(Span { t, u: [0.0; 2] });
        }
        let along =
            Along { from: dot::<A>(from, axis), direction: dot::<A>(ray.direction, axis), length };
        let parts = [
            first,
            ray.in_ball::<A>(minus::<A>(from, axis), radius),
            along.in_cylinder::<A>(ray, from, axis, radius),
        ];
        let whole = parts
            .into_iter()
            .flatten()
            .reduce(|[a, b], [c, d]| [if c < a { c } else { a }, if d > b { d } else { b }])?;
        let u = whole.map(|t| along.part::<A>(t));
        Some(Span { t: whole.map(|t| ray.outer::<A>(t, size)), u })
    }
}

/// Products with the capsule's axis.
struct Along {
    from: f32,
    direction: f32,
    /// Of the axis with itself: the square of its length.
    length: f32,
}

impl Along {
    /// How far along the axis the ray is at `t`, as a part of it, from 0 to 1.
    fn part<A: Arithmetic>(&self, t: f32) -> f32 {
        let at = A::snapped_sum(self.from, A::snapped_product(t, self.direction));
        let part = ratio::<A>(at, self.length);
        if part > 0.0 { if part < 1.0 { part } else { 1.0 } } else { 0.0 }
    }

    /// Where the line is between the planes through both ends.
    fn between_planes<A: Arithmetic>(&self) -> Option<[f32; 2]> {
        let Along { from, direction, length } = *self;
        let squared = A::snapped_product(direction, direction);
        if squared <= A::snapped_product(length, NOTHING) {
            // Along the planes.
            return (0.0 <= from && from <= length).then_some([-f32::MAX, f32::MAX]);
        }
        let low = ratio::<A>(-from, direction);
        let high = ratio::<A>(A::snapped_difference(length, from), direction);
        Some(if low < high { [low, high] } else { [high, low] })
    }

    /// Where the line is in the cylinder between both ends.
    fn in_cylinder<A: Arithmetic>(
        &self,
        ray: &ShapeRay,
        from: [f32; 3],
        axis: [f32; 3],
        radius: f32,
    ) -> Option<[f32; 2]> {
        let planes = self.between_planes::<A>()?;
        let across = |v: [f32; 3], part: f32| {
            let part = ratio::<A>(part, self.length);
            minus::<A>(v, times::<A>(axis, part))
        };
        let from = across(from, self.from);
        let direction = across(ray.direction, self.direction);
        let squared = dot::<A>(direction, direction);
        let round = if squared < NOTHING {
            // Along the axis.
            let within = dot::<A>(from, from) <= A::snapped_product(radius, radius);
            within.then_some([-f32::MAX, f32::MAX])?
        } else {
            within_radius::<A>(from, direction, squared, radius)?
        };
        let enter = if planes[0] > round[0] { planes[0] } else { round[0] };
        let exit = if planes[1] < round[1] { planes[1] } else { round[1] };
        (enter <= exit).then_some([enter, exit])
    }
}
