//! The settings of a frame: its size, and the tradeoff between speed and quality.

use crate::light::Environment;
use crate::part::Part;
use thiserror::Error;

/// Greatest width and height of a picture.
pub const MAX_SIDE: u32 = 16_384;
/// Most pixels of a picture.
pub const MAX_PIXELS: u64 = 1 << 26;
/// Most samples of a pixel.
pub const MAX_SAMPLES: u32 = 64;
/// Greatest number of reflections and refractions along a path.
pub const MAX_DEPTH: u32 = 16;
/// Most lights that a surface samples: those without a size, and samples of surfaces that shine.
pub const MAX_SHADOW_RAYS: u32 = 32;

/// Greatest number of bounces of a path where light is followed beyond direct light.
pub const MAX_BOUNCES: u32 = 64;
/// Most passes of a picture.
pub const MAX_PASSES: u32 = 1 << 16;
/// Fewest photons of a pass.
pub const MIN_PHOTONS: u32 = 64;
/// Most photons of a pass.
pub const MAX_PHOTONS: u32 = 1 << 24;
/// Fewest photons that an estimate of light may look at.
pub const MIN_NEIGHBOURS: u32 = 8;
/// Most photons that an estimate of light may look at.
pub const MAX_NEIGHBOURS: u32 = 1024;

/// How light travels from its sources to the eye.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[repr(u32)]
pub enum LightTransport {
    /// Straight from lights to surfaces, and from there through mirrors and glass. Instead of light that comes by way of other
    /// surfaces there is [`RenderSettings::ambient`].
    #[default]
    Direct = 0,
    /// By any way, traced from the eye: path tracing (Kajiya 1986). What light without a size does behind glass is missing, since no
    /// path meets it by chance.
    Paths = 1,
    /// By any way: what lights do to surfaces themselves is sampled from the eye, all other light is brought by photons, traced from the
    /// lights (photon mapping, Jensen 1996). Their disks shrink from pass to pass, so that pictures converge to those of path tracing (Knaus and
    /// Zwicker 2011), and have what lights without a size do behind glass besides.
    Photons = 2,
}

/// Where photons are looked up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Gather {
    /// At the first surface that scatters light evenly: fast, and spotty until there have been many passes.
    #[default]
    Maps,
    /// One bounce later (final gathering), but for caustics: the spots are averaged over all surfaces around, and there is noise instead.
    Final,
}

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

    /// Width times height.
    pub const fn pixels(self) -> u32 {
        self.width * self.height
    }

    /// Width over height.
    pub fn aspect(self) -> f64 {
        f64::from(self.width) / f64::from(self.height)
    }
}

/// The settings of a frame, in addition to scene, camera and size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderSettings {
    /// Camera rays per pixel, 1 to [`MAX_SAMPLES`]. The first goes through the pixel's centre, the
    /// others fill the pixel evenly (Roberts 2018, the sequence R2).
    pub samples: u32,
    /// Greatest number of reflections and refractions along a path, 0 to [`MAX_DEPTH`]; of all bounces, 0 to [`MAX_BOUNCES`], where
    /// light is followed beyond direct light.
    pub depth: u32,
    /// A path ends when no colour channel of its weight reaches this, 0 to 1. Direct light only: else chance ends paths, and
    /// nothing is lost.
    pub minimum_weight: f32,
    /// Samples of the surfaces that shine, for every surface point, 0 to 8. With 0 such surfaces are
    /// seen but light nothing.
    pub area_samples: u32,
    /// Seed of the samples of shining surfaces. Equal seeds give equal pictures.
    pub seed: u32,
    /// Part of the environment's light that surfaces receive, 0 to 1: nothing occludes it, so part
    /// of it accounts for light that the surroundings block.
    pub ambient: f32,
    /// A light at the eye without shadows or falloff: the radiance that a white surface facing the
    /// eye sends back, 0 or more.
    pub headlight: f32,
    /// Factor of the radiance before display, more than 0. Linear outputs are not scaled.
    pub exposure: f32,
    /// Light from everywhere, and the backdrop.
    pub environment: Environment,
    /// How light travels. Beyond direct light `ambient` and `headlight` are not used.
    pub light: LightTransport,
    /// How often the picture is made, each time by other samples, 1 to [`MAX_PASSES`]; it is the mean.
    pub passes: u32,
    /// Photons that leave the lights in each pass, [`MIN_PHOTONS`] to [`MAX_PHOTONS`], and at least one of each light. Used by
    /// [`LightTransport::Photons`] alone, as are the next two.
    pub photons: u32,
    /// How many of the nearest photons an estimate of light looks at, [`MIN_NEIGHBOURS`] to [`MAX_NEIGHBOURS`].
    pub neighbours: u32,
    /// Where photons are looked up.
    pub gather: Gather,
    /// Which share of the picture is made. Of other pixels outputs say nothing: what stands there means nothing.
    pub part: Part,
    /// A fault that a test plants.
    #[cfg(test)]
    pub(crate) planted: Option<crate::planted::Fault>,
}

