//! Pictures: one headlight, one light with hard shadows, and an even sky.
//!
//! Every surface scatters light evenly. Radiance is the sum of an ambient part that runs from
//! ground to sky with the normal's height, a headlight at the eye, and a point light whose shadow
//! is one any-hit ray a pixel; none of them falls off with distance. Linear radiance `x` goes
//! through `x (1 + x / 4) / (1 + x)` (Reinhard et al. 2002, white at 2) and a gamma of 2. Only
//! `+ - * /` and square roots are used, so equal hits give equal bytes on any machine.
//!
//! Pixels that differ from a neighbour get four more rays.

use crate::scene::{Camera, Light, Placement, Scene};
use crate::surface::Surface;
use glam::{DVec3, Vec3};
use image::RgbImage;
use rayon::prelude::*;
use splitplane_core::backend::{Accelerator, QueryError};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use std::time::{Duration, Instant};
use thiserror::Error;

/// Greatest width and height of a picture.
pub const MAX_SIDE: u32 = 16_384;
/// Most pixels of a picture.
pub const MAX_PIXELS: u64 = 1 << 26;

/// Rays of a batch: enough to keep every core busy, few enough to stay in a cache.
const BATCH: usize = 1 << 16;

/// Width and height of a picture in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    width: u32,
    height: u32,
}

/// A width or height that a picture cannot have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error(
    "a picture of {width}x{height} pixels cannot be made; each side must be from 1 to {MAX_SIDE}, \
     and their product at most {MAX_PIXELS}"
)]
pub struct SizeError {
    width: u32,
    height: u32,
}

impl Size {
    /// A size in pixels.
    ///
    /// # Errors
    /// A side of 0 or more than [`MAX_SIDE`], or more than [`MAX_PIXELS`] pixels.
    pub const fn new(width: u32, height: u32) -> Result<Size, SizeError> {
        let pixels = width as u64 * height as u64;
        if pixels == 0 || pixels > MAX_PIXELS || width > MAX_SIDE || height > MAX_SIDE {
            return Err(SizeError { width, height });
        }
        Ok(Size { width, height })
    }

    /// Pixels from left to right.
    pub const fn width(self) -> u32 {
        self.width
    }

    /// Pixels from top to bottom.
    pub const fn height(self) -> u32 {
        self.height
    }

    /// Width over height.
    pub fn aspect(self) -> f64 {
        f64::from(self.width) / f64::from(self.height)
    }
}

/// A picture and what it took.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// The picture, from the top left.
    pub image: RgbImage,
    /// Time spent in closest-hit queries for one ray a pixel, shading left out.
    pub primary: Duration,
    /// Pixels whose ray hits something.
    pub covered: u64,
    /// All rays traced: one a pixel, those that smooth edges, and shadow rays.
    pub rays: u64,
}

/// Renders a scene through its accelerator. `progress` is called with the number of rays of every
/// batch, before shadows, and runs on the calling thread.
///
/// # Errors
/// The accelerator refuses the rays.
pub fn render(
    accelerator: &dyn Accelerator,
    scene: &Scene,
    placement: &Placement,
    size: Size,
    options: &QueryOptions,
    progress: &dyn Fn(u64),
) -> Result<Rendered, QueryError> {
    let mut painter = Painter {
        accelerator,
        scene,
        camera: &placement.camera,
        light: main_light(placement),
        options,
        primary: Duration::ZERO,
        covered: 0,
        rays: 0,
    };
    let Size { width, height } = size;
    let mut linear: Vec<Vec3> = Vec::with_capacity(width as usize * height as usize);
    let band = (BATCH / width as usize).max(1) as u32;
    for top in (0..height).step_by(band as usize) {
        let rays = placement.camera.rows(width, height, top..height.min(top + band));
        linear.extend(painter.shade(&rays)?);
        progress(rays.len() as u64);
    }
    let (primary, covered) = (painter.primary, painter.covered);
    painter.smooth(&mut linear, size, progress)?;
    let bytes = linear.par_iter().flat_map_iter(|&colour| encode(colour)).collect();
    let image = RgbImage::from_raw(width, height, bytes).unwrap_or_default();
    Ok(Rendered { image, primary, covered, rays: painter.rays })
}

