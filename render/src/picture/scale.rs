//! The colours of what rays cost, on a scale from 0 to a top.

use super::screen::paint;
use super::{FirstCost, Quantity, Size, viridis};
use image::RgbImage;
use std::num::NonZeroU32;

/// The colour of what lies above the scale of a heat map: magenta, which viridis does not come near.
pub const ABOVE: [u8; 3] = [255, 0, 255];

/// The colour of a value on a scale from 0 to `top`.
pub(super) fn colour(value: u32, top: NonZeroU32) -> [u8; 3] {
    let top = u64::from(top.get());
    let step = (u64::from(value) * 255 + top / 2) / top;
    if u64::from(value) > top { ABOVE } else { viridis::colour(step as u8) }
}

/// One colour per ray, without a scale beside it.
pub(super) fn colours(
    size: Size,
    costs: &[FirstCost],
    quantity: Quantity,
    top: NonZeroU32,
) -> RgbImage {
    paint(size, costs, |cost| colour(quantity.of(cost), top))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn above_is_far_from_every_colour_of_the_scale() {
        let nearest = (0..=255).map(|step| {
            let other = viridis::colour(step);
            (0..3).map(|i| u32::from(ABOVE[i].abs_diff(other[i])).pow(2)).sum::<u32>()
        });
        assert!(nearest.min().unwrap() > 150 * 150);
    }
}
