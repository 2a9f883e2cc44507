//! How far rays of one accuracy are from exact ones.

use splitplane::QueryOptions;
use splitplane::render::layout::FirstHit;
use splitplane::render::{Outputs, RenderSettings, Size};
use splitplane::scene::Camera;
use splitplane::tracer::FrameRequest;

use crate::failure::Failure;
use crate::named::accuracy;

/// The number of the accuracy that the others are judged by.
pub(super) const EXACT: u32 = 2;

/// The number of the default.
pub(super) const WATERTIGHT: u32 = 1;

/// How many hits differ in any bit.
pub(super) fn differences(found: &[FirstHit], own: &[FirstHit]) -> f64 {
    let words = bytemuck::bytes_of::<FirstHit>;
    found.iter().zip(own).filter(|(found, own)| words(found) != words(own)).count() as f64
}

/// A frame of first hits alone.
pub(super) fn request(
    settings: RenderSettings,
    camera: Camera,
    size: Size,
    test: u32,
) -> Result<FrameRequest<'static>, Failure> {
    let outputs = Outputs { pixels: false, radiance: false, first_hits: true, first_costs: false };
    let query = QueryOptions { accuracy: accuracy(test)?, ..QueryOptions::default() };
    let settings = RenderSettings { samples: 1, ..settings };
    Ok(FrameRequest { settings, outputs, query, ..FrameRequest::new(camera.pinhole(size), size) })
}

/// Rays, those with another triangle than `exact` has, and those that miss where it hits.
pub(super) fn judge(found: &[FirstHit], exact: &[FirstHit]) -> Result<Vec<f64>, Failure> {
    if found.len() != exact.len() {
        return Err(Failure::new("stale", "exact hits of the same picture come first"));
    }
    let none = FirstHit::MISS.triangle;
    let both = || found.iter().map(|hit| hit.triangle).zip(exact.iter().map(|hit| hit.triangle));
    let other = both().filter(|(found, exact)| found != exact).count();
    let lost = both().filter(|(found, exact)| *found == none && *exact != none).count();
    Ok([found.len(), other, lost].map(|count| count as f64).to_vec())
}
