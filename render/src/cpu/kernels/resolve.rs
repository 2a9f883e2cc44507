//! Converts radiance to screen pixels.

use super::CHUNK;
use crate::scene_words::SceneWords;
use crate::tone::shown;
use rayon::prelude::*;
use splitplane_float_state::Standard;

pub(crate) fn run(scene: &SceneWords<'_>, radiance: &[[f32; 4]], pixels: &mut [u32]) {
    let chunks = pixels.par_chunks_mut(CHUNK).zip(radiance.par_chunks(CHUNK));
    chunks.for_each(|(pixels, radiance)| {
        let _state = Standard::set();
        for (pixel, radiance) in pixels.iter_mut().zip(radiance) {
            *pixel = shown(scene, *radiance);
        }
    });
}