/// Where the light is that casts shadows: the first point light, else the eye.
fn main_light(placement: &Placement) -> DVec3 {
    let point = placement.lights.iter().find_map(|light| match *light {
        Light::Point { position, .. } => Some(position),
        Light::Directional { .. } => None,
    });
    DVec3::from_array(point.unwrap_or(placement.camera.eye()).map(f64::from))
}

struct Painter<'a> {
    accelerator: &'a dyn Accelerator,
    scene: &'a Scene,
    camera: &'a Camera,
    light: DVec3,
    options: &'a QueryOptions,
    primary: Duration,
    covered: u64,
    rays: u64,
}

impl Painter<'_> {
    /// The linear colours that some rays see.
    fn shade(&mut self, rays: &[Ray]) -> Result<Vec<Vec3>, QueryError> {
        let mut hits = vec![Hit::MISS; rays.len()];
        let start = Instant::now();
        self.accelerator.closest_hits(rays, &mut hits, self.options)?;
        self.primary += start.elapsed();
        let surfaces: Vec<Option<Surface>> =
            rays.par_iter().zip(&hits).map(|(ray, hit)| self.surface(ray, hit)).collect();
        let light = self.light.as_vec3().to_array();
        let shadow_rays: Vec<Ray> =
            surfaces.iter().flatten().map(|s| Ray::segment(s.start(), light)).collect();
        let mut dark = vec![false; shadow_rays.len()];
        self.accelerator.any_hits(&shadow_rays, &mut dark, self.options)?;
        self.covered += hits.iter().filter(|hit| hit.is_hit()).count() as u64;
        self.rays += (rays.len() + shadow_rays.len()) as u64;
        let mut dark = dark.into_iter();
        Ok(rays
            .iter()
            .zip(&hits)
            .zip(&surfaces)
            .map(|((ray, hit), surface)| {
                let towards_eye = -Vec3::from_array(ray.direction);
                match surface {
                    Some(surface) => {
                        let lit = !dark.next().unwrap_or(false);
                        self.colour(hit, surface, towards_eye, lit)
                    }
                    // Seen exactly from its edge, a triangle without area has no side to light.
                    None if hit.is_hit() => Vec3::splat(0.1),
                    None => background(-towards_eye),
                }
            })
            .collect())
    }

    fn surface(&self, ray: &Ray, hit: &Hit) -> Option<Surface> {
        let corners = self.scene.indices.get(hit.triangle as usize)?;
        let corners = corners.map(|vertex| self.scene.positions[vertex as usize]);
        Surface::new(corners, hit, ray.direction)
    }

    fn colour(&self, hit: &Hit, surface: &Surface, towards_eye: Vec3, lit: bool) -> Vec3 {
        let index = self.scene.material_of.get(hit.triangle as usize).copied().unwrap_or(0);
        let material = self.scene.materials.get(index as usize);
        let albedo = material.map_or(Vec3::splat(0.6), |m| Vec3::from_array(m.diffuse));
        let normal = surface.normal.as_vec3();
        let height = 0.5 + 0.5 * normal.y;
        let mut light = Vec3::new(0.12, 0.11, 0.10).lerp(Vec3::new(0.27, 0.31, 0.37), height);
        light += Vec3::splat(0.22) * normal.dot(towards_eye).max(0.0);
        if lit {
            let towards_light = (self.light - surface.point).normalize_or_zero().as_vec3();
            light += Vec3::new(1.30, 1.22, 1.08) * normal.dot(towards_light).max(0.0);
        }
        albedo * light
    }

    /// Takes four more rays through every pixel that differs from a neighbour, at the corners of a
    /// turned square (the rotated grid of multisampling), and averages.
    fn smooth(
        &mut self,
        linear: &mut [Vec3],
        size: Size,
        progress: &dyn Fn(u64),
    ) -> Result<(), QueryError> {
        let edges = edges(linear, size);
        for pixels in edges.chunks(BATCH / 4) {
            let points = pixels.iter().flat_map(|&pixel| {
                let (x, y) = (pixel % size.width as usize, pixel / size.width as usize);
                OFFSETS.map(|[dx, dy]| [x as f64 + dx, y as f64 + dy])
            });
            let rays = self.camera.through(size.width, size.height, points);
            let colours = self.shade(&rays)?;
            for (&pixel, colours) in pixels.iter().zip(colours.chunks(4)) {
                // Average what the screen shows, so that one bright sample does not win.
                let sum: Vec3 = colours.iter().map(|&colour| tone(colour)).sum();
                linear[pixel] = untone((sum + tone(linear[pixel])) / 5.0);
            }
            progress(rays.len() as u64);
        }
        Ok(())
    }
}

