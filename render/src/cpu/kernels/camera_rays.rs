//! A ray through every sample of the slice's pixels.

use super::CHUNK;
use crate::camera::camera_ray;
use crate::layout::{Frame, Path};
use rayon::prelude::*;
use splitplane_core::ray::Ray;
use splitplane_float_state::Standard;

pub(crate) fn run(frame: &Frame, first_pixel: u32, rays: &mut [Ray], paths: &mut [Path]) {
    let chunks = rays.par_chunks_mut(CHUNK).zip(paths.par_chunks_mut(CHUNK)).enumerate();
    chunks.for_each(|(chunk, (rays, paths))| {
        let _state = Standard::set();
        for (lane, (ray, path)) in rays.iter_mut().zip(paths).enumerate() {
            let index = (chunk * CHUNK + lane) as u32;
            let slice_pixel = index / frame.samples;
            let pixel = first_pixel + slice_pixel;
            let sequence = frame.first_sequence + (index - slice_pixel * frame.samples);
            *ray = camera_ray(frame, pixel, sequence);
            *path = Path { weight: [1.0; 3], pixel, sequence, ..Path::default() };
        }
    });
}
