//! Answers that are judged, and the exact ones that they are judged by.

use crate::trade::TradeError;
use crate::trade::judge::Judge;
use crate::trade::row::{Aims, KINDS};
use splitplane_core::backend::Accelerator;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::watch::Watch;

/// The rays that are judged, and their exact answers.
pub(super) struct Judged<'a> {
    pub(super) rays: Aims<Vec<Ray>>,
    pub(super) exact: Aims<Vec<Hit>>,
    pub(super) judge: Judge<'a>,
}

/// The exact answers: those of the CPU backend at accuracy `exact`.
pub(super) fn exact_answers(
    tree: &dyn Accelerator,
    rays: &Aims<Vec<Ray>>,
    watch: &dyn Watch,
) -> Result<Aims<Vec<Hit>>, TradeError> {
    let options =
        QueryOptions { accuracy: Accuracy::Exact, watch: Some(watch), ..QueryOptions::default() };
    let mut exact: [Vec<Hit>; KINDS] = Default::default();
    for (exact, rays) in exact.iter_mut().zip(rays.each()) {
        exact.resize(rays.len(), Hit::MISS);
        tree.closest_hits(rays, exact, &options)?;
    }
    Ok(Aims::of(exact))
}

/// What only was asked for any hit, in hits that can be judged: the exact one where the answer is that of
/// the exact one, else a miss, or the closest hit of the same tree, which stands for what was met. One
/// that is a miss itself explains nothing: a hit of no place stands for it. The number is of rays left
/// undecided.
pub(super) fn any_answers(
    tree: &dyn Accelerator,
    rays: &[Ray],
    exact: &[Hit],
    options: &QueryOptions<'_>,
) -> Result<(Vec<Hit>, u64), TradeError> {
    let mut stopped = vec![false; rays.len()];
    let undecided = tree.any_hits(rays, &mut stopped, options)?.undecided;
    let answer = |((ray, exact), stopped): ((&Ray, &Hit), &bool)| {
        let mut hit = [Hit::MISS];
        match (*stopped, exact.is_hit()) {
            (true, false) => {
                tree.closest_hits(&[*ray], &mut hit, options)?;
                Ok(if hit[0].is_hit() { hit[0] } else { NOWHERE })
            }
            (true, true) => Ok(*exact),
            (false, _) => Ok(Hit::MISS),
        }
    };
    let hits: Result<Vec<Hit>, TradeError> =
        rays.iter().zip(exact).zip(&stopped).map(answer).collect();
    Ok((hits?, undecided))
}

/// Of the first triangle, at no distance.
const NOWHERE: Hit = Hit { t: f32::NAN, triangle: 0, u: f32::NAN, v: f32::NAN };
