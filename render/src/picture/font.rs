//! A font of 5 by 7 dots: the digits, and the letters that legends use.

use image::{Rgb, RgbImage};

/// Dots from left to right.
const WIDTH: u32 = 5;
/// Dots from top to bottom.
pub(super) const HEIGHT: u32 = 7;
/// Dots from one character to the next.
const ADVANCE: u32 = WIDTH + 1;

/// Rows of a character from top to bottom; bit 4 is its left dot. Other characters are blank.
const fn rows(character: char) -> [u8; HEIGHT as usize] {
    match character {
        '0' => [0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110],
        '1' => [0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110],
        '2' => [0b01110, 0b10001, 0b00001, 0b00110, 0b01000, 0b10000, 0b11111],
        '3' => [0b01110, 0b10001, 0b00001, 0b00110, 0b00001, 0b10001, 0b01110],
        '4' => [0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010],
        '5' => [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110],
        '6' => [0b00110, 0b01000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110],
        '7' => [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b01000, 0b01000],
        '8' => [0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110],
        '9' => [0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00010, 0b01100],
        '>' => [0b01000, 0b00100, 0b00010, 0b00001, 0b00010, 0b00100, 0b01000],
        'd' => [0b00001, 0b00001, 0b01101, 0b10011, 0b10001, 0b10011, 0b01101],
        'e' => [0b00000, 0b00000, 0b01110, 0b10001, 0b11111, 0b10000, 0b01110],
        'n' => [0b00000, 0b00000, 0b10110, 0b11001, 0b10001, 0b10001, 0b10001],
        'o' => [0b00000, 0b00000, 0b01110, 0b10001, 0b10001, 0b10001, 0b01110],
        's' => [0b00000, 0b00000, 0b01111, 0b10000, 0b01110, 0b00001, 0b11110],
        't' => [0b01000, 0b01000, 0b11100, 0b01000, 0b01000, 0b01001, 0b00110],
        _ => [0; HEIGHT as usize],
    }
}

/// Dots of a text from left to right.
pub(super) fn width(text: &str) -> u32 {
    (text.chars().count() as u32 * ADVANCE).saturating_sub(ADVANCE - WIDTH)
}

/// Writes a text with its top left corner at a pixel, in dots of `scale` by `scale` pixels. What lies
/// outside the picture is left out.
pub(super) fn write(
    image: &mut RgbImage,
    text: &str,
    (left, top): (u32, u32),
    scale: u32,
    colour: [u8; 3],
) {
    for (place, character) in text.chars().enumerate() {
        let left = left + place as u32 * ADVANCE * scale;
        for (row, bits) in rows(character).into_iter().enumerate() {
            for column in (0..WIDTH).filter(|column| bits >> (WIDTH - 1 - column) & 1 == 1) {
                let (x, y) = (left + column * scale, top + row as u32 * scale);
                fill(image, (x, y), (scale, scale), colour);
            }
        }
    }
}

/// Fills a rectangle, as far as it lies in the picture.
pub(super) fn fill(
    image: &mut RgbImage,
    (left, top): (u32, u32),
    (width, height): (u32, u32),
    colour: [u8; 3],
) {
    for y in top..(top + height).min(image.height()) {
        for x in left..(left + width).min(image.width()) {
            image.put_pixel(x, y, Rgb(colour));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_character_looks_like_itself() {
        let mut image = RgbImage::new(width("0123456789>"), HEIGHT);
        write(&mut image, "0123456789>", (0, 0), 1, [255; 3]);
        insta::assert_snapshot!(drawn(&image), @r"
        .###....#....###...###.....#..#####...##..#####..###...###...#...
        #...#..##...#...#.#...#...##..#......#........#.#...#.#...#...#..
        #..##...#.......#.....#..#.#..####..#........#..#...#.#...#....#.
        #.#.#...#.....##....##..#..#......#.####....#....###...####.....#
        ##..#...#....#........#.#####.....#.#...#..#....#...#.....#....#.
        #...#...#...#.....#...#....#..#...#.#...#..#....#...#....#....#..
        .###...###..#####..###.....#...###...###...#.....###...##....#...
        ");
        let mut image = RgbImage::new(width("nodes tests"), HEIGHT);
        write(&mut image, "nodes tests", (0, 0), 1, [255; 3]);
        insta::assert_snapshot!(drawn(&image), @r"
        ................#....................#.................#.........
        ................#....................#.................#.........
        #.##...###...##.#..###...####.......###....###...####.###....####
        ##..#.#...#.#..##.#...#.#............#....#...#.#......#....#....
        #...#.#...#.#...#.#####..###.........#....#####..###...#.....###.
        #...#.#...#.#..##.#.........#........#..#.#.........#..#..#.....#
        #...#..###...##.#..###..####..........##...###..####....##..####.
        ");
    }

    #[test]
    fn dots_are_scaled_and_cut_at_the_edge() {
        let mut image = RgbImage::new(9, 30);
        write(&mut image, "1", (2, 1), 2, [9; 3]);
        let lit: Vec<(u32, u32)> =
            image.enumerate_pixels().filter(|p| p.2.0 == [9; 3]).map(|p| (p.0, p.1)).collect();
        // The one's top dot is column 2, so pixels 6 and 7; its foot runs to pixel 9, cut at 8.
        assert_eq!(lit[..4], [(6, 1), (7, 1), (6, 2), (7, 2)]);
        assert_eq!(lit.iter().map(|p| p.0).max(), Some(8));
        assert_eq!(lit.iter().map(|p| p.1).max(), Some(14));
    }

    #[test]
    fn a_text_has_no_gap_at_its_end() {
        assert_eq!((width(""), width("0"), width("10")), (0, 5, 11));
    }

    /// A picture as text: `#` for what is not black.
    fn drawn(image: &RgbImage) -> String {
        let rows = image.rows().map(|row| {
            let row: String = row.map(|p| if p.0 == [0; 3] { '.' } else { '#' }).collect();
            row + "\n"
        });
        rows.collect()
    }
}
