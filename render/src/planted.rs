//! Faults that tests plant in the light, to see that they are found. A build without tests has none.

use crate::layout::Frame;

/// A fault. Its number stands in the last word of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum Fault {
    /// Light that is found in two ways counts whole both times.
    SharesOfOne = 1,
    /// Paths that chance lets go on do not carry the light of those that it ends.
    SurvivorsAsTheyAre,
    /// Points of shining triangles count as if these faced the surface.
    LightsFace,
    /// What shines counts whole where a path meets it, sampled or not.
    EmissionWhole,
    /// The disk of photons has the area of its square.
    SquareDisks,
    /// What a path finds in mirrors and clear bodies counts beside the photons that came that way.
    CausticsTwice,
    /// Photons that chance lets go on do not carry the power of those that it ends.
    PhotonsAsTheyAre,
    /// Directions that are drawn by the light of a map have a density four times as high.
    MapDensity,
}

/// Whether a fault is planted in the frame.
#[inline(always)]
pub(crate) fn is_planted(frame: &Frame, fault: Fault) -> bool {
    cfg!(test) && frame.padding[9] == fault as u32
}
