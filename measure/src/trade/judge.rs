//! What counts as an error: answers beside the exact ones.
//!
//! The exact answer of a ray is the hit of least (t, triangle index) that real arithmetic gives for
//! the given floats. An answer is *right* when both miss, or both hit and their distances agree
//! within what rounding explains: `verify`'s bound along the ray, sixteen roundings of the corners'
//! coordinates relative to the origin, more for triangles at a slant. So another triangle at the same
//! distance, where triangles share an edge or lie on each other, is right. Else it is
//! - *missing*: exact arithmetic hits, the answer is a miss;
//! - *phantom*: exact arithmetic misses, the answer is a hit;
//! - *wrong*: both hit, at distances further apart.
//!
//! A ray that passes an outline within rounding may be any of the three without anything being at
//! fault. So these are looked at again, with the same bound across the ray, by `verify`'s rule:
//! - a miss, or a hit that is too far, is *rounded* where some ray within the bound meets nothing
//!   nearer either, or the exact hit is within it of an edge that one triangle has alone (where triangles
//!   merely touch, no test promises to close the seam);
//! - a hit that is too near, or where there is none, is *rounded* where the ray passes within the bound
//!   of the point that it names, or some ray within the bound has that distance for its own.
//!
//! What is rounded is counted apart and is no error. A hole between triangles that share an edge is never
//! rounded: around it, every ray hits.

use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::mesh::Mesh;
use splitplane_core::random::hash;
use splitplane_core::ray::{Hit, Ray};
use splitplane_verify::bound::{Bound, edges_within, rings};
use splitplane_verify::reference::{Hit64, Ray64, Reference};
use std::collections::HashMap;
use std::sync::Mutex;

use super::row::Errors;

/// What an answer is, beside the exact one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Right.
    Right,
    /// A hit was expected, and there is none.
    Missing,
    /// No hit was expected, and there is one.
    Phantom,
    /// Too far: what was expected is nearer.
    Behind,
    /// Too near.
    Before,
}

/// Judges answers about one mesh.
pub struct Judge<'a> {
    mesh: &'a Mesh<'a>,
    reference: &'a Reference,
    /// Of the scene's box.
    diagonal: f64,
    /// How many triangles have an edge, by a name of its two ends.
    edges: HashMap<u64, u8>,
    /// Whether rounding explains an answer, by ray and answer.
    known: Mutex<HashMap<u64, bool>>,
}

