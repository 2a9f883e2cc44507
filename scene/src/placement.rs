//! Where to stand and where to put lights when a scene does not say.

mod inside;
mod outside;

use super::{Camera, Light, Scene};
use crate::surface::Surface;
use glam::DVec3;
use splitplane_core::backend::Accelerator;
use splitplane_core::error::QueryError;
use splitplane_core::random::unit;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_float_state::standard;

/// A camera and lights for a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// From where to look.
    pub camera: Camera,
    /// The lights without a size. Empty for a scene that only its surfaces light.
    pub lights: Vec<Light>,
    /// Why the camera is where it is.
    pub view: View,
    /// Whether the scene is an interior, which hides its inside from every side.
    pub inside: bool,
}

/// How a camera came to its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
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

    /// Most lights that are placed.
    pub const MAX_LIGHTS: usize = 8;

    /// Part of the irradiance that comes from the first of several lights.
    pub const FIRST_LIGHT: f32 = 0.6;

    /// A camera and one light for the scene; see [`Placement::of_with`].
    ///
    /// # Errors
    /// The accelerator refuses the rays.
    pub fn of(
        scene: &Scene,
        accelerator: &dyn Accelerator,
        aspect: f64,
    ) -> Result<Placement, QueryError> {
        standard(|| Placement::of_with(scene, accelerator, aspect, 1))
    }

    /// A camera and lights for the scene.
    ///
    /// A camera that the scene brings stays, and so do its lights: when it brings any, or has
    /// surfaces that shine, none is added.
    ///
    /// Else rays that leave sampled triangles in random directions decide: where less than
    /// [`Placement::INTERIOR_ESCAPES`] of them get away, the scene is an interior. Outside, the
    /// camera stands to the front right above, at the distance from which everything just fits,
    /// ground planes left out. Inside, the best of some hundred places and directions is taken: far
    /// sight, much detail, nothing right before the lens. `aspect` is the picture's width over its
    /// height.
    ///
    /// `lights`, from 1 to [`Placement::MAX_LIGHTS`], is how many point lights are placed. The
    /// first is above and to the left of the eye, inside at a place that reaches what the eye sees.
    /// Further ones are placed, outside at equal angles around the point looked at, inside where
    /// they reach most of what is seen and not yet lit; there may be fewer then. Together they give
    /// [`Light::DAYLIGHT`] to a surface that faces them: outside at the point looked at, inside at
    /// the median of the seen points that a light reaches; [`Placement::FIRST_LIGHT`] of it comes
    /// from the first, the rest in equal parts from the others.
    ///
    /// # Errors
    /// The accelerator refuses the rays.
    pub fn of_with(
        scene: &Scene,
        accelerator: &dyn Accelerator,
        aspect: f64,
        lights: usize,
    ) -> Result<Placement, QueryError> {
        standard(|| {
            let is_lit = scene.is_lit();
            let interior = is_interior(scene, accelerator)?;
            if let (Some(camera), true) = (scene.camera, is_lit) {
                let (lights, view) = (scene.lights.clone(), View::Given);
                return Ok(Placement { camera, lights, view, inside: interior });
            }
            let lights = lights.clamp(1, Placement::MAX_LIGHTS);
            let inner = match scene.camera {
                Some(camera) if interior => Some(camera),
                None if interior => inside::camera(scene, accelerator)?,
                _ => None,
            };
            let (camera, view, placed) = match inner {
                Some(camera) if is_lit => (camera, View::Inside, Vec::new()),
                Some(camera) => {
                    (camera, View::Inside, inside::lights(scene, accelerator, &camera, lights)?)
                }
                None => {
                    let outer = outside::camera(scene, aspect);
                    (outer, View::Outside, outside::lights(&outer, lights))
                }
            };
            Ok(Placement {
                camera: scene.camera.unwrap_or(camera),
                lights: if is_lit { scene.lights.clone() } else { placed },
                view: if scene.camera.is_some() { View::Given } else { view },
                inside: interior,
            })
        })
    }
}

/// A camera and lights for a scene that is looked at from outside, in which no ray is followed.
pub(crate) fn outside_of(scene: &Scene, aspect: f64, lights: usize) -> Placement {
    let (own, count) = (scene.camera, lights.clamp(1, Placement::MAX_LIGHTS));
    let camera = own.unwrap_or_else(|| outside::camera(scene, aspect));
    let lights =
        if scene.is_lit() { scene.lights.clone() } else { outside::lights(&camera, count) };
    let view = if own.is_some() { View::Given } else { View::Outside };
    Placement { camera, lights, view, inside: false }
}

/// What one of several lights gives.
fn share(number: usize, count: usize) -> [f32; 3] {
    let part = match (number, count) {
        (_, 1) => 1.0,
        (0, _) => Placement::FIRST_LIGHT,
        _ => (1.0 - Placement::FIRST_LIGHT) / (count - 1) as f32,
    };
    Light::DAYLIGHT.map(|whole| part * whole)
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
