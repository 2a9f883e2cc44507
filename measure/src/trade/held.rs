//! The judge judged: a sample of the exact answers beside the reference in f64.
//!
//! What is exact is computed by the CPU backend, through its own tree. The reference shares neither tree nor test
//! with it: it has a hierarchy of its own, and tests every triangle where that takes little time. So an
//! error in either shows as a disagreement, a difference that rounding does not explain.

use super::judge::Judge;
use super::row::Aims;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use splitplane_core::random::hash;
use splitplane_core::ray::{Hit, Ray};
use splitplane_verify::reference::{Hit64, Ray64};

/// Rays of each kind that are checked, at most.
const SAMPLE: usize = 2048;
/// Tests of a triangle that brute force may take, all rays together.
const TESTS: usize = 1 << 27;
const SEED: u64 = 1;

/// What the reference says of a sample of the exact answers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Held {
    /// Answers that were checked.
    pub checked: u64,
    /// Of those, by testing every triangle; the others through the reference's hierarchy.
    pub by_brute_force: u64,
    /// Differences within the rounding that [`super::judge`] allows every answer.
    pub rounded: u64,
    /// Differences beyond it: the exact answers cannot be trusted.
    pub disagreements: u64,
    /// The first of them in words.
    pub first: Option<String>,
}

impl Held {
    /// In words, without a full stop.
    pub fn words(&self) -> String {
        let mut out = format!(
            "{} of them held against an independent reference in f64, {} by testing every triangle: {} \
             disagreements, {} within rounding",
            self.checked, self.by_brute_force, self.disagreements, self.rounded
        );
        if let Some(first) = &self.first {
            out += &format!("; the first is {first}");
        }
        out
    }

    fn and(self, other: Held) -> Held {
        Held {
            checked: self.checked + other.checked,
            by_brute_force: self.by_brute_force + other.by_brute_force,
            rounded: self.rounded + other.rounded,
            disagreements: self.disagreements + other.disagreements,
            first: self.first.or(other.first),
        }
    }
}

impl Judge<'_> {
    /// Holds a sample of the exact answers to rays against the reference. Equal rays give equal samples.
    pub fn hold(&self, rays: &Aims<Vec<Ray>>, exact: &Aims<Vec<Hit>>) -> Held {
        let rays_by_force = TESTS / self.reference().len().max(1);
        let kinds = rays.each().into_iter().zip(exact.each()).zip(0u64..);
        let places = kinds.flat_map(|((rays, exact), kind)| {
            let count = rays.len();
            (0..count.min(SAMPLE)).map(move |number| {
                let place = match count > SAMPLE {
                    true => hash(SEED, &[kind, number as u64]) as usize % count,
                    false => number,
                };
                (number, Aims::<()>::NAMES[kind as usize], rays[place], exact[place])
            })
        });
        let places: Vec<(usize, &str, Ray, Hit)> = places.collect();
        let one = |(number, kind, ray, exact): &(usize, &str, Ray, Hit)| {
            // The first of every kind.
            let by_force = number * Aims::<()>::NAMES.len() < rays_by_force;
            let near = Ray64::from(ray);
            let found = match by_force {
                true => self.reference().closest_by_brute_force(&near),
                false => self.reference().closest(&near),
            };
            let errors = self.count(&[*ray], &[rounded(found)], &[*exact]);
            let wrong = errors.all() > 0;
            Held {
                checked: 1,
                by_brute_force: u64::from(by_force),
                rounded: errors.rounded,
                disagreements: errors.all(),
                first: wrong.then(|| format!("of kind {kind}, {ray:?}: {exact:?}, but {found:?}")),
            }
        };
        places.par_iter().map(one).reduce(Held::default, Held::and)
    }
}

/// A hit in f64 as it would be given to a caller.
fn rounded(hit: Option<Hit64>) -> Hit {
    hit.map_or(Hit::MISS, |hit| Hit {
        t: hit.t as f32,
        triangle: hit.triangle,
        u: hit.uv[0] as f32,
        v: hit.uv[1] as f32,
    })
}

#[cfg(test)]
mod tests {
    use super::super::row::KINDS;
    use super::*;
    use splitplane_core::mesh::Mesh;
    use splitplane_verify::reference::Reference;

    /// Two floors of unit squares, one beneath the other.
    fn floors() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let mut positions = Vec::new();
        for z in [0.0, -1.0] {
            positions.extend([[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z], [0.0, 1.0, z]]);
        }
        (positions, vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    }

    #[test]
    fn planted_faults_of_the_exact_answers_are_found() {
        let (positions, indices) = floors();
        let mesh = Mesh::indexed(&positions, &indices).unwrap();
        let reference = Reference::new(&mesh);
        let judge = Judge::new(&mesh, &reference);
        let down = |i: usize| {
            let (x, y) = (0.05 + 0.1 * (i % 10) as f32, 0.02 + 0.1 * (i / 10 % 10) as f32);
            Ray::new([x, y, 1.0], [0.0, 0.0, -1.0])
        };
        let set: Vec<Ray> = (0..100).map(down).collect();
        let rays = Aims::of([(); KINDS].map(|()| set.clone()));
        let right: Vec<Hit> = set
            .iter()
            .map(|ray| rounded(reference.closest_by_brute_force(&Ray64::from(ray))))
            .collect();
        let exact = Aims::of([(); KINDS].map(|()| right.clone()));
        let held = judge.hold(&rays, &exact);
        assert_eq!((held.checked, held.by_brute_force), (100 * KINDS as u64, 100 * KINDS as u64));
        assert_eq!((held.rounded, held.disagreements, &held.first), (0, 0, &None));
        // Lost, too far, and from nowhere.
        let mut planted = exact.clone();
        planted.edge[7] = Hit::MISS;
        planted.vertex[8] =
            Hit { t: 2.0, triangle: planted.vertex[8].triangle + 2, ..planted.vertex[8] };
        planted.shadow[9] = Hit { t: 0.5, ..planted.shadow[9] };
        let held = judge.hold(&rays, &planted);
        assert_eq!(held.disagreements, 3, "{held:?}");
        assert!(held.words().contains("3 disagreements") && held.words().contains("of kind edge"));
    }
}
