//! The hard case for a spatial median: a knot of 58 thousand triangles, 30 cm across, in the middle
//! of an arena of a few hundred triangles and five kilometres of ground. Sizes in metres.

use super::builder::{Block, Builder, Point, unit};
use super::shape::{cross, dot, sub};
use crate::Scene;
use crate::angle::sin_cos;

/// Steps along the knot and around its tube.
const ALONG: u32 = 600;
const AROUND: u32 = 48;
const TIERS: u32 = 14;
const SEGMENTS: u32 = 48;

pub(super) fn make() -> Scene {
    let mut b = Builder::new("stadium");
    let copper = b.material("copper", [0.80, 0.36, 0.18]);
    let stone = b.material("stone", [0.55, 0.53, 0.50]);
    let grass = b.material("grass", [0.16, 0.32, 0.10]);
    let earth = b.material("earth", [0.36, 0.31, 0.24]);
    let seats =
        [b.material("blue seats", [0.10, 0.22, 0.50]), b.material("grey seats", [0.6, 0.6, 0.62])];
    // The arena lies off the middle of the ground, so no halving of the bounds finds the knot.
    let e = 2600.0;
    b.quad(
        earth,
        [[-e, -0.05, -e], [-e, -0.05, 0.7 * e], [0.8 * e, -0.05, 0.7 * e], [0.8 * e, -0.05, -e]],
    );
    disc(&mut b, grass, 62.0);
    for tier in 0..TIERS {
        let (inner, outer) = (64.0 + 2.4 * f64::from(tier), 66.4 + 2.4 * f64::from(tier));
        let (low, high) = (1.5 * f64::from(tier), 1.5 * f64::from(tier + 1));
        let rows = [ring(&mut b, inner, low), ring(&mut b, inner, high), ring(&mut b, outer, high)];
        let colour = seats[usize::from(tier % 4 == 3)];
        b.band(if tier == 0 { stone } else { colour }, &rows[1], &rows[0]);
        b.band(colour, &rows[2], &rows[1]);
    }
    b.block(stone, stone, Block { lo: [-0.09, -0.05, -0.07], hi: [0.09, 0.10, 0.07] }, false);
    knot(&mut b, copper, [0.0, 0.262, 0.0], 0.044);
    b.look([0.26, 0.36, 0.62], [0.0, 0.225, 0.0], 38.0);
    b.light([-1.6, 2.2, 1.9], [0.0, 0.225, 0.0]);
    b.finish()
}

/// A ring of vertices that runs so that the arena's sides face its middle.
fn ring(b: &mut Builder, radius: f64, y: f64) -> Vec<u32> {
    (0..SEGMENTS)
        .map(|i| {
            let (sin, cos) = sin_cos(f64::from(i) / f64::from(SEGMENTS));
            b.vertex([radius * cos, y, radius * sin])
        })
        .collect()
}

fn disc(b: &mut Builder, material: u32, radius: f64) {
    let rim = ring(b, radius, 0.0);
    let middle = b.vertex([0.0, 0.0, 0.0]);
    b.band(material, &vec![middle; rim.len()], &rim);
}

/// A (2, 3) torus knot, standing upright.
fn knot(b: &mut Builder, material: u32, centre: Point, scale: f64) {
    let on_curve = |turns: f64| -> Point {
        let (wave_sin, wave_cos) = sin_cos(3.0 * turns);
        let (sin, cos) = sin_cos(2.0 * turns + 0.75);
        let r = 2.0 + 1.1 * wave_cos;
        [r * cos, r * sin, 1.1 * wave_sin]
    };
    let rows: Vec<Vec<u32>> = (0..ALONG)
        .map(|i| {
            let turns = f64::from(i) / f64::from(ALONG);
            let here = on_curve(turns);
            let along = unit(sub(on_curve(turns + 1e-4), on_curve(turns - 1e-4)));
            // Away from the middle of the torus' tube, made perpendicular to the curve: a frame
            // that comes back to itself after a full round.
            let (sin, cos) = sin_cos(2.0 * turns + 0.75);
            let outwards = sub(here, [2.0 * cos, 2.0 * sin, 0.0]);
            let lean = dot(outwards, along);
            let normal = unit(std::array::from_fn(|k| outwards[k] - lean * along[k]));
            let side = cross(along, normal);
            (0..AROUND)
                .map(|j| {
                    let (sin, cos) = sin_cos(f64::from(j) / f64::from(AROUND));
                    b.vertex(std::array::from_fn(|k| {
                        centre[k] + scale * (here[k] + 0.42 * (cos * normal[k] + sin * side[k]))
                    }))
                })
                .collect()
        })
        .collect();
    for i in 0..rows.len() {
        b.band(material, &rows[(i + 1) % rows.len()], &rows[i]);
    }
}
