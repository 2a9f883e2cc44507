//! The views to choose from: what each needs of a frame, and its picture.

use crate::source::{DebugView, FrameError};
use image::RgbImage;
use splitplane::picture::{Aov, FirstCost, FirstHit, HeatMap, Quantity};
use splitplane::render::{Outputs, Size};

/// What a view needs of a frame.
pub(crate) fn outputs(view: DebugView) -> Outputs {
    let none = Outputs { pixels: false, radiance: false, first_hits: false, first_costs: false };
    match view {
        DebugView::Shaded => Outputs::PIXELS,
        DebugView::Depth | DebugView::Normals | DebugView::TriangleIds => {
            Outputs { first_hits: true, ..none }
        }
        DebugView::Nodes | DebugView::Triangles => Outputs { first_costs: true, ..none },
    }
}

/// The picture of a view of what first rays met or cost, and what its colours mean.
pub(crate) fn debug_picture(
    view: DebugView,
    size: Size,
    hits: &[FirstHit],
    costs: &[FirstCost],
) -> Result<(RgbImage, Option<String>), FrameError> {
    let quantity = match view {
        DebugView::Nodes => Quantity::Nodes,
        DebugView::Triangles => Quantity::Tests,
        _ => {
            let aov = match view {
                DebugView::Depth => Aov::Depth(hits),
                DebugView::Normals => Aov::Normal(hits),
                _ => Aov::Triangle(hits),
            };
            let depths = || hits.iter().map(|hit| hit.depth).filter(|depth| depth.is_finite());
            let legend = (view == DebugView::Depth).then(|| {
                let (near, far) = depths()
                    .fold((f32::INFINITY, 0.0), |(near, far): (f32, f32), depth| {
                        (near.min(depth), far.max(depth))
                    });
                format!("bright {near:.4} to dark {far:.4}")
            });
            return Ok((aov.picture(size)?, legend));
        }
    };
    let map = HeatMap::new(size, costs, quantity, None)?;
    let legend = format!(
        "dark 0 to bright {}; mean {:.1}, greatest {}",
        map.top, map.statistics.mean, map.statistics.max
    );
    let aov = match quantity {
        Quantity::Nodes => Aov::Nodes(costs),
        _ => Aov::Tests(costs),
    };
    Ok((aov.picture(size)?, Some(legend)))
}

/// A picture as the window takes it.
pub(crate) fn words(image: &RgbImage) -> Vec<u32> {
    image.pixels().map(|pixel| u32::from_le_bytes([pixel[0], pixel[1], pixel[2], 255])).collect()
}
