//! The picture of a cloud: discs in the isometric view, the nearest before the others.

use super::planes;
use super::report::PointsReport;
use super::work::{Work, room};
use crate::failure::Failure;
use crate::{ending, files};
use image::{Rgb, RgbImage};
use splitplane::picture::encode_png;
use splitplane::render::Size;
use std::path::Path;

/// To the right, upwards, and towards the viewer, who stands where all coordinates are great.
const VIEW: [[f64; 3]; 3] = [
    [0.707_106_781_186_547_5, 0.0, -0.707_106_781_186_547_5],
    [-0.408_248_290_463_863, 0.816_496_580_927_726, -0.408_248_290_463_863],
    [0.577_350_269_189_625_8; 3],
];
/// Colours from the lowest point to the highest.
const COLOURS: [[f64; 3]; 5] = [
    [68.0, 60.0, 130.0],
    [49.0, 110.0, 142.0],
    [42.0, 158.0, 122.0],
    [130.0, 196.0, 80.0],
    [238.0, 214.0, 70.0],
];
const PAPER: [u8; 3] = [247, 247, 245];
/// Pixels around the cloud.
const MARGIN: f64 = 24.0;

pub(super) fn draw(
    work: &Work<'_>,
    k: usize,
    size: Size,
    report: &PointsReport,
    path: &Path,
) -> Result<(), Failure> {
    let Some(bounds) = report.bounds else {
        return Err(Failure::file("there is no point to draw; leave --picture out"));
    };
    let planes = planes::fit(work, k, None)?;
    let map = Map::new(bounds, size);
    // Discs that nearly touch where the points are even.
    let spacing = report.spacing.as_ref().map_or(0.0, |spacing| f64::from(spacing.median));
    let radius = (0.7 * spacing * map.scale).clamp(1.0, 12.0);
    let (width, height) = (size.width() as usize, size.height() as usize);
    let mut depths = room(width * height, f32::NEG_INFINITY, work.limit)?;
    let mut image = RgbImage::from_pixel(size.width(), size.height(), Rgb(PAPER));
    let [low, high] = [0, 1].map(|side| f64::from(bounds[side][1]));
    for (index, point) in work.points.iter().enumerate() {
        if index % (1 << 16) == 0 {
            ending::check()?;
        }
        if !point.iter().all(|x| x.is_finite()) {
            continue;
        }
        let [x, y, depth] = map.pixel(point.map(f64::from));
        let part = if high > low { (f64::from(point[1]) - low) / (high - low) } else { 0.5 };
        let colour = shaded(part, planes[index].normal);
        let reach = radius.ceil() as i64;
        let (left, top) = (x.floor() as i64, y.floor() as i64);
        for row in (top - reach).max(0)..(top + reach + 1).min(height as i64) {
            for column in (left - reach).max(0)..(left + reach + 1).min(width as i64) {
                let off = [column as f64 + 0.5 - x, row as f64 + 0.5 - y];
                if off[0] * off[0] + off[1] * off[1] > radius * radius {
                    continue;
                }
                let before = &mut depths[row as usize * width + column as usize];
                if depth as f32 > *before {
                    *before = depth as f32;
                    image.put_pixel(column as u32, row as u32, Rgb(colour));
                }
            }
        }
    }
    files::write(path, &encode_png(&image)?)
}

/// The colour of a height, 0 to 1, lit from above the viewer's left.
fn shaded(part: f64, normal: [f32; 3]) -> [u8; 3] {
    let place = part.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
    let below = (place as usize).min(COLOURS.len() - 2);
    let along = place - below as f64;
    let light = [0.36, 0.84, 0.41];
    let facing: f64 = (0..3).map(|axis| light[axis] * f64::from(normal[axis])).sum();
    // Points without a normal are lit as they are.
    let lit = if normal == [0.0; 3] { 1.0 } else { 0.45 + 0.55 * facing.abs() };
    [0, 1, 2].map(|channel| {
        let [a, b] = [COLOURS[below][channel], COLOURS[below + 1][channel]];
        ((a + (b - a) * along) * lit).round() as u8
    })
}

/// From space to pixels.
struct Map {
    scale: f64,
    /// What is in the middle of the picture, to the right and upwards.
    middle: [f64; 2],
    centre: [f64; 2],
    /// Divides coordinates, so that clouds of all sizes have depths of `f32`.
    unit: f64,
}

fn seen(point: [f64; 3]) -> [f64; 3] {
    VIEW.map(|axis| (axis[0] * point[0] + axis[1] * point[1]) + axis[2] * point[2])
}

impl Map {
    fn new(bounds: [[f32; 3]; 2], size: Size) -> Map {
        let (mut lower, mut upper) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for corner in 0..8 {
            let at = [0, 1, 2].map(|axis| f64::from(bounds[corner >> axis & 1][axis]));
            let at = seen(at);
            for axis in 0..3 {
                lower[axis] = lower[axis].min(at[axis]);
                upper[axis] = upper[axis].max(at[axis]);
            }
        }
        let pixels =
            [size.width(), size.height()].map(|side| (f64::from(side) - 2.0 * MARGIN).max(1.0));
        let extent = [upper[0] - lower[0], upper[1] - lower[1]];
        let scale = (pixels[0] / extent[0]).min(pixels[1] / extent[1]);
        // A single point is in the middle at any scale.
        let scale = if scale.is_finite() { scale } else { 1.0 };
        Map {
            scale,
            middle: [0, 1].map(|axis| 0.5 * (lower[axis] + upper[axis])),
            centre: [size.width(), size.height()].map(|side| 0.5 * f64::from(side)),
            unit: upper[2].abs().max(lower[2].abs()).max(f64::MIN_POSITIVE),
        }
    }

    /// To the right, downwards, and how near.
    fn pixel(&self, point: [f64; 3]) -> [f64; 3] {
        let [right, up, near] = seen(point);
        let x = self.centre[0] + (right - self.middle[0]) * self.scale;
        let y = self.centre[1] - (up - self.middle[1]) * self.scale;
        [x, y, near / self.unit]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_view_is_that_of_a_corner() {
        for (a, one) in VIEW.iter().enumerate() {
            for (b, other) in VIEW.iter().enumerate() {
                let product: f64 = one.iter().zip(other).map(|(x, y)| x * y).sum();
                assert!((product - f64::from(u8::from(a == b))).abs() < 1e-12);
            }
        }
        let map = Map::new([[0.0; 3], [2.0; 3]], Size::new(200, 100).unwrap());
        let [x, y, _] = map.pixel([1.0; 3]);
        assert!((x - 100.0).abs() < 1e-9 && (y - 50.0).abs() < 1e-9);
        let [_, higher, _] = map.pixel([1.0, 2.0, 1.0]);
        assert!(higher < y, "up is up");
        let [right, _, _] = map.pixel([2.0, 1.0, 1.0]);
        assert!(right > x, "x is to the right");
    }
}
