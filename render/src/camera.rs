//! Where camera rays start and how their directions run over the picture.

use crate::layout::Frame;
use crate::random::sample_offset;
use crate::vector::{add, normalized, scaled};
use splitplane_core::ray::Ray;

/// A pinhole camera for a picture of a certain size, as kernels need it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pinhole {
    /// Where the rays start.
    pub eye: [f32; 3],
    /// Direction through the top left corner of the picture, of any length.
    pub corner: [f32; 3],
    /// The change of direction from the left edge of a pixel to its right edge.
    pub step_x: [f32; 3],
    /// The change of direction from the top edge of a pixel to its bottom edge.
    pub step_y: [f32; 3],
}

/// The ray through a sample of a pixel. Its direction has length 1, so that `t` is a distance.
pub(crate) fn camera_ray(frame: &Frame, pixel: u32, sequence: u32) -> Ray {
    let row = pixel / frame.width;
    let column = pixel - row * frame.width;
    let offset = sample_offset(sequence);
    let across = scaled(frame.step_x, column as f32 + offset[0]);
    let down = scaled(frame.step_y, row as f32 + offset[1]);
    Ray::new(frame.eye, normalized(add(add(frame.corner, across), down)))
}
