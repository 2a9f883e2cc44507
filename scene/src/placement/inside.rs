//! A view from within: the best of many places and directions, judged by small previews.

use super::share;
use crate::surface::Surface;
use crate::{Camera, Light, Scene};
use glam::DVec3;
use splitplane_core::backend::Accelerator;
use splitplane_core::error::QueryError;
use splitplane_core::ray::{Hit, QueryOptions, Ray};

const FOV: f32 = 62.0;
/// Pixels of a preview.
const PREVIEW: [u32; 2] = [24, 16];
/// Places to try, in parts of the box that holds most triangles.
const ACROSS: [f64; 6] = [0.04, 0.22, 0.40, 0.60, 0.78, 0.96];
const HEIGHTS: [f64; 3] = [0.3, 0.5, 0.7];
/// Part of the triangles on either side that this box leaves out.
const OUTLIERS: f64 = 0.03;
const DIRECTIONS: u32 = 12;

/// `None` when no place inside sees anything.
pub(super) fn camera(
    scene: &Scene,
    accelerator: &dyn Accelerator,
) -> Result<Option<Camera>, QueryError> {
    let bounds = scene.bounds();
    let [near, far] = crowded(scene);
    let mut best: Option<(f64, Camera)> = None;
    for height in HEIGHTS {
        for x in ACROSS {
            for z in ACROSS {
                let eye = near + (far - near) * DVec3::new(x, height, z);
                for (score, camera) in views(scene, accelerator, eye, bounds.diagonal())? {
                    if best.is_none_or(|(least, _)| score > least) {
                        best = Some((score, camera));
                    }
                }
            }
        }
    }
    Ok(best.map(|(_, camera)| camera))
}

/// The box that holds the middles of nearly all triangles: where there is something to see.
fn crowded(scene: &Scene) -> [DVec3; 2] {
    let finite = |corners: &[[f32; 3]; 3]| corners.as_flattened().iter().all(|x| x.is_finite());
    let middles: Vec<DVec3> = scene
        .triangles()
        .filter(finite)
        .map(|corners| corners.iter().map(|p| DVec3::from_array(p.map(f64::from))).sum::<DVec3>())
        .map(|sum| sum / 3.0)
        .collect();
    let skip = (OUTLIERS * middles.len() as f64) as usize;
    let (mut near, mut far) = (DVec3::ZERO, DVec3::ZERO);
    for axis in 0..3 {
        let mut along: Vec<f64> = middles.iter().map(|middle| middle[axis]).collect();
        along.sort_unstable_by(f64::total_cmp);
        near[axis] = along.get(skip).copied().unwrap_or(0.0);
        far[axis] = along.iter().rev().nth(skip).copied().unwrap_or(0.0);
    }
    [near, far]
}

/// The directions from one place, all previews in one batch, with their scores.
fn views(
    scene: &Scene,
    accelerator: &dyn Accelerator,
    eye: DVec3,
    diagonal: f64,
) -> Result<Vec<(f64, Camera)>, QueryError> {
    let [width, height] = PREVIEW;
    let cameras: Vec<Camera> = (0..DIRECTIONS)
        .filter_map(|i| {
            let angle = f64::from(i) / f64::from(DIRECTIONS) * std::f64::consts::TAU;
            // A little downwards: floors and what stands on them say more than ceilings.
            let ahead = DVec3::new(angle.cos(), -0.12, angle.sin()) * diagonal * 0.1;
            let [eye, at] = [eye, eye + ahead].map(|p| p.as_vec3().to_array());
            Camera::new(eye, at, [0.0, 1.0, 0.0], FOV).ok()
        })
        .collect();
    let rays: Vec<Ray> = cameras.iter().flat_map(|camera| camera.rays(width, height)).collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    accelerator.closest_hits(&rays, &mut hits, &QueryOptions::default())?;
    let previews = hits.chunks((width * height) as usize);
    Ok(cameras
        .into_iter()
        .zip(previews)
        .map(|(camera, hits)| (score(scene, hits, diagonal), camera))
        .collect())
}

