//! Holes in surfaces: what `map_d` of a material says, as opacity masks of micro-cells.

use crate::{Scene, Texture};
use splitplane_core::scene::{MAX_OPACITY_LEVEL, OpacityMask, SceneError};
use std::ops::Range;

/// The finest level: cells an edge of 128.
const FINEST: u32 = 7;
/// Most bits of a mask; coarser levels are taken for what would need more.
const MOST_BITS: u64 = 1 << 30;
/// Alpha from here on is opaque.
const OPAQUE: u8 = 128;
const _: () = assert!(FINEST <= MAX_OPACITY_LEVEL);

/// The level of the mask of a geometry that consists of these triangles of a scene; `None` where no material of theirs has holes. It is the least whose cells are no wider
/// than a texel along the edges of any triangle with holes, at most 7, and less where the mask would take more than 128 MiB.
pub(super) fn level(scene: &Scene, runs: &[Range<u32>]) -> Option<u32> {
    let mut widest = 0.0f32;
    for triangle in runs.iter().cloned().flatten().map(|triangle| triangle as usize) {
        if let Some((_, texture, corners)) = holes(scene, triangle) {
            let [w, h] = [texture.width() as f32, texture.height() as f32];
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                let along = |k: usize, size: f32| ((corners[b][k] - corners[a][k]) * size).abs();
                // One texel at least: there is something to decide.
                widest = widest.max(along(0, w)).max(along(1, h)).max(1.0);
            }
        }
    }
    if widest == 0.0 {
        return None;
    }
    let triangles: usize = runs.iter().map(|run| run.len()).sum();
    let fits = |level: &u32| bits(triangles, *level) <= MOST_BITS;
    let wanted = (0..FINEST).find(|level| (1u32 << level) as f32 >= widest).unwrap_or(FINEST);
    Some((0..=wanted).rev().find(fits).unwrap_or(0))
}

/// Bits of a mask.
pub(super) fn bits(triangles: usize, level: u32) -> u64 {
    (triangles as u64) << (2 * level)
}

/// A mask of this level for these triangles. A micro-cell is open where the nearest texel to its middle has an alpha below one half. `channels` are those of
/// [`channels`].
///
/// # Errors
/// No memory for it.
pub(super) fn mask(
    scene: &Scene,
    channels: &[usize],
    runs: &[Range<u32>],
    level: u32,
) -> Result<OpacityMask, SceneError> {
    let triangles: Vec<usize> =
        runs.iter().cloned().flatten().map(|triangle| triangle as usize).collect();
    let of = |triangle| {
        let (number, texture, corners) = holes(scene, triangle)?;
        Some((texture, *channels.get(number)?, corners))
    };
    OpacityMask::new(triangles.len(), level, |triangle, [u, v]| {
        let Some((texture, channel, [a, b, c])) = of(triangles[triangle as usize]) else {
            return true;
        };
        let at = [0, 1].map(|k| (a[k] * (1.0 - u - v) + b[k] * u) + c[k] * v);
        is_opaque(texture, channel, at)
    })
}

/// The picture that says where a triangle has holes, its number, and the triangle's corners in it.
fn holes(scene: &Scene, triangle: usize) -> Option<(usize, &Texture, [[f32; 2]; 3])> {
    let material = *scene.material_of.get(triangle)?;
    let number = (*scene.cutouts.get(material as usize)?)? as usize;
    let texture = scene.textures.get(number)?;
    let corners = scene.texcoord_indices.get(triangle).copied().unwrap_or([Scene::NONE; 3]);
    let at = |corner: u32| scene.texcoords.get(corner as usize).copied().unwrap_or_default();
    Some((number, texture, corners.map(at)))
}

/// Whether the nearest texel is opaque, by a channel.
fn is_opaque(texture: &Texture, channel: usize, [s, t]: [f32; 2]) -> bool {
    let place = |x: f32, size: u32| {
        let part = if x.is_finite() { x - x.floor() } else { 0.0 };
        ((part * size as f32) as u32).min(size - 1)
    };
    // Rows run downwards.
    let (column, row) = (place(s, texture.width()), place(1.0 - t, texture.height()));
    let texel = texture.texels()[row as usize * texture.width() as usize + column as usize];
    texel[channel] >= OPAQUE
}

/// By picture of a scene the channel that says what is opaque.
pub(super) fn channels(scene: &Scene) -> Vec<usize> {
    scene.textures.iter().map(channel).collect()
}

/// The channel that says what is opaque: alpha, or, in a picture without any, red, which is that of all channels in one of greys.
fn channel(texture: &Texture) -> usize {
    if texture.texels().iter().any(|texel| texel[3] < 255) { 3 } else { 0 }
}