impl<'a> Judge<'a> {
    /// A judge with the mesh in `f64`.
    pub fn new(mesh: &'a Mesh<'a>, reference: &'a Reference) -> Judge<'a> {
        let mut edges = HashMap::new();
        for index in 0..mesh.len() {
            let [a, b, c] = mesh.triangle(index);
            for edge in [[a, b], [b, c], [c, a]] {
                let count: &mut u8 = edges.entry(name(edge)).or_default();
                *count = count.saturating_add(1);
            }
        }
        let known = Mutex::default();
        Judge { mesh, reference, diagonal: diagonal(mesh), edges, known }
    }

    /// The mesh in `f64`.
    pub(super) fn reference(&self) -> &Reference {
        self.reference
    }

    /// Counts what answers to rays are, beside the exact ones. All three are of equal length.
    pub fn count(&self, rays: &[Ray], exact: &[Hit], answers: &[Hit]) -> Errors {
        let one = |((ray, exact), answer): ((&Ray, &Hit), &Hit)| {
            let outcome = self.outcome(ray, exact, answer);
            let rounded = outcome != Outcome::Right && self.is_rounded(ray, exact, answer, outcome);
            (outcome, rounded, self.apart(ray, exact, answer))
        };
        let all: Vec<(Outcome, bool, Option<f64>)> =
            rays.par_iter().zip(exact).zip(answers).map(one).collect();
        // In the order of the rays: a sum of floats depends on its order.
        let mut errors = Errors { rays: all.len() as u64, ..Errors::default() };
        for ((outcome, rounded, apart), (exact, answer)) in
            all.into_iter().zip(exact.iter().zip(answers))
        {
            let count = match outcome {
                Outcome::Right => &mut 0,
                _ if rounded => &mut errors.rounded,
                Outcome::Missing => &mut errors.missing,
                Outcome::Phantom => &mut errors.phantom,
                Outcome::Behind | Outcome::Before => &mut errors.wrong,
            };
            *count += 1;
            let kind = match outcome {
                Outcome::Right if answer.triangle == exact.triangle => &mut errors.same,
                Outcome::Right => &mut errors.other,
                _ if rounded => &mut errors.outline,
                _ => &mut errors.off,
            };
            if let Some(apart) = apart {
                kind.take(apart);
            }
        }
        errors
    }

    /// How far apart the points of two hits are along the ray, in parts of the diagonal of the scene's box; none
    /// where one is a miss.
    fn apart(&self, ray: &Ray, exact: &Hit, answer: &Hit) -> Option<f64> {
        let length = ray.direction.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
        let apart = (f64::from(answer.t) - f64::from(exact.t)).abs() * length;
        (exact.is_hit() && answer.is_hit()).then(|| apart / self.diagonal)
    }

    /// What one answer is.
    pub fn outcome(&self, ray: &Ray, exact: &Hit, answer: &Hit) -> Outcome {
        match (exact.is_hit(), answer.is_hit()) {
            (false, false) => Outcome::Right,
            (true, false) => Outcome::Missing,
            (false, true) => Outcome::Phantom,
            (true, true) => {
                let (t, right) = (f64::from(answer.t), f64::from(exact.t));
                if answer.triangle == exact.triangle && t == right {
                    return Outcome::Right;
                }
                let mut within = self.bound(ray, answer).along;
                if answer.triangle != exact.triangle {
                    within += self.bound(ray, exact).along;
                }
                // A NaN is no distance.
                match t - right {
                    apart if apart.abs() <= within => Outcome::Right,
                    apart if apart < 0.0 => Outcome::Before,
                    _ => Outcome::Behind,
                }
            }
        }
    }

    /// Whether rounding explains an answer that is not right.
    fn is_rounded(&self, ray: &Ray, exact: &Hit, answer: &Hit, outcome: Outcome) -> bool {
        let vectors = [ray.origin, ray.direction];
        let bits = vectors.as_flattened().iter().map(|x| u64::from(x.to_bits()));
        let limits = [ray.t_min.to_bits().into(), ray.t_max.to_bits().into()];
        let own = [answer.triangle.into(), answer.t.to_bits().into()];
        let weights = [answer.u.to_bits().into(), answer.v.to_bits().into()];
        let key: Vec<u64> = bits.chain(limits).chain(own).chain(weights).collect();
        let key = hash(0, &key);
        let known = || self.known.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some(&rounded) = known().get(&key) {
            return rounded;
        }
        let rounded = match outcome {
            Outcome::Right => true,
            // Distance and weights that mean different points are no hit of any ray.
            _ if answer.is_hit() && !self.bound(ray, answer).holds(&Ray64::from(ray), answer) => {
                false
            }
            Outcome::Missing | Outcome::Behind => self.explains_far(ray, exact, answer),
            Outcome::Phantom | Outcome::Before => self.explains_near(ray, answer),
        };
        known().insert(key, rounded);
        rounded
    }

    fn explains_far(&self, ray: &Ray, exact: &Hit, answer: &Hit) -> bool {
        let own = self.bound(ray, exact);
        let ray = Ray64::from(ray);
        let (across, least) = match answer.some() {
            None => (own.across, f64::INFINITY),
            Some(answer) => {
                let bound = self.bound64(&ray, answer.triangle);
                (own.across.max(bound.across), f64::from(answer.t) - bound.along)
            }
        };
        let far_enough = |near: Option<Hit64>| {
            near.is_none_or(|near| near.t + self.bound64(&ray, near.triangle).along >= least)
        };
        let hit = Hit64 { t: exact.t.into(), triangle: exact.triangle, uv: [0.0; 2] };
        let corners = self.mesh.triangle(exact.triangle as usize);
        let alone = |edge| self.edges.get(&name(edge)) == Some(&1);
        edges_within(&ray, &hit, corners, own.across).into_iter().any(alone)
            || rings(&ray, across).any(|near| far_enough(self.reference.closest(&near)))
    }

    fn explains_near(&self, ray: &Ray, answer: &Hit) -> bool {
        let own = self.bound(ray, answer);
        let ray = Ray64::from(ray);
        let t = f64::from(answer.t);
        let agrees = |near: Hit64| {
            let slack = match near.triangle == answer.triangle {
                true => 0.0,
                false => self.bound64(&ray, near.triangle).along,
            };
            (near.t - t).abs() <= own.along + slack
        };
        own.touches(&ray, answer)
            || rings(&ray, own.across).any(|near| self.reference.closest(&near).is_some_and(agrees))
    }

    fn bound64(&self, ray: &Ray64, triangle: u32) -> Bound {
        Bound::new(ray, self.mesh.triangle((triangle as usize).min(self.mesh.len() - 1)))
    }

    /// The bound of a hit's triangle. A hit that names no triangle of the mesh has no place.
    fn bound(&self, ray: &Ray, hit: &Hit) -> Bound {
        self.bound64(&Ray64::from(ray), hit.triangle)
    }
}

/// The diagonal of the box of all corners; the least number above 0 for a single point.
fn diagonal(mesh: &Mesh<'_>) -> f64 {
    let boxes = (0..mesh.len()).map(|index| Aabb::of_points(&mesh.triangle(index)));
    let bounds = boxes.fold(Aabb::EMPTY, |all, own| all.union(&own));
    bounds.diagonal().max(f64::MIN_POSITIVE)
}

/// A name of an edge that does not depend on its direction.
fn name([a, b]: [[f32; 3]; 2]) -> u64 {
    // Adding 0 makes -0 and 0 one.
    let [a, b] = [a, b].map(|point| point.map(|x| u64::from((x + 0.0).to_bits())));
    let [first, second] = if a <= b { [a, b] } else { [b, a] };
    hash(1, &[first, second].concat())
}

#[cfg(test)]
mod tests {
    use super::super::row::Apart;
    use super::*;

