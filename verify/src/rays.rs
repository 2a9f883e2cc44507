//! The rays of a check, each a function of its number.

use super::bound::sub;
use super::reference::Reference;
use splitplane_core::random::{hash, unit};
use splitplane_core::ray::Ray;

const SEED: u64 = 1968;

/// What a ray is aimed at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Aim {
    /// A chord of the bounding sphere.
    Random,
    /// A point on an edge, rounded to f32.
    Edge,
    /// A vertex.
    Vertex,
}

impl Aim {
    /// All kinds, in the order of a check.
    pub const ALL: [Aim; 3] = [Aim::Random, Aim::Edge, Aim::Vertex];
}

pub struct Generator<'a> {
    reference: &'a Reference,
    centre: [f64; 3],
    radius: f64,
}

impl<'a> Generator<'a> {
    pub fn new(reference: &'a Reference) -> Generator<'a> {
        let (lo, hi) = reference.bounds();
        let centre = std::array::from_fn(|k| 0.5 * lo[k] + 0.5 * hi[k]);
        let half = sub(hi, centre);
        // A little outside, so that a point mesh has chords too.
        let radius = 1.01 * half.iter().map(|x| x * x).sum::<f64>().sqrt() + f64::MIN_POSITIVE;
        Generator { reference, centre, radius }
    }

    /// Rays to edges and vertices start half from outside and half from within the bounds.
    pub fn ray(&self, aim: Aim, number: u64) -> Ray {
        let draw = |k: u64| unit(SEED, &[aim as u64, number, k]);
        let on_sphere = self.on_sphere(aim, number, 0);
        if aim == Aim::Random {
            return towards(on_sphere, self.on_sphere(aim, number, 1));
        }
        let place = hash(SEED, &[aim as u64, number, 90]) % self.reference.len() as u64;
        let corners = self.reference.corners(place as usize);
        let side = (draw(91) * 3.0) as usize;
        let (a, b) = (corners[side], corners[(side + 1) % 3]);
        let part = if aim == Aim::Edge { draw(92) } else { 0.0 };
        let target: [f64; 3] = std::array::from_fn(|k| a[k] + part * (b[k] - a[k]));
        let shrink = if number.is_multiple_of(2) { 1.0 } else { 0.5 * draw(93) };
        towards(
            std::array::from_fn(|k| self.centre[k] + shrink * (on_sphere[k] - self.centre[k])),
            target,
        )
    }

    fn on_sphere(&self, aim: Aim, number: u64, which: u64) -> [f64; 3] {
        for attempt in 0..64 {
            let key = 100 + 200 * which + 3 * attempt;
            let p: [f64; 3] = std::array::from_fn(|k| {
                2.0 * unit(SEED, &[aim as u64, number, key + k as u64]) - 1.0
            });
            let square = p.iter().map(|x| x * x).sum::<f64>();
            if (1e-4..=1.0).contains(&square) {
                let scale = self.radius / square.sqrt();
                return std::array::from_fn(|k| self.centre[k] + scale * p[k]);
            }
        }
        std::array::from_fn(|k| self.centre[k] + if k == 0 { self.radius } else { 0.0 })
    }
}

/// The ray between two points, both rounded first, so that the direction is that between what was
/// rounded.
fn towards(from: [f64; 3], to: [f64; 3]) -> Ray {
    let [from, to] = [from, to].map(|point| point.map(|x| x as f32));
    let direction = std::array::from_fn(|k| (f64::from(to[k]) - f64::from(from[k])) as f32);
    Ray::new(from, direction)
}
