//! Tells rounding from error: compares hits with the exact oracle under bounds derived here.
//!
//! # The bounds
//!
//! Let `e` = 2^-24, `M` the largest coordinate difference between the ray's origin and a corner of
//! the triangle, `|d|` the length of the direction.
//!
//! *Place.* A corner seen from the origin errs by at most `e M` per coordinate (one subtraction);
//! shearing it into ray space adds a rounded quotient, a product and a sum, 4 `e M` more. Edge values
//! are differences of two products and err by 3 `e` times the two lengths they multiply, which near
//! an edge displaces it by less than 3 `e M`. Moving the origin of a far ray adds 4 `e M`, and rounds it
//! to the floats that there are where the mesh is: `M` is then at least the greatest coordinate of the
//! triangle. Together 12 `e M`; the judge uses [`PLACE`] `e M` = `D`. A triangle whose boundary is nearer to the ray than
//! `D` may be hit or not, as far as rounding goes; one that the ray meets farther inside must be hit,
//! and one that it passes at a greater distance must not.
//!
//! *Distance.* Let `S` be twice the area of the triangle seen along the ray, `L` its longest side and
//! `P` the distance of its farthest corner from the ray, both seen so, and `Z` the depth between its
//! nearest and farthest corner. Barycentric weights err by `b` = [`PLACE`] `e (M L + P^2) / S`, and
//! weights lie in [0, 1], so depth errs by at most `min(1, b) Z + PLACE e M`, and `t` by that over
//! `|d|`. For a triangle met head-on `Z` is small and the bound is about 1e-6 of `t`; a grazing ray
//! makes `S` small, and then the bound is the depth of the triangle.
//!
//! *Watertightness.* Where the ray passes within `D` of an edge, missing this triangle is right only
//! if nothing takes over beyond that edge. The judge walks from triangle to triangle over all edges
//! within `D` of the ray: only an edge that is a border, or an outline as seen by the ray, excuses a
//! miss. Inside a closed surface seen from within there is none, so no miss is excused.

use crate::oracle::{Crossing, Oracle, ValidRay, finite_bounds, snap};
use splitplane_core::aabb::Aabb;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Culling, Hit, QueryOptions, Ray};
use std::collections::{HashMap, HashSet};

/// The factor of `e M` in every bound, about twice what the derivation needs.
pub const PLACE: f64 = 24.0;
const UNIT: f64 = f32::EPSILON as f64 / 2.0;
const GREATEST: f64 = f32::MAX as f64;
/// Below the least normal number anything may become 0.
const TINY: f64 = 4.0 * f32::MIN_POSITIVE as f64;

/// What the judge thinks of one answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Verdict {
    /// The oracle's triangle (one of them) at its distance, or a miss of both.
    Same,
    /// Another triangle, met by the ray, at a distance that rounding cannot tell from the oracle's.
    SameDistance,
    /// Another answer, which rounding near an edge or a limit accounts for.
    Rounding,
}

/// A judge of one mesh.
pub struct Judge<'a> {
    mesh: Mesh<'a>,
    oracle: &'a Oracle,
    bounds: Aabb,
    /// The triangles at every edge, by the bits of its snapped ends.
    edges: HashMap<[[u32; 3]; 2], Vec<u32>>,
}

/// Origin coordinates nearer to 0 are taken for one value in ordinary scenes (`ORIGIN_LEAST` in core): 2^-60.
const RESOLUTION: f64 = 1.0 / (1u64 << 60) as f64;

/// A triangle as the ray sees it.
struct Seen {
    /// Corners in the plane across the ray; the ray is at (0, 0).
    flat: [[f64; 2]; 3],
    near: f64,
    far: f64,
    depths: [f64; 3],
    /// Bound of the place.
    place: f64,
    /// Bound of `t`.
    t_error: f64,
    /// Bound of the barycentric weights, at most 1.
    weight_error: f64,
    longest: f64,
}