    /// Two triangles that share an edge, and a floor beneath them.
    fn square() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let mut positions = Vec::new();
        for z in [0.0, -1.0] {
            positions.extend([[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z], [0.0, 1.0, z]]);
        }
        (positions, vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    }

    fn hit(t: f32, triangle: u32) -> Hit {
        Hit { t, triangle, u: 0.25, v: 0.25 }
    }

    #[test]
    fn outcomes_by_hand() {
        let (positions, indices) = square();
        let mesh = Mesh::indexed(&positions, &indices).unwrap();
        let reference = Reference::new(&mesh);
        let judge = Judge::new(&mesh, &reference);
        let down = |x: f32, y: f32| Ray::new([x, y, 1.0], [0.0, 0.0, -1.0]);
        let inside = down(0.5, 0.25);
        let exact = hit(1.0, 0);
        let nearly = 1.0 + 4.0 * f32::EPSILON;
        for (answer, outcome) in [
            (exact, Outcome::Right),
            (hit(nearly, 0), Outcome::Right),
            (hit(1.0, 1), Outcome::Right),
            (hit(1.01, 0), Outcome::Behind),
            (hit(0.99, 0), Outcome::Before),
            (hit(2.0, 2), Outcome::Behind),
            (hit(f32::NAN, 0), Outcome::Behind),
            (Hit::MISS, Outcome::Missing),
        ] {
            assert_eq!(judge.outcome(&inside, &exact, &answer), outcome, "{answer:?}");
        }
        assert_eq!(judge.outcome(&inside, &Hit::MISS, &exact), Outcome::Phantom);
        assert_eq!(judge.outcome(&inside, &Hit::MISS, &Hit::MISS), Outcome::Right);
        // In the middle, and on the shared edge: a ray that goes through found a hole. At the rim
        // rounding explains it, for a hit that is lost and for one that is found.
        let above = |x, y| Ray::new([x, y, 1.0], [0.0, 0.0, -1.0]);
        let at_rim = Hit { t: 1.0, triangle: 0, u: 0.5, v: 0.0 };
        let below_rim = Hit { t: 2.0, triangle: 2, ..at_rim };
        let cases = [
            (inside, exact, hit(2.0, 2), Errors { wrong: 1, ..Errors::default() }),
            (inside, exact, hit(0.5, 0), Errors { wrong: 1, ..Errors::default() }),
            (above(0.5, 0.5), exact, Hit::MISS, Errors { missing: 1, ..Errors::default() }),
            (above(0.5, 0.0), exact, below_rim, Errors { rounded: 1, ..Errors::default() }),
            (above(0.5, -1e-7), Hit::MISS, at_rim, Errors { rounded: 1, ..Errors::default() }),
            (above(0.5, -0.1), Hit::MISS, at_rim, Errors { phantom: 1, ..Errors::default() }),
            (above(0.5, 0.0), exact, hit(2.0, 2), Errors { wrong: 1, ..Errors::default() }),
            (inside, exact, hit(1.0, 1), Errors::default()),
        ];
        for (ray, exact, answer, expected) in cases {
            // What is remembered is the same.
            for _ in 0..2 {
                let found = judge.count(&[ray], &[exact], &[answer]);
                let none = Apart::default();
                let counts = Errors { same: none, other: none, outline: none, off: none, ..found };
                assert_eq!(counts, Errors { rays: 1, ..expected }, "{ray:?} {answer:?}");
            }
        }
        let errors =
            Errors { rays: 8, missing: 1, wrong: 1, phantom: 2, rounded: 3, ..Errors::default() };
        assert_eq!((errors.all(), errors.per_million(errors.rounded)), (4, 375_000.0));
    }