/// How much a view shows: sight as the mean of the distances' square roots, so that one long
/// corridor does not outweigh a room; detail as the number of triangles seen and the entropy of
/// materials. Free space before the lens counts up to a small distance.
fn score(scene: &Scene, hits: &[Hit], diagonal: f64) -> f64 {
    let count = hits.len() as f64;
    let mut distances: Vec<f64> = hits.iter().map(|hit| f64::from(hit.t) / diagonal).collect();
    distances.sort_by(f64::total_cmp);
    let near = distances[distances.len() / 12].min(0.06) / 0.06;
    let sight = distances.iter().map(|t| t.min(0.6).sqrt()).sum::<f64>() / count;
    let missed = hits.iter().filter(|hit| !hit.is_hit()).count() as f64 / count;
    let mut triangles: Vec<u32> = hits.iter().map(|hit| hit.triangle).collect();
    triangles.sort_unstable();
    triangles.dedup();
    let detail = triangles.len() as f64 / count;
    let mut materials: Vec<u32> = hits
        .iter()
        .filter_map(|hit| scene.material_of.get(hit.triangle as usize).copied())
        .collect();
    materials.sort_unstable();
    let entropy: f64 = materials
        .chunk_by(|a, b| a == b)
        .map(|run| run.len() as f64 / count)
        .map(|part| -part * part.log2())
        .sum();
    near * sight * (0.2 + detail) * (1.0 + 0.5 * entropy) * (1.0 - missed).max(0.0)
}

/// A place for a light, and which of the seen points it reaches.
struct Spot {
    at: DVec3,
    reaches: Vec<bool>,
}

/// The first light is the first place, from high to low and from the eye forward, that reaches a
/// fair part of what the eye sees; else the one that reaches most. Every further one is the place
/// that adds most: a point that `n` lights reach already counts `1 / (1 + n)^2`.
pub(super) fn lights(
    scene: &Scene,
    accelerator: &dyn Accelerator,
    camera: &Camera,
    count: usize,
) -> Result<Vec<Light>, QueryError> {
    let seen = seen(scene, accelerator, camera)?;
    let mut spots: Vec<Spot> = Vec::new();
    let mut first = None;
    for at in places(scene, camera, &seen) {
        let reaches = reached(accelerator, &seen, at)?;
        let part = reaches.iter().filter(|reached| **reached).count() as f64;
        spots.push(Spot { at, reaches });
        let good = part > 0.6 * seen.len() as f64;
        if good && first.is_none() {
            first = Some(spots.len() - 1);
            if count == 1 {
                break;
            }
        }
    }
    let mut lit = vec![0u32; seen.len()];
    let mut chosen: Vec<Spot> = Vec::new();
    while chosen.len() < count && !spots.is_empty() {
        let gain = |spot: &Spot| -> f64 {
            let reached = spot.reaches.iter().zip(&lit).filter(|(reached, _)| **reached);
            reached.map(|(_, lit)| 1.0 / f64::from((1 + lit) * (1 + lit))).sum()
        };
        // The first of the best.
        let best = spots.iter().map(gain).enumerate().rev().max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((best, gain)) = best else { break };
        let place = match first.take() {
            Some(place) => place,
            // A place that adds nothing is no place, unless nothing is seen at all.
            None if gain > 0.0 || chosen.is_empty() => best,
            None => break,
        };
        let spot = spots.swap_remove(place);
        for (lit, reached) in lit.iter_mut().zip(&spot.reaches) {
            *lit += u32::from(*reached);
        }
        chosen.push(spot);
    }
    let count = chosen.len();
    let light = |(number, spot): (usize, Spot)| {
        let middle = median_reached(&seen, &spot);
        let [at, middle] = [spot.at, middle].map(|p| p.as_vec3().to_array());
        Light::point_for(at, middle, share(number, count))
    };
    Ok(chosen.into_iter().enumerate().map(light).collect())
}

