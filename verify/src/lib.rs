//! Checks of a backend's answers against a reference in f64 that shares no code with it.
//!
//! Three kinds of rays are sent: random chords of the bounding sphere, rays aimed at points of
//! edges, and rays aimed at vertices. An f32 backend cannot always give the reference's answer: its
//! coordinates relative to the ray's origin are rounded. The bound used here is
//! `delta = 2^-20 m`, `m` being the greatest coordinate, relative to the origin, of the corners
//! concerned: sixteen roundings to f32 of that distance, across the ray. A hit whose `t` and weights
//! do not mean the same point within that bound is never accepted. Else an answer that differs is
//! *explained* when
//! - it is nearer than the right one, and the ray passes within `delta` of it, or
//! - it is farther or a miss, and some ray within `delta` meets nothing nearer either, or
//! - the hit that was lost is within `delta` of an edge that only one triangle has: where triangles
//!   merely touch, no test promises to close the seam.
//!
//! A hole between two triangles that share an edge is therefore never explained: around it, every
//! ray hits.

#![forbid(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]

#[doc(hidden)]
pub mod bound;
mod objects;
#[cfg(feature = "parity")]
pub mod parity;
#[doc(hidden)]
pub mod rays;
pub mod reference;

use bound::Bound;
use rayon::prelude::*;
use reference::{Hit64, Ray64, Reference};
use splitplane_core::backend::Accelerator;
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};

pub use objects::{ObjectsReport, check_objects, rays_of};
pub use rays::Aim;

/// Rays of a batch.
const BATCH: u64 = 1 << 14;
/// Triangle tests spent on checking the reference itself by brute force.
const SPOT_TESTS: u64 = 50_000_000;

/// What a check found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Report {
    /// Rays traced.
    pub rays: u64,
    /// Hits on both sides at distances further apart than the bound. Another triangle at the same
    /// distance is an equal answer.
    pub mismatches: u64,
    /// Rays that hit by the reference and were lost by the backend.
    pub misses: u64,
    /// Rays that hit nothing by the reference, or a point that is not on the triangle named.
    pub phantoms: u64,
    /// Those of the above that no ray within the bound explains, any-hit answers that contradict
    /// the closest hit, and faults of the reference itself.
    pub unexplained: u64,
    /// Rays on which the reference's hierarchy was compared with its brute force.
    pub spot_checks: u64,
    /// The first unexplained answer, in words that allow to repeat it.
    pub first: Option<String>,
}

/// Traces `per_aim` rays of every kind and compares each answer with the reference. `progress` is
/// called with the number of rays of every batch.
///
/// # Errors
/// The accelerator refuses the rays.
pub fn check(
    accelerator: &dyn Accelerator,
    mesh: &Mesh<'_>,
    per_aim: u64,
    options: &QueryOptions<'_>,
    progress: &dyn Fn(u64),
) -> Result<Report, QueryError> {
    let reference = Reference::new(mesh);
    let mut report = Report::default();
    if reference.is_empty() {
        return Ok(report);
    }
    let mut spots = (SPOT_TESTS / reference.len() as u64).max(16);
    let generator = rays::Generator::new(&reference);
    for aim in Aim::ALL {
        for first in (0..per_aim).step_by(BATCH as usize) {
            let numbers = first..per_aim.min(first + BATCH);
            let rays: Vec<Ray> =
                numbers.into_par_iter().map(|number| generator.ray(aim, number)).collect();
            let mut hits = vec![Hit::MISS; rays.len()];
            accelerator.closest_hits(&rays, &mut hits, options)?;
            let mut any = vec![false; rays.len()];
            accelerator.any_hits(&rays, &mut any, options)?;
            // A third of the spot checks for every kind of ray.
            let by_hand = (spots / 3).min(rays.len() as u64);
            let judge = Judge { reference: &reference, mesh };
            let verdicts: Vec<Verdict> = (0..rays.len())
                .into_par_iter()
                .map(|i| judge.verdict(&rays[i], &hits[i], any[i], (i as u64) < by_hand))
                .collect();
            spots -= by_hand;
            report.spot_checks += by_hand;
            for ((ray, hit), verdict) in rays.iter().zip(&hits).zip(verdicts) {
                report.add(aim, ray, hit, verdict, &reference);
            }
            progress(rays.len() as u64);
        }
    }
    Ok(report)
}

/// The rays that [`check`] sends, `per_aim` of every kind; none for a mesh without triangles.
pub fn rays(mesh: &Mesh<'_>, per_aim: u64) -> Vec<Ray> {
    let reference = Reference::new(mesh);
    if reference.is_empty() {
        return Vec::new();
    }
    let generator = rays::Generator::new(&reference);
    Aim::ALL
        .into_iter()
        .flat_map(|aim| (0..per_aim).map(move |number| (aim, number)))
        .map(|(aim, number)| generator.ray(aim, number))
        .collect()
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Agrees,
    Mismatch { explained: bool },
    Miss { explained: bool },
    Phantom { explained: bool },
    Contradiction,
    ReferenceFault,
}

