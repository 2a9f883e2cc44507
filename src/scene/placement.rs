//! Where to stand and where to put the light when a scene does not say.

mod inside;
mod outside;

use super::{Camera, Scene};
use crate::random::unit;
use crate::surface::Surface;
use glam::DVec3;
use splitplane_core::backend::{Accelerator, QueryError};
use splitplane_core::ray::{Hit, QueryOptions, Ray};

/// A camera and a light for a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// From where to look.
    pub camera: Camera,
    /// The point light that casts shadows.
    pub light: [f32; 3],
    /// Why the camera is where it is.
    pub view: View,
}

/// How a camera came to its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// The scene brought its camera.
    Given,
    /// From outside, all of the scene in the picture.
    Outside,
    /// From inside: the scene hides its inside from every side.
    Inside,
}

impl View {
    /// The view in words.
    pub const fn name(self) -> &'static str {
        match self {
            View::Given => "the scene's own",
            View::Outside => "from outside",
            View::Inside => "from inside",
        }
    }
}

impl Placement {
    /// Part of the rays from surfaces that gets away, below which a scene is an interior. Objects let
    /// 0.3 to 0.4 go (half the rays start into the object), an open arena 0.08, rooms 0.02 and less.
    pub const INTERIOR_ESCAPES: f64 = 0.045;

    /// A camera and a light for the scene.
    ///
    /// A scene that brings both keeps them. Else rays that leave sampled triangles in random
    /// directions decide: where less than [`Placement::INTERIOR_ESCAPES`] of them get away, the
    /// scene is an interior. Outside, the camera stands to the front right above, at the distance
    /// from which everything just fits, ground planes left out. Inside, the best of some hundred
    /// places and directions is taken: far sight, much detail, nothing right before the lens. The
    /// light is above and to the left of the eye, inside at a place that reaches what the eye sees.
    /// `aspect` is the picture's width over its height.
    ///
    /// # Errors
    /// The accelerator refuses the rays.
    pub fn of(
        scene: &Scene,
        accelerator: &dyn Accelerator,
        aspect: f64,
    ) -> Result<Placement, QueryError> {
        if let (Some(camera), Some(light)) = (scene.camera, scene.light) {
            return Ok(Placement { camera, light, view: View::Given });
        }
        let interior = is_interior(scene, accelerator)?;
        if interior && let Some(placement) = inside::place(scene, accelerator)? {
            return Ok(placement);
        }
        Ok(outside::place(scene, aspect))
    }
}

const SEED: u64 = 11;
const PROBES: usize = 512;

fn is_interior(scene: &Scene, accelerator: &dyn Accelerator) -> Result<bool, QueryError> {
    let stride = scene.indices.len().div_ceil(PROBES).max(1);
    let mut rays = Vec::new();
    for (i, corners) in scene.triangles().step_by(stride).enumerate() {
        let direction = random_direction(i as u64);
        let middle = Hit { t: 0.0, triangle: 0, u: 1.0 / 3.0, v: 1.0 / 3.0 };
        let against = (-direction).as_vec3().to_array();
        if let Some(surface) = Surface::new(corners, &middle, against) {
            rays.push(Ray::new(surface.start(), direction.as_vec3().to_array()));
        }
    }
    if rays.is_empty() {
        return Ok(false);
    }
    let mut stopped = vec![false; rays.len()];
    accelerator.any_hits(&rays, &mut stopped, &QueryOptions::default())?;
    let escaped = stopped.iter().filter(|stopped| !**stopped).count();
    Ok((escaped as f64) < Placement::INTERIOR_ESCAPES * rays.len() as f64)
}

/// A direction by number, evenly spread over the sphere.
fn random_direction(number: u64) -> DVec3 {
    (0..64)
        .map(|attempt| {
            let part = |axis| 2.0 * unit(SEED, &[number, attempt, axis]) - 1.0;
            DVec3::new(part(0), part(1), part(2))
        })
        .find(|v| (1e-4..=1.0).contains(&v.length_squared()))
        .map_or(DVec3::Y, DVec3::normalize)
}
