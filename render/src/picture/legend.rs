//! The colour scale beside a heat map.
//!
//! From top to bottom: what is counted, the colour of what is above the scale, the scale. Its panel is
//! put to the right of the picture, so that no pixel is covered. A picture too low for a legible scale
//! gets a strip below it.

use super::scale::{ABOVE, colour};
use super::{Quantity, font, viridis};
use image::{GenericImage, RgbImage};
use std::num::NonZeroU32;

const BACKGROUND: [u8; 3] = [24; 3];
const INK: [u8; 3] = [232; 3];

// All lengths are in dots of the font.
const MARGIN: u32 = 4;
const BAR_WIDTH: u32 = 8;
/// From the bar to its numbers; half of it is a tick.
const TICK: u32 = 4;
/// Top of the patch for what is above the scale: under the title and a gap.
const PATCH: u32 = MARGIN + font::HEIGHT + 4;
/// Top of the bar: its number reaches 3 dots above it, and must not touch that of the patch.
const BAR: u32 = PATCH + font::HEIGHT + 7;
/// Least height of the bar: three numbers.
const LEAST_BAR: u32 = 3 * SPACING;
/// Least distance of two numbers from middle to middle.
const SPACING: u32 = font::HEIGHT + 3;
/// Most steps of the scale: more numbers do not make it easier to read.
const MOST_STEPS: u32 = 10;
/// Least height of a panel. Half a number hangs below the bar.
const LEAST_HEIGHT: u32 = BAR + LEAST_BAR + font::HEIGHT / 2 + MARGIN;

/// Pixels per dot for a picture of some height: the numbers of a 1080-line picture are 21 lines
/// high.
fn scale(height: u32) -> u32 {
    (height / 360).max(1)
}

/// A picture with the scale from 0 to `top` to its right.
pub(super) fn beside(picture: &RgbImage, quantity: Quantity, top: NonZeroU32) -> RgbImage {
    let scale = scale(picture.height());
    let above = format!(">{top}");
    let words = (BAR_WIDTH + TICK + font::width(&above)).max(font::width(quantity.name()));
    let width = picture.width() + scale * (MARGIN + words + MARGIN);
    let height = picture.height().max(scale * LEAST_HEIGHT);
    let mut image = RgbImage::from_pixel(width, height, image::Rgb(BACKGROUND));
    // It fits: the canvas has at least the picture's width and height.
    let _ = image.copy_from(picture, 0, 0);

    let left = picture.width() + scale * MARGIN;
    let numbers = left + scale * (BAR_WIDTH + TICK);
    font::write(&mut image, quantity.name(), (left, scale * MARGIN), scale, INK);
    let patch = (scale * BAR_WIDTH, scale * font::HEIGHT);
    font::fill(&mut image, (left, scale * PATCH), patch, ABOVE);
    font::write(&mut image, &above, (numbers, scale * PATCH), scale, INK);

    let first = scale * BAR;
    let last = height - scale * (MARGIN + font::HEIGHT / 2) - 1;
    for y in first..=last {
        let step = (last - y) * 255 / (last - first);
        let row = viridis::colour(step as u8);
        font::fill(&mut image, (left, y), (scale * BAR_WIDTH, 1), row);
    }
    for value in ticks(top, ((last - first) / (scale * SPACING)).min(MOST_STEPS)) {
        let up = u64::from(last - first) * u64::from(value) / u64::from(top.get());
        let y = last - up as u32;
        let tick = (left + scale * BAR_WIDTH, y);
        font::fill(&mut image, tick, (scale * TICK / 2, 1), INK);
        let middle = scale * (font::HEIGHT / 2) + scale / 2;
        font::write(&mut image, &value.to_string(), (numbers, y - middle), scale, INK);
    }
    debug_assert_eq!(image.get_pixel(left, first).0, colour(top.get(), top));
    image
}

