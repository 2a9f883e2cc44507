//! Textures made here, from whole numbers and `+ - * /` only.

use crate::Texture;
use splitplane_core::random::unit;

const SEED: u64 = 41;
const SIDE: u32 = 512;

/// Oak planks, four across and two to a length, with grain and dark seams; it repeats without seam.
pub(super) fn planks() -> Option<Texture> {
    let width = SIDE / 4;
    square("planks", |x, y| {
        let row = x / width;
        // Planks of neighbouring rows end at different places.
        let along = (y + row * 151) % SIDE;
        let plank = u64::from(row * 2 + along / (SIDE / 2));
        let (across, along) = (x % width, along % (SIDE / 2));
        if across < 2 || along < 2 {
            return [58.0, 40.0, 26.0];
        }
        // Grain: fine along, coarse across, bent a little.
        let bend = 6.0 * noise(plank * 4, f64::from(along) / 60.0, 0.0);
        let lines = noise(plank * 4 + 1, (f64::from(across) + bend) / 5.0, f64::from(along) / 90.0);
        let fine = noise(plank * 4 + 2, f64::from(across) / 1.6, f64::from(along) / 24.0);
        let tone = 0.78 + 0.16 * unit(SEED, &[plank, 9]) + 0.13 * lines + 0.05 * fine;
        [196.0, 148.0, 99.0].map(|part| part * tone)
    })
}

/// Fields of light and dark stone, with veins.
pub(super) fn tiles() -> Option<Texture> {
    let tile = SIDE / 4;
    square("tiles", |x, y| {
        let (column, row) = (x / tile, y / tile);
        if x % tile < 2 || y % tile < 2 {
            return [92.0, 88.0, 84.0];
        }
        let number = u64::from(column * 4 + row) + 100;
        let (u, v) = (f64::from(x % tile), f64::from(y % tile));
        let bend = 22.0 * noise(number * 3, u / 30.0, v / 30.0);
        let vein = (noise(number * 3 + 1, (u + bend) / 26.0, (v - bend) / 26.0) - 0.5).abs();
        let cloud = noise(number * 3 + 2, u / 40.0, v / 40.0);
        let light = (column + row) % 2 == 0;
        let base = if light { [226.0, 218.0, 204.0] } else { [70.0, 66.0, 66.0] };
        let line = (1.0 - 14.0 * vein).max(0.0) * if light { -42.0 } else { 52.0 };
        base.map(|part| part * (0.94 + 0.08 * cloud) + line)
    })
}

/// A painting: bands of colour, a sun and its reflection.
pub(super) fn painting() -> Option<Texture> {
    square("painting", |x, y| {
        let (u, v) = (f64::from(x) / f64::from(SIDE), f64::from(y) / f64::from(SIDE));
        let wash = 0.9 + 0.2 * noise(900, 9.0 * u, 60.0 * v);
        let (dx, dy) = (u - 0.62, v - 0.40);
        let sun = dx * dx + dy * dy < 0.017;
        let hill = 0.56 + 0.10 * noise(901, 3.0 * u, 0.0) + 0.03 * noise(902, 14.0 * u, 0.0);
        let near = 0.78 + 0.09 * noise(903, 4.0 * u, 0.0);
        let base = if v > near {
            [34.0, 52.0, 62.0]
        } else if v > hill {
            [62.0, 104.0, 116.0]
        } else if sun {
            [246.0, 214.0, 120.0]
        } else {
            [236.0 - 60.0 * (1.0 - v), 150.0 - 50.0 * (1.0 - v), 92.0 + 70.0 * (1.0 - v)]
        };
        base.map(|part| part * wash)
    })
}

fn square(name: &str, colour: impl Fn(u32, u32) -> [f64; 3]) -> Option<Texture> {
    let texel = |i: u32| {
        let [r, g, b] = colour(i % SIDE, i / SIDE).map(|part| part.clamp(0.0, 255.0) as u8);
        [r, g, b, 255]
    };
    Texture::new(name, SIDE, SIDE, (0..SIDE * SIDE).map(texel).collect())
}

/// Smooth noise from 0 to 1: random values at whole coordinates, blended between.
pub(super) fn noise(layer: u64, x: f64, y: f64) -> f64 {
    let value = |i: f64, j: f64| unit(SEED, &[layer, i as i64 as u64, j as i64 as u64]);
    let (i, j) = (x.floor(), y.floor());
    let blend = |t: f64| t * t * (3.0 - 2.0 * t);
    let (s, t) = (blend(x - i), blend(y - j));
    let above = value(i, j) + s * (value(i + 1.0, j) - value(i, j));
    let below = value(i, j + 1.0) + s * (value(i + 1.0, j + 1.0) - value(i, j + 1.0));
    above + t * (below - above)
}
