//! Rough mirrors and rough glass: the microfacet model of Walter et al. 2007 with the distribution GGX, heights of masked and
//! shadowed facets correlated (Heitz 2014), and facets sampled among those that are seen (Heitz 2018).
//!
//! Directions are local: z is the normal. `v` is towards where the path came from, on the side of the normal.

use crate::vector::{Vector, cross, dot, normalized, scaled};
use crate::warp::{ONE_OVER_PI, disk};

/// A rough surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ggx {
    /// The width of the distribution of slopes, more than 0.
    pub(crate) alpha: f32,
}

impl Ggx {
    /// The density of facets with this normal, by the area of the surface seen from above.
    pub(crate) fn density(self, facet: Vector) -> f32 {
        let square = self.alpha * self.alpha;
        // Not `(square - 1) z^2 + 1`, which cancels for smooth surfaces.
        let spread = square * (facet[2] * facet[2]) + (facet[0] * facet[0] + facet[1] * facet[1]);
        (square * ONE_OVER_PI) / (spread * spread)
    }

    /// Smith's auxiliary function: the facets hidden for each that is seen.
    fn hidden(self, v: Vector) -> f32 {
        let z = v[2] * v[2];
        if z <= 0.0 {
            return f32::INFINITY;
        }
        let slope = (self.alpha * self.alpha) * ((v[0] * v[0] + v[1] * v[1]) / z);
        ((1.0 + slope).sqrt() - 1.0) * 0.5
    }

    /// Part of the facets that is seen from `v`.
    pub(crate) fn seen(self, v: Vector) -> f32 {
        1.0 / (1.0 + self.hidden(v))
    }

    /// Part of the facets that is seen from `v` and from `l`.
    pub(crate) fn seen_by_both(self, v: Vector, l: Vector) -> f32 {
        1.0 / ((1.0 + self.hidden(v)) + self.hidden(l))
    }

    /// Density by solid angle of [`Ggx::facet`].
    pub(crate) fn facet_density(self, v: Vector, facet: Vector) -> f32 {
        let along = dot(v, facet);
        if along > 0.0 { ((self.seen(v) * along) * self.density(facet)) / v[2] } else { 0.0 }
    }

    /// A facet's normal among those that are seen from `v`: a point of the half sphere that `v` sees once the surface is stretched
    /// until its slopes are those of a sphere.
    pub(crate) fn facet(self, v: Vector, numbers: [f32; 2]) -> Vector {
        let view = normalized([self.alpha * v[0], self.alpha * v[1], v[2]]);
        let squared = view[0] * view[0] + view[1] * view[1];
        let across = if squared > 0.0 {
            scaled([-view[1], view[0], 0.0], 1.0 / squared.sqrt())
        } else {
            [1.0, 0.0, 0.0]
        };
        let along = cross(view, across);
        let [x, y] = disk(numbers);
        let part = 0.5 * (1.0 + view[2]);
        let half = 1.0 - x * x;
        let half = if half > 0.0 { half.sqrt() } else { 0.0 };
        let y = (1.0 - part) * half + part * y;
        let left = (1.0 - x * x) - y * y;
        let z = if left > 0.0 { left.sqrt() } else { 0.0 };
        let at = |axis: usize| (x * across[axis] + y * along[axis]) + z * view[axis];
        let up = at(2);
        normalized([self.alpha * at(0), self.alpha * at(1), if up > 0.0 { up } else { 0.0 }])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pair;
    use crate::warp::sphere;

    /// The facets seen from any direction cover what the surface covers: the density of what is sampled has the integral 1, and the
    /// projected area of all facets is 1.
    #[test]
    fn densities_have_the_integral_one() {
        for alpha in [0.1f32, 0.3, 0.6, 1.0] {
            let ggx = Ggx { alpha };
            for v in [[0.0, 0.0, 1.0], normalized([0.7, 0.1, 0.5]), normalized([0.5, -0.8, 0.1])] {
                let n = 1 << 20;
                let [mut seen, mut area] = [0.0f64; 2];
                for i in 0..n {
                    let facet = sphere(pair([1, 1, 1], i));
                    if facet[2] > 0.0 {
                        let share = 4.0 * std::f64::consts::PI / f64::from(n);
                        seen += f64::from(ggx.facet_density(v, facet)) * share;
                        area += f64::from(ggx.density(facet) * facet[2]) * share;
                    }
                }
                assert!((seen - 1.0).abs() < 0.01, "{alpha} {v:?}: {seen}");
                assert!((area - 1.0).abs() < 0.01, "{alpha}: {area}");
            }
        }
    }

    /// Facets come as often as their density says: the mean of their height is that under the density.
    #[test]
    fn facets_are_distributed_by_their_density() {
        for alpha in [0.2f32, 0.5, 1.0] {
            let ggx = Ggx { alpha };
            for v in [normalized([0.1, 0.0, 1.0]), normalized([0.7, 0.3, 0.4])] {
                let n = 1 << 18;
                let [mut drawn, mut expected] = [[0.0f64; 2]; 2];
                for i in 0..n {
                    let facet = ggx.facet(v, pair([2, 2, 2], i));
                    assert!(facet[2] >= 0.0 && dot(v, facet) > -1e-5);
                    let any = sphere(pair([3, 3, 3], i));
                    let weight = if any[2] > 0.0 { ggx.facet_density(v, any) } else { 0.0 };
                    for axis in 0..2 {
                        let value = |f: Vector| f64::from(f[2 * axis]) / f64::from(n);
                        drawn[axis] += value(facet);
                        expected[axis] +=
                            value(any) * 4.0 * std::f64::consts::PI * f64::from(weight);
                    }
                }
                for axis in 0..2 {
                    assert!((drawn[axis] - expected[axis]).abs() < 0.01, "{alpha} {v:?} {axis}");
                }
            }
        }
    }
}