impl Default for RenderSettings {
    fn default() -> RenderSettings {
        RenderSettings {
            samples: 1,
            depth: 6,
            minimum_weight: 1.0 / 256.0,
            area_samples: 1,
            seed: 1,
            ambient: 0.4,
            headlight: 0.0,
            exposure: 1.0,
            environment: Environment::SKY,
            light: LightTransport::Direct,
            passes: 1,
            photons: 100_000,
            neighbours: 64,
            gather: Gather::Maps,
            part: Part::WHOLE,
            #[cfg(test)]
            planted: None,
        }
    }
}

/// A setting out of its range.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error("the setting `{name}` is {value}; it must be {range}")]
pub struct SettingsError {
    /// The setting.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// The values that it may have, in words.
    pub range: &'static str,
}

impl RenderSettings {
    /// A headlight for scenes that had no lights and got some: surfaces that these do not reach can
    /// still be distinguished.
    pub const PLACED_HEADLIGHT: f32 = 0.2;

    /// [`RenderSettings::ambient`] for interiors, whose walls keep most of the environment's light off.
    pub const INSIDE_AMBIENT: f32 = 0.15;

    /// Whether all settings are in their ranges.
    ///
    /// # Errors
    /// The first one that is not.
    pub fn validate(&self) -> Result<(), SettingsError> {
        let within = |name, value: f32, least: f32, most: f32, range| match value {
            value if (least..=most).contains(&value) => Ok(()),
            value => Err(SettingsError { name, value: f64::from(value), range }),
        };
        within("samples", self.samples as f32, 1.0, MAX_SAMPLES as f32, "1 to 64")?;
        let direct = self.light == LightTransport::Direct;
        let (most, range) = if direct { (MAX_DEPTH, "0 to 16") } else { (MAX_BOUNCES, "0 to 64") };
        within("depth", self.depth as f32, 0.0, most as f32, range)?;
        within("minimum weight", self.minimum_weight, 0.0, 1.0, "0 to 1")?;
        within("area samples", self.area_samples as f32, 0.0, 8.0, "0 to 8")?;
        within("ambient", self.ambient, 0.0, 1.0, "0 to 1")?;
        within("headlight", self.headlight, 0.0, 1e12, "0 to 1e12")?;
        within("exposure", self.exposure, 1e-12, 1e12, "1e-12 to 1e12")?;
        let whole = |name, value: u32, least: u32, most: u32, range| {
            let value = f64::from(value);
            let fits = (f64::from(least)..=f64::from(most)).contains(&value);
            if fits { Ok(()) } else { Err(SettingsError { name, value, range }) }
        };
        whole("passes", self.passes, 1, MAX_PASSES, "1 to 65536")?;
        whole("photons", self.photons, MIN_PHOTONS, MAX_PHOTONS, "64 to 16777216")?;
        whole("neighbours", self.neighbours, MIN_NEIGHBOURS, MAX_NEIGHBOURS, "8 to 1024")?;
        let environment = &self.environment;
        for part in [environment.zenith, environment.horizon, environment.nadir].as_flattened() {
            within("environment", *part, 0.0, 1e12, "0 to 1e12")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_limits() {
        assert!(Size::new(0, 5).is_err());
        assert!(Size::new(MAX_SIDE, MAX_SIDE).is_err());
        assert_eq!(Size::new(4, 2).unwrap().aspect(), 2.0);
    }

    #[test]
    fn settings_have_ranges() {
        assert_eq!(RenderSettings::default().validate(), Ok(()));
        let nan = RenderSettings { ambient: f32::NAN, ..RenderSettings::default() };
        assert_eq!(nan.validate().unwrap_err().name, "ambient");
        let many = RenderSettings { samples: 65, ..RenderSettings::default() };
        assert!(many.validate().unwrap_err().to_string().contains("1 to 64"));
    }
}