const OFFSETS: [[f64; 2]; 4] = [[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]];

/// Pixels that differ visibly from the one to the right or below, with that one.
fn edges(linear: &[Vec3], size: Size) -> Vec<usize> {
    let width = size.width as usize;
    let shown: Vec<Vec3> = linear.par_iter().map(|&colour| gamma(tone(colour))).collect();
    let mut marked = vec![false; shown.len()];
    for pixel in 0..shown.len() {
        let right = (pixel % width + 1 < width).then_some(pixel + 1);
        let below = Some(pixel + width).filter(|&below| below < shown.len());
        for other in [right, below].into_iter().flatten() {
            if (shown[pixel] - shown[other]).abs().max_element() > 0.06 {
                marked[pixel] = true;
                marked[other] = true;
            }
        }
    }
    (0..shown.len()).filter(|&pixel| marked[pixel]).collect()
}

/// A backdrop: light at the horizon, blue above, a soft dark below.
fn background(direction: Vec3) -> Vec3 {
    let height = direction.normalize_or_zero().y;
    let horizon = Vec3::new(0.66, 0.66, 0.64);
    if height > 0.0 {
        horizon.lerp(Vec3::new(0.07, 0.18, 0.42), (1.6 * height).min(1.0))
    } else {
        horizon.lerp(Vec3::new(0.10, 0.12, 0.15), (-1.3 * height).min(1.0))
    }
}

/// Linear light to 0..1.
fn tone(x: Vec3) -> Vec3 {
    (x * (Vec3::ONE + x / 4.0) / (Vec3::ONE + x)).min(Vec3::ONE)
}

/// The inverse of [`tone`] below white: the positive root of `x^2 / 4 + (1 - y) x - y = 0`.
fn untone(y: Vec3) -> Vec3 {
    let b = Vec3::ONE - y;
    let root = b * b + y;
    (Vec3::new(root.x.sqrt(), root.y.sqrt(), root.z.sqrt()) - b) * 2.0
}

fn gamma(x: Vec3) -> Vec3 {
    Vec3::new(x.x.sqrt(), x.y.sqrt(), x.z.sqrt())
}

fn encode(colour: Vec3) -> [u8; 3] {
    gamma(tone(colour)).to_array().map(|part| (part * 255.0 + 0.5) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tone_and_its_inverse() {
        for x in [0.0, 0.1, 0.5, 1.0, 1.9] {
            let back = untone(tone(Vec3::splat(x))).x;
            assert!((back - x).abs() < 1e-5, "{x} {back}");
        }
        assert_eq!(encode(Vec3::splat(2.0)), [255; 3]);
        assert_eq!(encode(Vec3::ZERO), [0; 3]);
    }

    #[test]
    fn sizes_have_limits() {
        assert!(Size::new(0, 5).is_err());
        assert!(Size::new(MAX_SIDE, MAX_SIDE).is_err());
        assert_eq!(Size::new(4, 2).unwrap().aspect(), 2.0);
    }
}
