//! The rays of a frame, for backends that trace the same ones.

use glam::DVec3;
use rayon::prelude::*;
use splitplane::scene::Scene;
use splitplane_core::backend::Accelerator;
use splitplane_core::error::QueryError;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_render::{Light, Size};
use splitplane_scene::surface::Surface;

/// Camera rays of a picture, and a ray from every surface they meet to every light on its side.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameRays {
    /// One through the centre of each pixel; their closest hits are wanted.
    pub camera: Vec<Ray>,
    /// Whether they hit anything is wanted.
    pub shadow: Vec<Ray>,
}

impl FrameRays {
    /// The rays of a picture of a scene that has a camera and its lights.
    ///
    /// # Errors
    /// The accelerator refuses the rays.
    pub fn of(
        scene: &Scene,
        camera: &splitplane::scene::Camera,
        size: Size,
        accelerator: &dyn Accelerator,
    ) -> Result<FrameRays, QueryError> {
        let camera = camera.rays(size.width(), size.height());
        let mut hits = vec![Hit::MISS; camera.len()];
        accelerator.closest_hits(&camera, &mut hits, &QueryOptions::default())?;
        let shadow = camera
            .par_iter()
            .zip(&hits)
            .flat_map_iter(|(ray, hit)| {
                let surface = if hit.is_hit() { scene.corners(hit.triangle) } else { None }
                    .and_then(|corners| Surface::new(corners, hit, ray.direction));
                surface.into_iter().flat_map(|surface| {
                    scene.lights.iter().filter_map(move |light| towards(&surface, light))
                })
            })
            .collect();
        Ok(FrameRays { camera, shadow })
    }

    /// All rays.
    pub fn len(&self) -> usize {
        self.camera.len() + self.shadow.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A name of these rays: XXH64 over their bits, camera rays first. Equal rays have equal names.
    pub fn digest(&self) -> String {
        let mut state = splitplane_core::tree::digest::Xxh64::new(0);
        state.write_words(&[self.camera.len() as u32, self.shadow.len() as u32]);
        for ray in self.camera.iter().chain(&self.shadow) {
            state.write_words(&ray.origin.map(f32::to_bits));
            state.write_words(&ray.direction.map(f32::to_bits));
            state.write_words(&[ray.t_min.to_bits(), ray.t_max.to_bits()]);
        }
        format!("{:016x}", state.finish())
    }
}

/// The ray from a surface to a light, if the light is on its side.
pub(crate) fn towards(surface: &Surface, light: &Light) -> Option<Ray> {
    let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    match *light {
        Light::Directional { towards, .. } => {
            let faces = surface.normal.dot(vector(towards)) > 0.0;
            faces.then(|| Ray::new(surface.start(), towards))
        }
        Light::Point { position, .. } => {
            let faces = surface.normal.dot(vector(position) - surface.point) > 0.0;
            faces.then(|| Ray::segment(surface.start(), position))
        }
        _ => None,
    }
}
