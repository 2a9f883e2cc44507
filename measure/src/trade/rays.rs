//! The rays that are timed and the rays whose answers are judged.

use super::row::{Aims, Sets};
use crate::paper::rays::towards;
use crate::paper::scene::Placed;
use glam::DVec3;
use rayon::prelude::*;
use splitplane::scene::Scene;
use splitplane_core::backend::Accelerator;
use splitplane_core::error::QueryError;
use splitplane_core::random::{hash, unit};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::tree::digest::Xxh64;
use splitplane_render::Light;
use splitplane_scene::surface::Surface;
use splitplane_verify::Aim;
use splitplane_verify::rays::Generator;
use splitplane_verify::reference::Reference;

const SEED: u64 = 2008;
/// Width of the picture over its height.
pub const ASPECT: f64 = 4.0 / 3.0;

/// The timed rays.
pub type RaySets = Sets<Vec<Ray>>;

/// A surface that the camera sees, with the number of its pixel.
type Seen = (u64, Surface);

/// The timed rays of a scene, at most `count` of each set: a picture of so many pixels, one ray through
/// each; for every surface seen, a ray towards a light above it (the lights take turns; without any, a
/// point of a surface that shines) and one into a direction above it, more often steep than flat, as
/// diffuse surfaces scatter; and chords of the sphere around the scene.
///
/// # Errors
/// The accelerator refuses the rays.
pub fn timed(
    placed: &Placed,
    accelerator: &dyn Accelerator,
    reference: &Reference,
    count: usize,
) -> Result<RaySets, QueryError> {
    let scene = &placed.scene;
    let height = ((count as f64 / ASPECT).sqrt() as u32).max(1);
    let width = (count as u32 / height).max(1);
    let primary = placed.camera.rays(width, height);
    let mut hits = vec![Hit::MISS; primary.len()];
    accelerator.closest_hits(&primary, &mut hits, &QueryOptions::default())?;
    let seen: Vec<Seen> = primary
        .par_iter()
        .zip(&hits)
        .enumerate()
        .filter_map(|(pixel, (ray, hit))| {
            let corners = hit.is_hit().then(|| scene.corners(hit.triangle)).flatten()?;
            Some((pixel as u64, Surface::new(corners, hit, ray.direction)?))
        })
        .collect();
    let lights = Lights::of(scene);
    let generator = Generator::new(reference);
    let chords = 0..count as u64;
    Ok(Sets {
        shadow: seen.par_iter().filter_map(|seen| lights.ray(scene, seen)).collect(),
        bounce: seen.par_iter().map(scattered).collect(),
        random: chords.into_par_iter().map(|i| generator.ray(Aim::Random, i)).collect(),
        primary,
    })
}

/// The rays that are judged, `count` of each kind; of the timed rays of the camera, off surfaces and towards lights as many as
/// there are, evenly spread over the picture.
pub fn judged(reference: &Reference, sets: &RaySets, count: u64) -> Aims<Vec<Ray>> {
    let generator = Generator::new(reference);
    // Chords that are timed are not the ones that are judged.
    let first = |aim| if aim == Aim::Random { 1 << 32 } else { 0 };
    let [random, edge, vertex] = Aim::ALL.map(|aim| {
        let numbers = first(aim)..first(aim) + count;
        numbers.into_par_iter().map(|number| generator.ray(aim, number)).collect()
    });
    let spread = |rays: &Vec<Ray>| {
        let count = (count as usize).min(rays.len());
        (0..count).map(|i| rays[i * rays.len() / count]).collect()
    };
    let [primary, bounce, shadow] = [&sets.primary, &sets.bounce, &sets.shadow].map(spread);
    Aims { random, edge, vertex, primary, bounce, shadow }
}

/// A name of rays: XXH64 over their bits. Equal rays have equal names.
pub fn digest<'a>(sets: impl IntoIterator<Item = &'a Vec<Ray>>) -> String {
    let mut state = Xxh64::new(0);
    for rays in sets {
        state.write_words(&[rays.len() as u32]);
        for ray in rays {
            state.write_words(&ray.origin.map(f32::to_bits));
            state.write_words(&ray.direction.map(f32::to_bits));
            state.write_words(&[ray.t_min.to_bits(), ray.t_max.to_bits()]);
        }
    }
    format!("{:016x}", state.finish())
}

/// A ray off the surface, directions by the cosine to its normal.
fn scattered((pixel, surface): &Seen) -> Ray {
    let (angle, height) =
        (std::f64::consts::TAU * unit(SEED, &[*pixel, 0]), 2.0 * unit(SEED, &[*pixel, 1]) - 1.0);
    let flat = (1.0 - height * height).max(0.0).sqrt();
    let on_sphere = DVec3::new(flat * angle.cos(), flat * angle.sin(), height);
    // A point of the sphere that touches the surface: of all directions to it, by the cosine.
    let direction = (surface.normal + on_sphere).try_normalize().unwrap_or(surface.normal);
    Ray::new(surface.start(), direction.as_vec3().to_array())
}

/// What shadow rays go to.
enum Lights<'a> {
    /// Lights without a size.
    Points(&'a [Light]),
    /// Triangles that shine.
    Shining(Vec<u32>),
}

impl Lights<'_> {
    fn of(scene: &Scene) -> Lights<'_> {
        if !scene.lights.is_empty() {
            return Lights::Points(&scene.lights);
        }
        let shines = |&triangle: &u32| scene.material(triangle as usize).shines();
        Lights::Shining((0..scene.indices.len() as u32).filter(shines).collect())
    }

    /// The ray from a surface to one of them; none when that is behind the surface.
    fn ray(&self, scene: &Scene, (pixel, surface): &Seen) -> Option<Ray> {
        match self {
            Lights::Points(lights) => towards(surface, &lights[*pixel as usize % lights.len()]),
            Lights::Shining(triangles) => {
                let place = hash(SEED, &[*pixel, 2]) % (triangles.len() as u64).max(1);
                let corners = scene.corners(*triangles.get(place as usize)?)?;
                let [a, b, c] = corners.map(|p| DVec3::from_array(p.map(f64::from)));
                let (u, v) = (unit(SEED, &[*pixel, 3]), unit(SEED, &[*pixel, 4]));
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let target = a + u * (b - a) + v * (c - a);
                let faces = surface.normal.dot(target - surface.point) > 0.0;
                // Short of the light, which would hide itself.
                let ray = Ray::segment(surface.start(), target.as_vec3().to_array());
                faces.then(|| ray.with_limits(0.0, 0.999))
            }
        }
    }
}
