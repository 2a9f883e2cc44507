//! Arbitrary output variables: further data of a frame's pixels.

use super::screen::paint;
use super::{CostStatistics, FirstCost, FirstHit, PictureError, Quantity, Size, scale};
use image::RgbImage;

/// An output variable of a frame, with its values. As a picture for people, see [`Aov::picture`]; as
/// data, [`encode_exr`](super::encode_exr).
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Aov<'a> {
    /// Distance along the first ray.
    Depth(&'a [FirstHit]),
    /// Unit normal of the triangle that the first ray met.
    Normal(&'a [FirstHit]),
    /// Index of the triangle that the first ray met.
    Triangle(&'a [FirstHit]),
    /// The instance that the first ray met, by its name; 0 in one mesh.
    Instance(&'a [FirstHit]),
    /// Nodes that the first ray visited.
    Nodes(&'a [FirstCost]),
    /// Triangles that were tested with the first ray.
    Tests(&'a [FirstCost]),
}

/// The greys of the nearest and the farthest depth. Pixels without a hit are darker.
const NEAR: f64 = 255.0;
const FAR: f64 = 40.0;
const MISS: [u8; 3] = [0; 3];
const NO_HIT: u32 = FirstHit::MISS.triangle;

impl Aov<'_> {
    /// `depth`, `normal`, `triangle`, `instance`, `nodes` or `tests`.
    pub const fn name(&self) -> &'static str {
        match self {
            Aov::Depth(_) => "depth",
            Aov::Normal(_) => "normal",
            Aov::Triangle(_) => "triangle",
            Aov::Instance(_) => "instance",
            Aov::Nodes(_) => Quantity::Nodes.name(),
            Aov::Tests(_) => Quantity::Tests.name(),
        }
    }

    /// Whether there is one value per pixel.
    pub(super) fn check(&self, size: Size) -> Result<(), PictureError> {
        let (what, found) = match self {
            Aov::Depth(hits) => ("the array of depths", hits.len()),
            Aov::Normal(hits) => ("the array of normals", hits.len()),
            Aov::Triangle(hits) => ("the array of triangles", hits.len()),
            Aov::Instance(hits) => ("the array of instances", hits.len()),
            Aov::Nodes(costs) | Aov::Tests(costs) => ("the array of costs", costs.len()),
        };
        PictureError::check_length(what, found, size)
    }

    /// A picture for people. Pixels whose ray meets nothing are black.
    ///
    /// - Depth is grey: white at the least finite depth of the picture, dark (40 of 255) at the greatest,
    ///   in proportion between them. One depth alone is white.
    /// - A normal `n` has the colour `(n + 1) / 2`, component by component.
    /// - Triangles and instances have bright colours that depend on their index only; neighbours in the mesh's order
    ///   have hues far apart. Two triangles may share a colour.
    /// - Nodes and tests have the colours of a [`HeatMap`](super::HeatMap) with a scale of its own
    ///   choice; the map itself also shows the scale.
    ///
    /// # Errors
    /// [`PictureError::Length`]: not one value a pixel.
    pub fn picture(&self, size: Size) -> Result<RgbImage, PictureError> {
        self.check(size)?;
        Ok(match *self {
            Aov::Depth(hits) => depth(size, hits),
            Aov::Normal(hits) => paint(size, hits, normal),
            Aov::Triangle(hits) => paint(size, hits, |hit| triangle(hit.triangle)),
            Aov::Instance(hits) => paint(size, hits, |hit| match hit.triangle == NO_HIT {
                true => MISS,
                false => triangle(hit.instance),
            }),
            Aov::Nodes(costs) => cost(size, costs, Quantity::Nodes),
            Aov::Tests(costs) => cost(size, costs, Quantity::Tests),
        })
    }
}

fn depth(size: Size, hits: &[FirstHit]) -> RgbImage {
    let finite = hits.iter().map(|hit| f64::from(hit.depth)).filter(|depth| depth.is_finite());
    let (near, far) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(near, far), depth| {
        (near.min(depth), far.max(depth))
    });
    paint(size, hits, |hit| {
        let depth = f64::from(hit.depth);
        if !depth.is_finite() {
            return MISS;
        }
        let part = if far > near { (depth - near) / (far - near) } else { 0.0 };
        [(NEAR + (FAR - NEAR) * part).round() as u8; 3]
    })
}

fn normal(hit: &FirstHit) -> [u8; 3] {
    if hit.triangle == NO_HIT {
        return MISS;
    }
    // The cast keeps values that are out of range, or NaN, within a byte.
    hit.normal.map(|component| (f64::from(component + 1.0) * 127.5).round() as u8)
}

fn triangle(index: u32) -> [u8; 3] {
    if index == NO_HIT {
        return MISS;
    }
    // Steps of the golden ratio around the colour circle: successive indices get far apart, and the
    // circle fills evenly (Knuth, The Art of Computer Programming 3, 6.4, Fibonacci hashing).
    let turn = index.wrapping_mul(0x9e37_79b9);
    // Lightness by the other bits, so that hues that come close again differ in it.
    let lightness = index.wrapping_mul(0x85eb_ca6b) >> 24;
    let value = 160.0 + f64::from(lightness % 96);
    let saturation = 0.5 + f64::from(lightness / 96) * 0.2;
    let hue = f64::from(turn) / f64::from(u32::MAX) * 6.0;
    [5.0, 3.0, 1.0].map(|offset: f64| {
        let place = (offset + hue) % 6.0;
        let tent = place.min(4.0 - place).clamp(0.0, 1.0);
        (value * (1.0 - saturation * tent)).round() as u8
    })
}

fn cost(size: Size, costs: &[FirstCost], quantity: Quantity) -> RgbImage {
    // A size has at least one pixel.
    let top = CostStatistics::of(costs, quantity).map(|statistics| statistics.scale_top());
    scale::colours(size, costs, quantity, top.unwrap_or(std::num::NonZeroU32::MIN))
}

#[cfg(test)]
mod tests {
    use super::super::viridis;
    use super::*;
    use std::collections::HashSet;

    fn hit(depth: f32, normal: [f32; 3], triangle: u32) -> FirstHit {
        FirstHit { depth, normal, triangle, ..FirstHit::MISS }
    }

    fn row(aov: Aov<'_>, length: u32) -> Vec<[u8; 3]> {
        let image = aov.picture(Size::new(length, 1).unwrap()).unwrap();
        image.pixels().map(|pixel| pixel.0).collect()
    }

    #[test]
    fn depth_runs_from_white_to_dark_over_what_is_there() {
        let depths = [2.0, 4.0, 3.0, f32::INFINITY, f32::NAN].map(|d| hit(d, [0.0; 3], 0));
        assert_eq!(row(Aov::Depth(&depths), 5), [[255; 3], [40; 3], [148; 3], [0; 3], [0; 3]]);
        // A range beyond that of f32.
        let depths = [f32::MIN, f32::MAX].map(|d| hit(d, [0.0; 3], 0));
        assert_eq!(row(Aov::Depth(&depths), 2), [[255; 3], [40; 3]]);
    }

    #[test]
    fn one_depth_alone_is_white() {
        assert_eq!(row(Aov::Depth(&[hit(7.5, [0.0; 3], 3); 2]), 2), [[255; 3]; 2]);
    }

    #[test]
    fn misses_are_black() {
        let misses = [FirstHit::MISS; 3];
        for aov in [Aov::Depth(&misses), Aov::Normal(&misses), Aov::Triangle(&misses)] {
            assert_eq!(row(aov, 3), [[0; 3]; 3], "{}", aov.name());
        }
    }

    #[test]
    fn normals_are_moved_into_the_cube_of_colours() {
        let hits = [
            hit(1.0, [1.0, 0.0, -1.0], 0),
            hit(1.0, [0.0, -0.6, 0.5], 0),
            hit(1.0, [f32::NAN, f32::INFINITY, -9.0], 0),
        ];
        let expected = [[255, 128, 0], [128, 51, 191], [0, 255, 0]];
        assert_eq!(row(Aov::Normal(&hits), 3), expected);
    }

    #[test]
    fn triangles_have_colours_far_apart() {
        let colours: Vec<[u8; 3]> = (0..4096).map(triangle).collect();
        assert!(colours.iter().all(|c| c.iter().max().unwrap() >= &160), "black is for misses");
        let different: HashSet<&[u8; 3]> = colours.iter().collect();
        assert!(different.len() > 4000, "{}", different.len());
        for pair in colours.windows(2) {
            let apart: u32 = (0..3).map(|i| u32::from(pair[0][i].abs_diff(pair[1][i]))).sum();
            assert!(apart > 60, "{pair:?}");
        }
        // Every sixth of the circle gets about a sixth of them.
        let reds = colours.iter().filter(|c| c[0] > c[1] && c[1] >= c[2]).count();
        assert!((600..=760).contains(&reds), "{reds}");
        assert_ne!(triangle(u32::MAX - 1), [0; 3]);
    }

    #[test]
    fn costs_have_the_colours_of_the_heat_map() {
        let costs = [0, 1, 2].map(|i| FirstCost { nodes: 10 * i, triangles: i });
        let expected = [viridis::colour(0), viridis::colour(128), viridis::colour(255)];
        assert_eq!(row(Aov::Nodes(&costs), 3), expected);
        assert_eq!(row(Aov::Tests(&costs), 3), expected);
        assert_eq!(row(Aov::Tests(&[FirstCost::default()]), 1), [viridis::colour(0)]);
    }

    #[test]
    fn every_pixel_needs_a_value() {
        let size = Size::new(2, 2).unwrap();
        for (aov, what) in [
            (Aov::Depth(&[]), "the array of depths"),
            (Aov::Normal(&[]), "the array of normals"),
            (Aov::Triangle(&[]), "the array of triangles"),
            (Aov::Nodes(&[]), "the array of costs"),
            (Aov::Tests(&[]), "the array of costs"),
        ] {
            let error = aov.picture(size).unwrap_err().to_string();
            assert_eq!(error, format!("{what} has 0 values, but a picture of 2x2 pixels needs 4"));
        }
    }
}
