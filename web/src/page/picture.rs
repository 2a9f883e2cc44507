//! Pictures: what is wanted of one, and what comes of it.

use std::cell::RefCell;

use splitplane::render::{Appearance, LightTransport, Outputs, RenderSettings, Size};
use splitplane::scene::{Camera, Scene};
use splitplane::tracer::{Frame, FrameRequest};
use splitplane::{Accuracy, QueryOptions};
use wasm_bindgen::prelude::*;

use super::heat;
use crate::failure::Failure;
use crate::named::accuracy;
use crate::words::zeros;

/// Photons of a pass: what one thread traces in a part of a second.
const PHOTONS: u32 = 40_000;

/// What is wanted of a picture, in the order of the numbers that say it.
pub(super) struct Wanted {
    size: Size,
    /// Rays a pixel; for light by photons and by paths, passes.
    samples: u32,
    /// Most bounces.
    depth: u32,
    accuracy: Accuracy,
    /// Whether lights shine. Without them no light casts shadows, and a lamp at the eye shines instead.
    has_lights: bool,
    /// 0 for light, 1 for what the first ray of each pixel cost.
    shows_costs: bool,
    /// 0 for direct light, 1 for paths, 2 for photons.
    light: LightTransport,
}

/// What a frame took, in counts.
#[wasm_bindgen]
#[derive(Clone, Copy)]
pub struct Told {
    /// Camera, reflected and refracted rays.
    pub paths: f64,
    /// Rays towards lights.
    pub shadows: f64,
    /// Of a heat map the cost of the brightest colour, else 0.
    pub top: f64,
}

/// The size of a picture.
pub(super) fn size(width: u32, height: u32) -> Result<Size, Failure> {
    Size::new(width, height).map_err(|error| Failure::new("config", error.to_string()))
}

impl Wanted {
    /// Of width, height, samples, depth, accuracy, whether there are lights, view, and light.
    pub(super) fn of(numbers: &[u32]) -> Result<Wanted, Failure> {
        let &[width, height, samples, depth, test, lights, view, light] = numbers else {
            let text = format!("a picture takes 8 numbers, and there are {}", numbers.len());
            return Err(Failure::new("shape", text));
        };
        let light = match light {
            0 => LightTransport::Direct,
            1 => LightTransport::Paths,
            2 => LightTransport::Photons,
            _ => return Err(Failure::new("config", "there is no light of this number")),
        };
        let (has_lights, shows_costs) = (lights != 0, view == 1);
        let (size, accuracy) = (size(width, height)?, accuracy(test)?);
        Ok(Wanted { size, samples, depth, accuracy, has_lights, shows_costs, light })
    }

    pub(super) fn settings(&self, scene: RenderSettings) -> RenderSettings {
        let light = if self.shows_costs { LightTransport::Direct } else { self.light };
        let (samples, passes) = match light {
            LightTransport::Direct => (self.samples, 1),
            _ => (1, self.samples),
        };
        let depth = self.depth;
        let own = RenderSettings { samples, passes, depth, light, photons: PHOTONS, ..scene };
        match self.has_lights {
            true => own,
            false => RenderSettings { area_samples: 0, headlight: 1.0, ..own },
        }
    }

    pub(super) fn appearance<'a>(&self, scene: &'a Scene) -> Appearance<'a> {
        match self.has_lights {
            true => scene.appearance(),
            false => Appearance { lights: &[], ..scene.appearance() },
        }
    }

    pub(super) fn request(
        &self,
        settings: RenderSettings,
        camera: Camera,
    ) -> FrameRequest<'static> {
        let none = Outputs { pixels: false, radiance: false, first_hits: false, first_costs: true };
        let outputs = if self.shows_costs { none } else { Outputs::PIXELS };
        let query = QueryOptions { accuracy: self.accuracy, ..QueryOptions::default() };
        let size = self.size;
        FrameRequest { settings, outputs, query, ..FrameRequest::new(camera.pinhole(size), size) }
    }
}

/// Takes the pixels of a frame.
pub(super) fn take(
    frame: &Frame<'_>,
    wanted: &Wanted,
    into: &RefCell<Vec<u32>>,
) -> Result<Told, Failure> {
    let mut pixels: Vec<u32> = zeros(wanted.size.pixels() as usize)?;
    let mut top = 0.0;
    if wanted.shows_costs {
        top = heat::paint(&frame.first_costs()?, &mut pixels);
    } else {
        pixels.copy_from_slice(&frame.pixels()?);
    }
    into.replace(pixels);
    let stats = frame.stats();
    Ok(Told { paths: stats.paths as f64, shadows: stats.shadow_rays as f64, top })
}
