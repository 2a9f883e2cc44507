//! The test of a sphere.

use super::ray::{ShapeRay, Span, greatest, minus, quarter, times};
use super::set::Sphere;
use crate::arithmetic::{Arithmetic, exponent, power_of_two};

impl Sphere {
    /// Where a line is in the sphere, which must be one that counts ([`Sphere::counts`]); `None` for nowhere.
    ///
    /// In lengths divided by a power of two, so that nothing overflows: with `f` from the centre to the origin, `d` the direction and `a` its
    /// square, the nearest point is at `s = -(f d) / a`, `l = f + s d` leads to it, and the ends are `s` less and more the
    /// root of `(r r - l l) / a`.
    pub fn span<A: Arithmetic>(&self, ray: &ShapeRay) -> Option<Span> {
        let centre = self.centre.map(quarter::<A>);
        let (from, radius) = (minus::<A>(ray.origin, centre), quarter::<A>(self.radius));
        let size = exponent(greatest([greatest(from), radius, 0.0]));
        let factor = power_of_two(-size);
        let from = times::<A>(from, factor);
        let t = ray.in_ball::<A>(from, A::snapped_product(radius, factor))?;
        Some(Span { t: t.map(|t| ray.outer::<A>(t, size)), u: [0.0; 2] })
    }
}