impl<'a> Judge<'a> {
    /// Prepares a mesh.
    pub fn new(mesh: &Mesh<'a>, oracle: &'a Oracle) -> Judge<'a> {
        let bounds = finite_bounds(mesh);
        let mut judge = Judge { mesh: *mesh, oracle, bounds, edges: HashMap::new() };
        for index in 0..mesh.len() {
            if let Some(corners) = judge.corners(index as u32) {
                for edge in edges_of(&corners) {
                    judge.edges.entry(edge).or_default().push(index as u32);
                }
            }
        }
        judge
    }

    /// Snapped corners; `None` for triangles that are left out of a tree.
    fn corners(&self, triangle: u32) -> Option<[[f32; 3]; 3]> {
        let corners = self.mesh.triangle(triangle as usize).map(|corner| corner.map(snap));
        let finite = corners.as_flattened().iter().all(|x| x.is_finite());
        let [a, b, c] = corners;
        (finite && a != b && b != c && c != a).then_some(corners)
    }

    /// Judges the closest hit of a ray.
    ///
    /// # Errors
    /// What is wrong, in words, when rounding does not account for the answer.
    pub fn closest(
        &self,
        ray: &Ray,
        options: &QueryOptions<'_>,
        hit: Option<Hit>,
    ) -> Result<Verdict, String> {
        self.judge(ray, options, hit)
            .map_err(|reason| format!("{reason}\n  ray {ray:?}\n  answer {hit:?}\n  {options:?}"))
    }

    fn judge(
        &self,
        ray: &Ray,
        options: &QueryOptions<'_>,
        hit: Option<Hit>,
    ) -> Result<Verdict, String> {
        let Some(valid) = ValidRay::new(ray) else {
            return match hit {
                None => Ok(Verdict::Same),
                Some(_) => Err("an invalid ray hits something".into()),
            };
        };
        let crossings = self.oracle.crossings(ray, options);
        let within = |c: &&Crossing| {
            c.compare_limit(ray.t_min).is_ge() && c.compare_limit(ray.t_max).is_le()
        };
        let best = crossings.iter().find(within);
        if let Some(hit) = hit {
            self.check_hit(ray, &valid, options, &hit)?;
        }
        let ours = hit.map_or((f64::INFINITY, 0.0), |hit| {
            (f64::from(hit.t), self.see(&valid, hit.triangle).map_or(0.0, |seen| seen.t_error))
        });
        // Everything the oracle finds clearly before our answer must be excused.
        let mut excused = false;
        for crossing in &crossings {
            let seen =
                self.see(&valid, crossing.triangle).ok_or("the oracle met a bad triangle")?;
            let slack = seen.t_error + ours.1;
            if crossing.t.min(GREATEST) + slack >= ours.0 {
                continue;
            }
            let (t_min, t_max) = (f64::from(ray.t_min), f64::from(ray.t_max));
            let at_limit = crossing.t < t_min + seen.t_error || crossing.t > t_max - seen.t_error;
            // A distance that no float holds is no hit.
            let out_of_range = crossing.t.abs() * (1.0 + 1e-6) > f64::from(f32::MAX);
            if at_limit || out_of_range {
                excused |= within(&crossing);
                continue;
            }
            if !self.near_outline(&valid, options, crossing.triangle) {
                return Err(format!(
                    "triangle {} at t = {} is missed, well inside or between neighbours \
                     (bound of t {}, of place {})",
                    crossing.triangle, crossing.t, seen.t_error, seen.place
                ));
            }
            excused = true;
        }
        Ok(match (best, hit) {
            (None, None) => Verdict::Same,
            (Some(best), Some(hit))
                if (best.t.min(GREATEST) - f64::from(hit.t)).abs() <= {
                    ours.1 + self.see(&valid, best.triangle).map_or(0.0, |seen| seen.t_error)
                } =>
            {
                let tied = crossings.iter().filter(within).any(|c| {
                    c.compare_t(best).is_eq() && self.same_corners(c.triangle, hit.triangle)
                });
                if tied { Verdict::Same } else { Verdict::SameDistance }
            }
            (None, Some(_)) => Verdict::Rounding,
            _ if excused => Verdict::Rounding,
            // Before the oracle's hit: `check_hit` found our triangle within rounding of the ray.
            (Some(best), Some(hit)) if f64::from(hit.t) < best.t => Verdict::Rounding,
            _ => return Err("the answer differs, and nothing accounts for it".into()),
        })
    }

    fn same_corners(&self, a: u32, b: u32) -> bool {
        a == b || (self.corners(a).is_some() && self.corners(a) == self.corners(b))
    }

    /// A hit must be one: its triangle kept, not ignored nor culled, met by the ray within bounds,
    /// at the right distance and with the right weights.
    fn check_hit(
        &self,
        ray: &Ray,
        valid: &ValidRay,
        options: &QueryOptions<'_>,
        hit: &Hit,
    ) -> Result<(), String> {
        let t = f64::from(hit.t);
        if !(hit.t >= ray.t_min && hit.t <= ray.t_max && hit.t.is_finite()) {
            return Err(format!("t = {t} is not between the limits"));
        }
        if options.ignore == Some(hit.triangle) {
            return Err("the hit is on the triangle to ignore".into());
        }
        if hit.triangle as usize >= self.mesh.len() {
            return Err("the hit names a triangle that does not exist".into());
        }
        let Some(seen) = self.see(valid, hit.triangle) else {
            return Err("the hit is on a triangle that should have been dropped".into());
        };
        let distance = seen.distance();
        if distance > seen.place {
            return Err(format!(
                "the ray passes the triangle at {distance}, more than {} away",
                seen.place
            ));
        }
        let length = valid.direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        let (low, high) = match self.oracle.t_of(ray, hit.triangle) {
            // What no float holds may be reported as the greatest one.
            Some(exact) => [exact.clamp(-GREATEST, GREATEST); 2].into(),
            None => {
                // Beside the triangle, or along its plane: the plane's distance says little.
                let span = [seen.near / length, seen.far / length];
                let span = match seen.plane_depth() {
                    Some(depth) => [(depth / length).clamp(span[0], span[1]); 2],
                    None => span,
                };
                span.map(|t| t.clamp(-GREATEST, GREATEST)).into()
            }
        };
        if t < low - seen.t_error || t > high + seen.t_error {
            return Err(format!(
                "t = {t} should be from {low} to {high}, give or take {}",
                seen.t_error
            ));
        }
        let clear = seen.signed_area().abs() > 2.0 * seen.place * seen.longest;
        if seen.is_culled(options) && clear {
            return Err("the hit is on a side that is culled".into());
        }
        let (u, v) = (f64::from(hit.u), f64::from(hit.v));
        let in_range = (0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v);
        if !in_range || u + v > 1.0 + 4.0 * UNIT {
            return Err(format!("the weights {u} and {v} are out of range"));
        }
        // The point that the weights name lies on the ray, within their error.
        let off = [0, 1]
            .map(|i| (1.0 - u - v) * seen.flat[0][i] + u * seen.flat[1][i] + v * seen.flat[2][i]);
        let bound = 2.0 * (seen.weight_error * seen.longest + seen.place);
        if off[0].hypot(off[1]) > bound {
            return Err(format!(
                "the weights name a point {} off the ray, more than {bound}",
                off[0].hypot(off[1])
            ));
        }
        Ok(())
    }

    /// Whether a miss of this triangle is accounted for: see the module's notes.
    fn near_outline(&self, ray: &ValidRay, options: &QueryOptions<'_>, triangle: u32) -> bool {
        let mut visited = HashSet::from([triangle]);
        let mut queue = vec![triangle];
        while let Some(here) = queue.pop() {
            let (Some(seen), Some(corners)) = (self.see(ray, here), self.corners(here)) else {
                continue;
            };
            for (k, edge) in edges_of(&corners).into_iter().enumerate() {
                let (p, q) = (seen.flat[k], seen.flat[(k + 1) % 3]);
                if segment_distance(p, q) > seen.place {
                    continue;
                }
                let side = side_of(p, q, seen.flat[(k + 2) % 3]);
                let mut continued = false;
                for &other in self.edges.get(&edge).into_iter().flatten() {
                    if other == here || options.ignore == Some(other) {
                        continue;
                    }
                    let Some(neighbour) = self.see(ray, other) else { continue };
                    // What is culled takes over nothing: the edge is an outline of what is left.
                    if neighbour.is_culled(options) {
                        continue;
                    }
                    let Some(theirs) = self.corners(other) else { continue };
                    let Some(apex) = (0..3).find(|&i| {
                        let bits = theirs[i].map(f32::to_bits);
                        bits != edge[0] && bits != edge[1]
                    }) else {
                        continue;
                    };
                    let across = side_of(p, q, neighbour.flat[apex]);
                    if side * across < 0.0 && across.abs() > neighbour.place {
                        continued = true;
                        if visited.insert(other) {
                            queue.push(other);
                        }
                    }
                }
                if !continued {
                    return true;
                }
            }
        }
        false
    }

    /// Whether the origin is so far from the mesh, in terms of its size, that it is first moved; a
    /// little before that already.
    fn is_moved(&self, ray: &ValidRay) -> bool {
        let side = |axis: usize| (f64::from(self.bounds.lo[axis]), f64::from(self.bounds.hi[axis]));
        let extent = (0..3).map(|axis| side(axis).1 - side(axis).0).fold(0.0, f64::max);
        let gap = |axis: usize| {
            let (low, high) = side(axis);
            (low - ray.origin[axis]).max(ray.origin[axis] - high)
        };
        (0..3).any(|axis| gap(axis) > 99.0 * extent)
    }

    /// Whether the scene is neither so small nor so large that tests are scaled: then origins next to 0 are
    /// moved by up to [`RESOLUTION`].
    fn has_resolution(&self) -> bool {
        let [lo, hi] = [self.bounds.lo, self.bounds.hi].map(|corner| corner.map(f64::from));
        let extent = (0..3).map(|axis| hi[axis] - lo[axis]).fold(0.0, f64::max);
        let greatest = lo.iter().chain(&hi).fold(0.0f64, |m, x| m.max(x.abs()));
        extent >= 2f64.powi(-40) && greatest <= 2f64.powi(38)
    }

    fn see(&self, ray: &ValidRay, triangle: u32) -> Option<Seen> {
        let corners = self.corners(triangle)?;
        let d = ray.direction;
        let largest = d.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let scaled = d.map(|x| x / largest);
        let scaled_length = scaled.iter().map(|x| x * x).sum::<f64>().sqrt();
        let unit = scaled.map(|x| x / scaled_length);
        let length = scaled_length * largest;
        // Two directions across the ray, from the axis least along it.
        let least = (0..3).min_by(|&a, &b| unit[a].abs().total_cmp(&unit[b].abs())).unwrap_or(0);
        let mut axis = [0.0; 3];
        axis[least] = 1.0;
        let first = normalised(cross(unit, axis));
        let second = cross(unit, first);
        let offsets = corners.map(|corner| [0, 1, 2].map(|i| f64::from(corner[i]) - ray.origin[i]));
        let mut magnitude = offsets.as_flattened().iter().fold(0.0f64, |m, x| m.max(x.abs()));
        if self.is_moved(ray) {
            let corners = corners.as_flattened().iter();
            magnitude = corners.fold(magnitude, |m, x| m.max(f64::from(x.abs())));
        }
        if self.has_resolution() {
            magnitude = magnitude.max(RESOLUTION / UNIT);
        }
        let flat = offsets.map(|p| [dot(p, first), dot(p, second)]);
        let depths = offsets.map(|p| dot(p, unit));
        let near = depths.iter().copied().fold(f64::INFINITY, f64::min);
        let far = depths.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let place = PLACE * UNIT * magnitude + TINY;
        let mut seen =
            Seen { flat, near, far, depths, place, t_error: 0.0, weight_error: 1.0, longest: 0.0 };
        seen.longest = (0..3).map(|k| distance(flat[k], flat[(k + 1) % 3])).fold(0.0, f64::max);
        let reach = flat.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
        let noise = PLACE * UNIT * (magnitude * seen.longest + reach * reach);
        let area = seen.signed_area().abs();
        seen.weight_error = if noise < area { noise / area } else { 1.0 };
        let depth_error = seen.weight_error * (far - near) + place;
        seen.t_error = depth_error / length + TINY;
        Some(seen)
    }
}