impl Report {
    /// True when nothing is left unexplained.
    pub fn passed(&self) -> bool {
        self.unexplained == 0
    }

    fn add(&mut self, aim: Aim, ray: &Ray, hit: &Hit, verdict: Verdict, reference: &Reference) {
        self.rays += 1;
        let explained = match verdict {
            Verdict::Agrees => return,
            Verdict::Mismatch { explained } => {
                self.mismatches += 1;
                explained
            }
            Verdict::Miss { explained } => {
                self.misses += 1;
                explained
            }
            Verdict::Phantom { explained } => {
                self.phantoms += 1;
                explained
            }
            Verdict::Contradiction | Verdict::ReferenceFault => false,
        };
        if !explained {
            self.unexplained += 1;
            self.first.get_or_insert_with(|| {
                let truth = reference.closest(&Ray64::from(ray));
                format!(
                    "{verdict:?}: {ray:?}, aimed at {aim:?}, was answered by {hit:?}, the \
                     reference says {truth:?}"
                )
            });
        }
    }
}

struct Judge<'a> {
    reference: &'a Reference,
    mesh: &'a Mesh<'a>,
}

impl Judge<'_> {
    fn verdict(&self, ray: &Ray, hit: &Hit, any: bool, by_hand: bool) -> Verdict {
        let exact = Ray64::from(ray);
        let truth = self.reference.closest(&exact);
        if by_hand && truth != self.reference.closest_by_brute_force(&exact) {
            return Verdict::ReferenceFault;
        }
        if any != hit.is_hit() {
            return Verdict::Contradiction;
        }
        let Some(hit) = hit.some() else {
            return match truth {
                None => Verdict::Agrees,
                Some(truth) => {
                    let bound = self.bound(&exact, truth.triangle);
                    let explained = self.around(&exact, bound.across, |near| near.is_none())
                        || self.at_open_edge(&exact, &truth, bound.across);
                    Verdict::Miss { explained }
                }
            };
        };
        if hit.triangle as usize >= self.mesh.len() {
            return Verdict::Phantom { explained: false };
        }
        let bound = self.bound(&exact, hit.triangle);
        if !bound.holds(&exact, &hit) {
            return Verdict::Phantom { explained: false };
        }
        let t = f64::from(hit.t);
        let agrees = |near: &Hit64, own: &Bound| {
            let slack = if near.triangle == hit.triangle { 0.0 } else { own.along };
            (near.t - t).abs() <= bound.along + slack
        };
        let nearer_than_anything = || {
            bound.touches(&exact, &hit)
                || self.around(&exact, bound.across, |near| {
                    near.is_some_and(|near| agrees(&near, &self.bound(&exact, near.triangle)))
                })
        };
        let Some(truth) = truth else {
            return Verdict::Phantom { explained: nearer_than_anything() };
        };
        let other = self.bound(&exact, truth.triangle);
        if agrees(&truth, &other) {
            return Verdict::Agrees;
        }
        if t < truth.t {
            return Verdict::Mismatch { explained: nearer_than_anything() };
        }
        // The near ray need not meet the triangle that was hit: every triangle's test is rounded on
        // its own.
        let nothing_nearer = |near: Option<Hit64>| {
            near.is_none_or(|near| {
                near.t >= t - bound.along - self.bound(&exact, near.triangle).along
            })
        };
        let explained = self.around(&exact, bound.across.max(other.across), nothing_nearer)
            || self.at_open_edge(&exact, &truth, other.across);
        Verdict::Mismatch { explained }
    }

    /// Whether a hit lies within `distance` of an edge that no other triangle has.
    fn at_open_edge(&self, ray: &Ray64, hit: &Hit64, distance: f64) -> bool {
        let corners = self.mesh.triangle(hit.triangle as usize);
        let close = bound::edges_within(ray, hit, corners, distance);
        let shared = |[a, b]: [[f32; 3]; 2]| {
            (0..self.mesh.len()).any(|other| {
                let others = self.mesh.triangle(other);
                other != hit.triangle as usize && others.contains(&a) && others.contains(&b)
            })
        };
        close.into_iter().any(|edge| !shared(edge))
    }

    fn bound(&self, ray: &Ray64, triangle: u32) -> Bound {
        Bound::new(ray, self.mesh.triangle(triangle as usize))
    }

    /// Whether the reference's answer to some ray within `distance` satisfies the condition. Rings
    /// of rays stand for all.
    fn around(
        &self,
        ray: &Ray64,
        distance: f64,
        condition: impl Fn(Option<Hit64>) -> bool,
    ) -> bool {
        bound::rings(ray, distance).any(|near| condition(self.reference.closest(&near)))
    }
}
