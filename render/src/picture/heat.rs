//! Heat maps of what rays cost.

use super::scale::colours;
use super::{CostStatistics, FirstCost, PictureError, Quantity, Size, legend};
use image::RgbImage;
use std::num::NonZeroU32;

/// A heat map with its scale and statistics.
#[derive(Clone, Debug)]
pub struct HeatMap {
    /// The map at the top left, the scale to its right. Wider than the map, and for maps of few rows
    /// higher. The size depends on the map's and on the number of digits of the top.
    pub image: RgbImage,
    /// The top of the scale.
    pub top: NonZeroU32,
    /// The distribution over all pixels.
    pub statistics: CostStatistics,
}

impl HeatMap {
    /// Paints the cost of the first ray of every pixel: viridis from 0 to the top of the scale, and
    /// [`ABOVE`](super::ABOVE) beyond it. The top is given (frames of a movie need a common one), or
    /// [`CostStatistics::scale_top`].
    ///
    /// # Errors
    /// [`PictureError::Length`]: not one cost a pixel.
    pub fn new(
        size: Size,
        costs: &[FirstCost],
        quantity: Quantity,
        top: Option<NonZeroU32>,
    ) -> Result<HeatMap, PictureError> {
        let what = "the array of costs";
        PictureError::check_length(what, costs.len(), size)?;
        let Some(statistics) = CostStatistics::of(costs, quantity) else {
            return Err(PictureError::Length { what, found: 0, size });
        };
        let top = top.unwrap_or_else(|| statistics.scale_top());
        let map = colours(size, costs, quantity, top);
        Ok(HeatMap { image: legend::beside(&map, quantity, top), top, statistics })
    }
}

#[cfg(test)]
mod tests {
    use super::super::{ABOVE, viridis};
    use super::*;

    fn costs(values: impl IntoIterator<Item = u32>) -> Vec<FirstCost> {
        values.into_iter().map(|value| FirstCost { nodes: value, triangles: value / 2 }).collect()
    }

    #[test]
    fn known_costs_have_known_colours() {
        let size = Size::new(3, 2).unwrap();
        let costs = costs([0, 10, 20, 21, 5, u32::MAX]);
        let map = HeatMap::new(size, &costs, Quantity::Nodes, NonZeroU32::new(20)).unwrap();
        let row = |y| [0, 1, 2].map(|x| map.image.get_pixel(x, y).0);
        assert_eq!(row(0), [viridis::colour(0), viridis::colour(128), viridis::colour(255)]);
        assert_eq!(row(1), [ABOVE, viridis::colour(64), ABOVE]);
        assert_eq!((map.top.get(), map.statistics.max), (20, u32::MAX));
    }

    #[test]
    fn few_rays_above_do_not_set_the_scale() {
        let size = Size::new(100, 100).unwrap();
        let values = (0..10_000).map(|i| if i < 10 { 5000 } else { i % 58 });
        let map = HeatMap::new(size, &costs(values), Quantity::Nodes, None).unwrap();
        assert_eq!((map.top.get(), map.statistics.max), (60, 5000));
        let map = map.image.enumerate_pixels().filter(|pixel| pixel.0 < 100);
        let above = map.filter(|pixel| pixel.2.0 == ABOVE).count();
        assert_eq!(above, 10);
    }

    #[test]
    fn every_pixel_needs_a_cost() {
        let size = Size::new(2, 2).unwrap();
        let error = HeatMap::new(size, &costs([1, 2]), Quantity::Nodes, None).unwrap_err();
        assert!(matches!(error, PictureError::Length { found: 2, .. }), "{error}");
        assert!(HeatMap::new(size, &[], Quantity::Tests, None).is_err());
    }
}
