//! Traces the photons of a pass, in slices, all of a slice by one bounce at a time.

use super::bounce::{Arrival, Photon, arrive};
use super::density::{Disks, REACH, shrink};
use super::emission::{Ball, Sources, emit};
use super::maps::{Maps, Stored};
use super::report::{PhotonEnergy, PhotonReport, add_to, of};
use super::tree::PointTrees;
use crate::cpu::traced::Traced;
use crate::error::RenderError;
use crate::layout::Path;
use crate::plan::Plan;
use crate::scene_words::SceneWords;
use crate::vector::Vector;
use crate::world::World;
use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_float_state::{Standard, standard};

/// Photons that are traced at a time.
const SLICE: u32 = 1 << 15;
/// Photons of a chunk, whose results stand together. What depends on it is the order of sums, so it is no setting.
const CHUNK: usize = 256;
/// Bytes of a photon that is stored.
const STORED: u64 = (size_of::<Vector>() + size_of::<Photon>()) as u64;

/// What photons are traced through, and how.
#[derive(Clone, Copy)]
pub(crate) struct Tracing<'a, W> {
    pub(crate) scene: SceneWords<'a>,
    pub(crate) world: W,
    pub(crate) bounds: Aabb,
    pub(crate) traced: Traced<'a>,
    pub(crate) plan: &'a Plan,
    pub(crate) query: QueryOptions<'a>,
    pub(crate) trees: &'a PointTrees,
}

/// What a chunk of photons gives.
#[derive(Default)]
struct Chunk {
    stored: [Stored; 2],
    rays: Vec<Ray>,
    paths: Vec<Path>,
    energy: PhotonEnergy,
}

/// Traces the photons of a pass, from 0, and adds to the report. `None` where nothing sends any.
///
/// # Errors
/// More memory than a plan allows, a watch that cancels, a backend that fails.
pub(crate) fn trace<W: World>(
    tracing: &Tracing<'_, W>,
    pass: u32,
    report: &mut PhotonReport,
) -> Result<Option<Maps>, RenderError> {
    let Tracing { scene, world, plan, query, trees, .. } = tracing;
    let settings = plan.settings();
    let Some(ball) = Ball::around(&tracing.bounds) else { return Ok(None) };
    let sources = Sources::new(scene, *world, ball, plan.photons());
    let photons = sources.photons();
    report.photons += u64::from(photons);
    report.exponent = ball.power;
    let mut stored = [Stored::default(), Stored::default()];
    for first in (0..photons).step_by(SLICE as usize) {
        let last = photons.min(first + SLICE);
        let slice: Vec<(Ray, Path)> = (first..last)
            .into_par_iter()
            .with_min_len(CHUNK)
            .filter_map(|photon| standard(|| emit(scene, *world, &sources, (pass, photon))))
            .collect();
        let (mut rays, mut paths): (Vec<Ray>, Vec<Path>) = slice.into_iter().unzip();
        for path in &paths {
            add_to(&mut report.energy.emitted, of(path.weight));
        }
        let mut wave = 0;
        while !rays.is_empty() {
            report.rays += rays.len() as u64;
            (rays, paths) = bounce(tracing, wave, (&rays, &paths), &mut stored, report)?;
            let kept = stored.iter().map(|own| own.photons.len() as u64).sum::<u64>();
            let (needed, allowed) = (kept * STORED, plan.buffer_bytes());
            if needed > allowed {
                return Err(RenderError::TooManyPhotons { photons: kept, needed, allowed });
            }
            wave += 1;
        }
    }
    let [caustics, global] = &stored;
    report.caustics += caustics.photons.len() as u64;
    report.global += global.photons.len() as u64;
    let disks = Disks { reach: ball.radius * REACH, part: shrink(pass), power: ball.power };
    let limits = (plan.buffer_bytes(), query.watch);
    Maps::new(trees, stored, disks, settings.neighbours, limits).map(Some)
}

/// Follows photons to what they meet next, and gives those that go on.
fn bounce<W: World>(
    tracing: &Tracing<'_, W>,
    wave: u32,
    (rays, paths): (&[Ray], &[Path]),
    stored: &mut [Stored; 2],
    report: &mut PhotonReport,
) -> Result<(Vec<Ray>, Vec<Path>), RenderError> {
    let Tracing { scene, world, traced, plan, query, .. } = tracing;
    let mut hits = vec![Hit::MISS; rays.len()];
    let (mut scene_hits, mut instances) = (Vec::new(), Vec::new());
    traced.closest_hits(rays, &mut hits, (&mut scene_hits, &mut instances), query)?;
    let depth = plan.settings().depth;
    let chunks: Vec<Chunk> = (0..rays.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let _state = Standard::set();
            let mut of_chunk = Chunk::default();
            for i in chunk * CHUNK..rays.len().min((chunk + 1) * CHUNK) {
                let met = (&hits[i], instances.get(i).copied().unwrap_or(0));
                let (photon, waves) = ((&rays[i], &paths[i]), (wave, depth));
                let energy = &mut of_chunk.energy;
                let Arrival { stored, next } = arrive(scene, *world, photon, met, waves, energy);
                if let Some((map, place, photon)) = stored {
                    of_chunk.stored[map as usize].places.push(place);
                    of_chunk.stored[map as usize].photons.push(photon);
                }
                if let Some((ray, path)) = next {
                    of_chunk.rays.push(ray);
                    of_chunk.paths.push(path);
                }
            }
            of_chunk
        })
        .collect();
    let (mut next_rays, mut next_paths) = (Vec::new(), Vec::new());
    for chunk in chunks {
        report.energy.add_all(&chunk.energy);
        next_rays.extend(chunk.rays);
        next_paths.extend(chunk.paths);
        for (all, own) in stored.iter_mut().zip(chunk.stored) {
            all.places.extend(own.places);
            all.photons.extend(own.photons);
        }
    }
    Ok((next_rays, next_paths))
}