impl Seen {
    /// Twice the area as the ray sees it, positive from the front.
    fn signed_area(&self) -> f64 {
        let [a, b, c] = self.flat;
        // `first`, `second` and the ray are right-handed with the ray pointing away from the eye.
        -((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
    }

    fn is_culled(&self, options: &QueryOptions<'_>) -> bool {
        match options.culling {
            Culling::None => false,
            Culling::Back => self.signed_area() <= 0.0,
            Culling::Front => self.signed_area() >= 0.0,
        }
    }

    /// How far the ray's line passes from the triangle, seen along the ray.
    fn distance(&self) -> f64 {
        let [a, b, c] = self.flat;
        let turn = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
        let (u, v, w) = (turn(a, b), turn(b, c), turn(c, a));
        if (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0) {
            // All zero is a triangle seen edge-on, or as a point, in line with the ray.
            if u != 0.0 || v != 0.0 || w != 0.0 {
                return 0.0;
            }
        }
        segment_distance(a, b).min(segment_distance(b, c)).min(segment_distance(c, a))
    }

    /// Depth of the triangle's plane on the ray; `None` where weights say nothing.
    fn plane_depth(&self) -> Option<f64> {
        if self.weight_error >= 1.0 {
            return None;
        }
        let [a, b, c] = self.flat;
        let turn = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
        let weights = [turn(b, c), turn(c, a), turn(a, b)];
        let sum: f64 = weights.iter().sum();
        Some((0..3).map(|k| weights[k] / sum * self.depths[k]).sum())
    }
}

fn edges_of(corners: &[[f32; 3]; 3]) -> [[[u32; 3]; 2]; 3] {
    [0, 1, 2].map(|k| {
        let mut edge = [corners[k], corners[(k + 1) % 3]].map(|corner| corner.map(f32::to_bits));
        edge.sort_unstable();
        edge
    })
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn normalised(a: [f64; 3]) -> [f64; 3] {
    let length = dot(a, a).sqrt();
    a.map(|x| x / length)
}

fn distance(p: [f64; 2], q: [f64; 2]) -> f64 {
    (p[0] - q[0]).hypot(p[1] - q[1])
}

/// Distance of (0, 0) from the segment.
fn segment_distance(p: [f64; 2], q: [f64; 2]) -> f64 {
    let d = [q[0] - p[0], q[1] - p[1]];
    let squared = d[0] * d[0] + d[1] * d[1];
    let s = if squared > 0.0 { -(p[0] * d[0] + p[1] * d[1]) / squared } else { 0.0 };
    let s = s.clamp(0.0, 1.0);
    (p[0] + s * d[0]).hypot(p[1] + s * d[1])
}

/// Signed distance of a point from the line through the edge; 0 for an edge seen as a point.
fn side_of(p: [f64; 2], q: [f64; 2], point: [f64; 2]) -> f64 {
    let d = [q[0] - p[0], q[1] - p[1]];
    let length = d[0].hypot(d[1]);
    if length == 0.0 {
        return 0.0;
    }
    (d[0] * (point[1] - p[1]) - d[1] * (point[0] - p[0])) / length
}