/// The numbers at a scale from 0 to `top` that has space for `room` steps: 0, round numbers, and
/// `top`.
fn ticks(top: NonZeroU32, room: u32) -> Vec<u32> {
    let (top, room) = (u64::from(top.get()), u64::from(room.max(1)));
    let steps = || (0..=9).flat_map(|power| [1, 2, 5].map(|digit| digit * 10_u64.pow(power)));
    // Steps that end exactly at the top look best.
    let step = steps()
        .find(|&step| top.is_multiple_of(step) && (2..=room).contains(&(top / step)))
        .or_else(|| steps().find(|&step| top <= step * room))
        .unwrap_or(top);
    // The top is always there; a number too close below it gives way.
    let below = (0..top).step_by(step as usize).filter(|&value| (top - value) * room >= top);
    below.chain([top]).map(|value| value as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ticks_of(top: u32, room: u32) -> Vec<u32> {
        ticks(NonZeroU32::new(top).unwrap(), room)
    }

    #[test]
    fn numbers_are_round_and_end_at_the_top() {
        assert_eq!(ticks_of(80, 10), [0, 10, 20, 30, 40, 50, 60, 70, 80]);
        assert_eq!(ticks_of(80, 5), [0, 20, 40, 60, 80]);
        assert_eq!(ticks_of(15, 8), [0, 5, 10, 15]);
        assert_eq!(ticks_of(1, 8), [0, 1]);
        assert_eq!(ticks_of(2, 8), [0, 1, 2]);
        assert_eq!(ticks_of(1, 1), [0, 1]);
        // Given by hand and not round: 35 would touch 37.
        assert_eq!(ticks_of(37, 8), [0, 5, 10, 15, 20, 25, 30, 37]);
    }

    #[test]
    fn numbers_never_touch() {
        for top in (1..3000).chain([99_999, 1 << 31, u32::MAX - 1, u32::MAX]) {
            for room in [1, 2, 3, 7, 20] {
                let ticks = ticks_of(top, room);
                assert_eq!((ticks.first(), ticks.last()), (Some(&0), Some(&top)));
                for pair in ticks.windows(2) {
                    let apart = u64::from(pair[1] - pair[0]) * u64::from(room);
                    assert!(apart >= u64::from(top), "{top} {room}: {ticks:?}");
                }
            }
        }
    }

    #[test]
    fn the_picture_is_not_covered() {
        for (width, height) in [(1, 1), (320, 180), (40, 1080)] {
            let picture =
                RgbImage::from_fn(width, height, |x, y| image::Rgb([x as u8, y as u8, 7]));
            let top = NonZeroU32::new(120).unwrap();
            let image = beside(&picture, Quantity::Tests, top);
            for (x, y, pixel) in picture.enumerate_pixels() {
                assert_eq!(image.get_pixel(x, y), pixel);
            }
            // Nothing runs into the edges of the panel.
            for x in width..image.width() {
                assert_eq!(image.get_pixel(x, 0).0, BACKGROUND);
                assert_eq!(image.get_pixel(x, image.height() - 1).0, BACKGROUND);
            }
            for y in 0..image.height() {
                assert_eq!(image.get_pixel(image.width() - 1, y).0, BACKGROUND);
            }
        }
    }

    #[test]
    fn a_legend_as_rows_of_text() {
        let picture = RgbImage::new(1, 1);
        let image = beside(&picture, Quantity::Nodes, NonZeroU32::new(40).unwrap());
        let rows = image.rows().map(|row| {
            let row = row.map(|pixel| match pixel.0 {
                BACKGROUND => '.',
                INK => '#',
                ABOVE => '^',
                [0, 0, 0] => '@',
                _ => '|',
            });
            row.chain(['\n']).collect::<String>()
        });
        insta::assert_snapshot!(rows.collect::<String>(), @r"
        @.....................................
        ......................................
        ......................................
        ......................................
        .....................#................
        .....................#................
        .....#.##...###...##.#..###...####....
        .....##..#.#...#.#..##.#...#.#........
        .....#...#.#...#.#...#.#####..###.....
        .....#...#.#...#.#..##.#.........#....
        .....#...#..###...##.#..###..####.....
        ......................................
        ......................................
        ......................................
        ......................................
        .....^^^^^^^^.....#.......#...###.....
        .....^^^^^^^^......#.....##..#...#....
        .....^^^^^^^^.......#...#.#..#..##....
        .....^^^^^^^^........#.#..#..#.#.#....
        .....^^^^^^^^.......#..#####.##..#....
        .....^^^^^^^^......#......#..#...#....
        .....^^^^^^^^.....#.......#...###.....
        ......................................
        ......................................
        ......................................
        ......................................
        ....................#...###...........
        ...................##..#...#..........
        ..................#.#..#..##..........
        .....||||||||##..#..#..#.#.#..........
        .....||||||||....#####.##..#..........
        .....||||||||.......#..#...#..........
        .....||||||||.......#...###...........
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.....###...###...........
        .....||||||||....#...#.#...#..........
        .....||||||||........#.#..##..........
        .....||||||||##....##..#.#.#..........
        .....||||||||.....#....##..#..........
        .....||||||||....#.....#...#..........
        .....||||||||....#####..###...........
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.........................
        .....||||||||.....###.................
        .....||||||||....#...#................
        .....||||||||....#..##................
        .....||||||||##..#.#.#................
        .................##..#................
        .................#...#................
        ..................###.................
        ......................................
        ......................................
        ......................................
        ......................................
        ");
    }

    #[test]
    fn the_scale_runs_from_the_first_colour_to_the_last() {
        let top = NonZeroU32::new(500).unwrap();
        let image = beside(&RgbImage::new(4, 720), Quantity::Tests, top);
        let left = 4 + 2 * MARGIN;
        let column: Vec<[u8; 3]> = (0..720).map(|y| image.get_pixel(left, y).0).collect();
        let bar: Vec<[u8; 3]> = column[2 * BAR as usize..]
            .iter()
            .copied()
            .take_while(|&colour| colour != BACKGROUND)
            .collect();
        assert_eq!(bar.first(), Some(&colour(500, top)));
        assert_eq!(bar.last(), Some(&colour(0, top)));
        assert!(bar.len() > 600, "{}", bar.len());
        assert_eq!(column[2 * PATCH as usize], ABOVE);
    }
}