/// What a coarse picture shows.
fn seen(
    scene: &Scene,
    accelerator: &dyn Accelerator,
    camera: &Camera,
) -> Result<Vec<Surface>, QueryError> {
    let rays = camera.rays(48, 32);
    let mut hits = vec![Hit::MISS; rays.len()];
    accelerator.closest_hits(&rays, &mut hits, &QueryOptions::default())?;
    let surface = |(ray, hit): (&Ray, &Hit)| {
        let corners = scene.corners(hit.is_hit().then_some(hit.triangle)?)?;
        Surface::new(corners, hit, ray.direction)
    };
    Ok(rays.iter().zip(&hits).filter_map(surface).collect())
}

/// Where a light may hang, the best guesses first.
fn places(scene: &Scene, camera: &Camera, seen: &[Surface]) -> Vec<DVec3> {
    let bounds = scene.bounds();
    let lo = DVec3::from_array(bounds.lo.map(f64::from));
    let size = DVec3::from_array(bounds.hi.map(f64::from)) - lo;
    let eye = DVec3::from_array(camera.eye().map(f64::from));
    let ahead = DVec3::from_array(camera.look_at().map(f64::from)) - eye;
    let ahead = DVec3::new(ahead.x, 0.0, ahead.z).normalize_or(DVec3::X);
    let side = ahead.cross(DVec3::Y);
    let mut distances: Vec<f64> = seen.iter().map(|s| (s.point - eye).length()).collect();
    distances.sort_by(f64::total_cmp);
    let middle = distances.get(distances.len() / 2).map_or(0.0, |d| d.min(size.length()));
    let above = [0.9, 0.8, 0.7, 0.6, 0.5].into_iter().flat_map(|height| {
        let spots = [(0.5, 0.25), (0.5, 0.0), (0.25, 0.2), (0.8, 0.0), (0.0, 0.0)];
        spots.map(|(forward, left)| {
            let spot = eye + ahead * (forward * middle) - side * (left * middle);
            DVec3::new(spot.x, lo.y + height * size.y, spot.z)
        })
    });
    // Over the shoulders and a little ahead, for narrow places under high roofs.
    let shoulder = move |[forward, left, up]: [f64; 3]| {
        eye + (ahead * forward - side * left + DVec3::Y * up) * middle
    };
    let near = [
        [0.0, 0.12, 0.2],
        [0.0, -0.12, 0.2],
        [0.0, 0.04, 0.06],
        [0.0, -0.04, 0.06],
        [0.3, 0.1, 0.15],
        [0.3, -0.1, 0.15],
        [0.6, 0.1, 0.2],
        [0.6, -0.1, 0.2],
        [0.3, 0.0, 0.4],
        [-0.1, 0.0, 0.1],
    ];
    above.chain(near.map(shoulder)).collect()
}

/// Which of the points a light would reach: on its side of the surface, with nothing between.
fn reached(
    accelerator: &dyn Accelerator,
    seen: &[Surface],
    light: DVec3,
) -> Result<Vec<bool>, QueryError> {
    let target = light.as_vec3().to_array();
    let rays: Vec<Ray> = seen.iter().map(|s| Ray::segment(s.start(), target)).collect();
    let mut dark = vec![false; rays.len()];
    accelerator.any_hits(&rays, &mut dark, &QueryOptions::default())?;
    let faces = |s: &Surface| s.normal.dot(light - s.point) > 0.0;
    Ok(dark.iter().zip(seen).map(|(dark, s)| !dark && faces(s)).collect())
}

/// The point at the median distance of those that a light reaches: half of them get more light than
/// it, half less.
fn median_reached(seen: &[Surface], spot: &Spot) -> DVec3 {
    let reached = seen.iter().zip(&spot.reaches).filter(|(_, reached)| **reached);
    let mut points: Vec<DVec3> = reached.map(|(surface, _)| surface.point).collect();
    let distance = |p: &DVec3| (*p - spot.at).length_squared();
    points.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    points.get(points.len() / 2).copied().unwrap_or(spot.at + DVec3::Y)
}
