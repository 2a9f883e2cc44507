//! What counts as an error: answers beside the exact ones.
//!
//! The exact answer of a ray is the hit of least (t, triangle index) that real arithmetic gives for
//! the given floats. An answer is *right* when both miss, or both hit and their distances agree
//! within what rounding explains: `verify`'s bound along the ray, sixteen roundings of the corners'
//! coordinates relative to the origin, steeper triangles more. So another triangle at the same
//! distance, where triangles share an edge or lie on each other, is right. Else it is
//! - *missing*: exact arithmetic hits, the answer is a miss;
//! - *phantom*: exact arithmetic misses, the answer is a hit;
//! - *wrong*: both hit, at distances further apart.
//!
//! A ray that passes an outline within rounding may be any of the three without a hole in the mesh. So
//! those of the missing and the wrong that go too far are looked at again: where some ray
//! within that bound across the ray meets nothing nearer either, or the exact hit is within the
//! bound of an edge that one triangle has alone, rounding explains the answer. The others are
//! *leaks*.

use crate::random::hash;
use crate::verify::bound::{Bound, edges_within, rings};
use crate::verify::reference::{Hit64, Ray64, Reference};
use rayon::prelude::*;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, Ray};
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
        Judge { mesh, reference, edges, known: Mutex::default() }
    }

    /// Counts what answers to rays are, beside the exact ones. All three are of equal length.
    pub fn count(&self, rays: &[Ray], exact: &[Hit], answers: &[Hit]) -> Errors {
        let one = |((ray, exact), answer): ((&Ray, &Hit), &Hit)| {
            let outcome = self.outcome(ray, exact, answer);
            let far = matches!(outcome, Outcome::Missing | Outcome::Behind);
            Errors {
                rays: 1,
                missing: u64::from(outcome == Outcome::Missing),
                wrong: u64::from(matches!(outcome, Outcome::Behind | Outcome::Before)),
                phantom: u64::from(outcome == Outcome::Phantom),
                leaks: u64::from(far && !self.is_explained(ray, exact, answer)),
            }
        };
        let add = |a: Errors, b: Errors| Errors {
            rays: a.rays + b.rays,
            missing: a.missing + b.missing,
            wrong: a.wrong + b.wrong,
            phantom: a.phantom + b.phantom,
            leaks: a.leaks + b.leaks,
        };
        rays.par_iter().zip(exact).zip(answers).map(one).reduce(Errors::default, add)
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

    /// Whether rounding explains an answer that is a miss or too far.
    fn is_explained(&self, ray: &Ray, exact: &Hit, answer: &Hit) -> bool {
        let vectors = [ray.origin, ray.direction];
        let bits = vectors.as_flattened().iter().map(|x| u64::from(x.to_bits()));
        let limits = [ray.t_min.to_bits().into(), ray.t_max.to_bits().into()];
        let own = [answer.triangle.into(), answer.t.to_bits().into()];
        let key = hash(0, &bits.chain(limits).chain(own).collect::<Vec<u64>>());
        let known = || self.known.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some(&explained) = known().get(&key) {
            return explained;
        }
        let explained = self.explain(ray, exact, answer);
        known().insert(key, explained);
        explained
    }

    fn explain(&self, ray: &Ray, exact: &Hit, answer: &Hit) -> bool {
        let own = self.bound(ray, exact);
        let ray = Ray64::from(ray);
        let (across, least) = match answer.some() {
            None => (own.across, f64::INFINITY),
            Some(answer) => {
                let bound = Bound::new(&ray, self.mesh.triangle(answer.triangle as usize));
                (own.across.max(bound.across), f64::from(answer.t) - bound.along)
            }
        };
        let far_enough = |near: Option<Hit64>| {
            near.is_none_or(|near| {
                let corners = self.mesh.triangle(near.triangle as usize);
                near.t + Bound::new(&ray, corners).along >= least
            })
        };
        let hit = Hit64 { t: exact.t.into(), triangle: exact.triangle, uv: [0.0; 2] };
        let corners = self.mesh.triangle(exact.triangle as usize);
        let alone = |edge| self.edges.get(&name(edge)) == Some(&1);
        edges_within(&ray, &hit, corners, own.across).into_iter().any(alone)
            || rings(&ray, across).any(|near| far_enough(self.reference.closest(&near)))
    }

    /// The bound of a hit's triangle. A hit that names no triangle of the mesh has no place.
    fn bound(&self, ray: &Ray, hit: &Hit) -> Bound {
        let index = (hit.triangle as usize).min(self.mesh.len() - 1);
        Bound::new(&Ray64::from(ray), self.mesh.triangle(index))
    }
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
    fn outcomes_and_leaks_by_hand() {
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
        // rounding explains it.
        let rays = [inside, down(0.5, 0.5), down(0.5, 0.0), inside];
        let exacts = [exact, exact, exact, Hit::MISS];
        let answers = [hit(2.0, 2), Hit::MISS, hit(2.0, 2), exact];
        let errors = judge.count(&rays, &exacts, &answers);
        let expected = Errors { rays: 4, missing: 1, wrong: 2, phantom: 1, leaks: 2 };
        assert_eq!(errors, expected);
        // What is remembered is the same.
        assert_eq!(judge.count(&rays, &exacts, &answers), expected);
        assert_eq!((errors.all(), errors.per_million(errors.leaks)), (4, 5e5));
    }
}
