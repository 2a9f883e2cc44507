//! The request for a frame, and its outputs.

use super::{On, Output, TracerError, on};
use crate::camera::Pinhole;
use crate::frame::FrameStats;
use crate::layout::{FirstCost, FirstHit};
use crate::plan::Outputs;
use crate::settings::{RenderSettings, Size};
use splitplane_core::ray::QueryOptions;
use std::borrow::Cow;

/// The request for a frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameRequest<'a> {
    /// The camera; made for `size`.
    pub camera: Pinhole,
    /// Size of the picture.
    pub size: Size,
    /// The settings of speed and quality.
    pub settings: RenderSettings,
    /// The outputs to produce.
    pub outputs: Outputs,
    /// How rays are traced.
    pub query: QueryOptions<'a>,
}

impl<'a> FrameRequest<'a> {
    /// A picture for a screen, by default settings.
    pub fn new(camera: Pinhole, size: Size) -> FrameRequest<'a> {
        FrameRequest {
            camera,
            size,
            settings: RenderSettings::default(),
            outputs: Outputs::PIXELS,
            query: QueryOptions::default(),
        }
    }
}

/// A finished frame, on its backend: outputs of a GPU are read back when they are requested.
#[derive(Debug)]
pub struct Frame<'a> {
    pub(super) on: &'a On,
    pub(super) stats: FrameStats,
}

impl<'a> Frame<'a> {
    /// The statistics of the frame.
    pub fn stats(&self) -> &FrameStats {
        &self.stats
    }

    /// The pixels for a screen, row by row from the top left: red in the lowest byte, then green,
    /// blue and 255.
    ///
    /// # Errors
    /// Pixels that were not requested, a device that fails, or a driver that did not follow all rays.
    pub fn pixels(&self) -> Result<Cow<'a, [u32]>, TracerError> {
        self.requested(Output::Pixels, |outputs| outputs.pixels)?;
        let pixels = on!(self.on, on => on.pixels())?;
        check_finished(self.made(&pixels).iter().filter(|pixel| **pixel >> 24 == 0).count())?;
        Ok(pixels)
    }

    /// Linear radiance by pixel: red, green, blue, 0.
    ///
    /// # Errors
    /// As for [`Frame::pixels`], of radiance.
    pub fn radiance(&self) -> Result<Cow<'a, [[f32; 4]]>, TracerError> {
        self.requested(Output::Radiance, |outputs| outputs.radiance)?;
        let radiance = on!(self.on, on => on.radiance())?;
        check_finished(self.made(&radiance).iter().filter(|radiance| radiance[3] > 0.0).count())?;
        Ok(radiance)
    }

    /// The hit of the first ray of each pixel.
    ///
    /// # Errors
    /// First hits that were not requested, or a device that fails.
    pub fn first_hits(&self) -> Result<Cow<'a, [FirstHit]>, TracerError> {
        self.requested(Output::FirstHits, |outputs| outputs.first_hits)?;
        on!(self.on, on => on.first_hits())
    }

    /// The cost of the first ray of each pixel.
    ///
    /// # Errors
    /// First costs that were not requested, or a device that fails.
    pub fn first_costs(&self) -> Result<Cow<'a, [FirstCost]>, TracerError> {
        self.requested(Output::FirstCosts, |outputs| outputs.first_costs)?;
        on!(self.on, on => on.first_costs())
    }

    /// Of an output the pixels that were made.
    fn made<'b, T>(&self, output: &'b [T]) -> &'b [T] {
        let pixels = self.stats.plan.pixels();
        output.get(pixels.start as usize..pixels.end as usize).unwrap_or(output)
    }

    fn requested(
        &self,
        output: Output,
        wanted: impl Fn(&Outputs) -> bool,
    ) -> Result<(), TracerError> {
        if wanted(self.stats.plan.outputs()) {
            Ok(())
        } else {
            Err(TracerError::NotRequested { output })
        }
    }
}

fn check_finished(unfinished: usize) -> Result<(), TracerError> {
    if unfinished > 0 { Err(TracerError::Unfinished { pixels: unfinished }) } else { Ok(()) }
}
