//! The box every renderer starts with: red and green walls, two white blocks, open to the front.
//! Proportions after the measured box of Cornell University (Goral et al. 1984), in metres.

use super::builder::{Builder, Point};
use crate::Scene;

const SIZE: f64 = 5.5;

pub(super) fn make() -> Scene {
    let mut b = Builder::new("cornell");
    let white = b.material("white", [0.73, 0.71, 0.68]);
    let red = b.material("red", [0.63, 0.065, 0.05]);
    let green = b.material("green", [0.14, 0.45, 0.091]);
    let s = SIZE;
    let corner = |x: f64, y: f64, z: f64| -> Point { [x * s, y * s, z * s] };
    let c = corner;
    b.quad(white, [c(0., 0., 0.), c(0., 0., 1.), c(1., 0., 1.), c(1., 0., 0.)]);
    b.quad(white, [c(0., 1., 0.), c(1., 1., 0.), c(1., 1., 1.), c(0., 1., 1.)]);
    b.quad(white, [c(0., 0., 0.), c(1., 0., 0.), c(1., 1., 0.), c(0., 1., 0.)]);
    b.quad(red, [c(0., 0., 1.), c(0., 0., 0.), c(0., 1., 0.), c(0., 1., 1.)]);
    b.quad(green, [c(1., 0., 0.), c(1., 0., 1.), c(1., 1., 1.), c(1., 1., 0.)]);
    turned_block(&mut b, white, [0.34, 0.34], [0.15, 0.055], 0.6);
    turned_block(&mut b, white, [0.67, 0.66], [0.145, -0.05], 0.3);
    b.look([2.75, 2.75, 13.4], [2.75, 2.75, 2.0], 36.0);
    b.light([1.6, 3.7, 7.8], [2.75, 0.0, 2.75]);
    b.finish()
}

/// A block with a square footprint around `centre`, `half` being the middle of one of its sides as
/// seen from there, all in parts of the box.
fn turned_block(b: &mut Builder, material: u32, centre: [f64; 2], half: [f64; 2], height: f64) {
    let [[x, z], [p, q]] = [centre, half];
    // The four corners, around counter-clockwise seen from above.
    let around = [
        [x + p + q, z + q - p],
        [x - p + q, z - q - p],
        [x - p - q, z - q + p],
        [x + p - q, z + q + p],
    ];
    let at = |i: usize, y: f64| -> Point { [around[i][0] * SIZE, y * SIZE, around[i][1] * SIZE] };
    for i in 0..4 {
        let j = (i + 1) % 4;
        b.quad(material, [at(j, 0.0), at(i, 0.0), at(i, height), at(j, height)]);
    }
    b.quad(material, [at(3, height), at(0, height), at(1, height), at(2, height)]);
}
