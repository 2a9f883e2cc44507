//! Costs of rays as colours.

use splitplane::render::layout::FirstCost;

/// From nothing to the most: black, blue, red, yellow, white.
const RAMP: [[f64; 3]; 5] =
    [[8.0, 8.0, 16.0], [40.0, 60.0, 170.0], [200.0, 40.0, 60.0], [245.0, 190.0, 50.0], [255.0; 3]];

/// Paints nodes and triangles of each pixel's first ray together; gives the cost that has the last colour, which all that cost more have
/// too: one pixel in a hundred.
pub(super) fn paint(costs: &[FirstCost], pixels: &mut [u32]) -> f64 {
    let cost = |cost: &FirstCost| cost.nodes.saturating_add(cost.triangles);
    // Pixels have room for the costs in order.
    for (pixel, own) in pixels.iter_mut().zip(costs) {
        *pixel = cost(own);
    }
    pixels.sort_unstable();
    let top = pixels.get(pixels.len() * 99 / 100).copied().unwrap_or(0).max(1);
    for (pixel, own) in pixels.iter_mut().zip(costs) {
        *pixel = colour(f64::from(cost(own)) / f64::from(top));
    }
    f64::from(top)
}

fn colour(part: f64) -> u32 {
    let place = part.clamp(0.0, 1.0) * (RAMP.len() - 1) as f64;
    let low = (place as usize).min(RAMP.len() - 2);
    let rest = place - low as f64;
    let byte = |channel: usize| {
        let (from, to) = (RAMP[low][channel], RAMP[low + 1][channel]);
        (from + (to - from) * rest).round() as u8
    };
    u32::from_le_bytes([byte(0), byte(1), byte(2), 255])
}