    /// The box of the two floors has a diagonal of the root of 3.
    #[test]
    fn sizes_of_errors_by_hand() {
        let (positions, indices) = square();
        let mesh = Mesh::indexed(&positions, &indices).unwrap();
        let reference = Reference::new(&mesh);
        let judge = Judge::new(&mesh, &reference);
        let ray = Ray::new([0.5, 0.25, 1.0], [0.0, 0.0, -2.0]);
        let exact = hit(0.5, 0);
        let near = 0.5 + f32::EPSILON;
        let answers = [exact, hit(near, 0), hit(0.5, 1), hit(1.0, 2), hit(0.75, 0), Hit::MISS];
        let errors = judge.count(&[ray; 6], &[exact; 6], &answers);
        assert_eq!((errors.wrong, errors.missing, errors.rounded), (2, 1, 0));
        let epsilon = 2.0 * f64::from(near - 0.5) / 3.0f64.sqrt();
        let close = |found: Apart, answers: u64, mean: f64, greatest: f64| {
            assert_eq!(found.answers, answers, "{found:?}");
            assert!((found.mean - mean).abs() <= 1e-12 * mean, "{found:?}");
            assert!((found.greatest - greatest).abs() <= 1e-12 * greatest, "{found:?}");
        };
        close(errors.same, 2, 0.5 * epsilon, epsilon);
        close(errors.other, 1, 0.0, 0.0);
        assert_eq!(errors.outline, Apart::default());
        close(errors.off, 2, 0.75 / 3.0f64.sqrt(), 1.0 / 3.0f64.sqrt());
        let both = errors.same.and(errors.off);
        close(both, 4, (0.5 * epsilon + 0.75 / 3.0f64.sqrt()) / 2.0, 1.0 / 3.0f64.sqrt());
    }
}
