//! Streets, blocks and towers with windows set into their facades, as many triangles as asked for.
//! Sizes in metres.

use super::BuiltinError;
use super::builder::{Block, Builder, Point};
use crate::Scene;
use splitplane_core::random::unit;

/// Fewest and most triangles of a city.
pub(super) const LEAST: u64 = 1_000;
pub(super) const MOST: u64 = 10_000_000;
const DEFAULT: u64 = 200_000;

const SEED: u64 = 2008;
/// From one crossing to the next, and the parts of it that a pavement and a tower take.
const PITCH: f64 = 60.0;
const PAVEMENT: f64 = 46.0;
const TOWER: f64 = 40.0;
/// Triangles of a window: four frame strips, four reveals and the pane, two each.
const WINDOW: u64 = 18;

pub(super) fn open(size: Option<&str>) -> Result<Scene, BuiltinError> {
    Ok(make(super::size("city", size, DEFAULT, [LEAST, MOST])?))
}

/// One storey block of a tower.
struct Tier {
    lot: u64,
    body: Block,
    style: u32,
}

struct Paint {
    walls: [u32; 6],
    roof: u32,
    glass: [u32; 3],
    pavement: u32,
    asphalt: u32,
    line: u32,
    grass: u32,
    leaves: u32,
}

fn make(target: u64) -> Scene {
    let mut b = Builder::new("city");
    let paint = paint(&mut b);
    // Lots grow with the 3/8th power of the size, the rest goes into finer facades. Roots by
    // `sqrt`, which is exact to the last bit everywhere.
    let eighth = (target as f64).sqrt().sqrt().sqrt();
    let side = ((0.075 * eighth * eighth * eighth).round() as u64).max(3);
    let half = 0.5 * PITCH * side as f64;
    b.quad(
        paint.asphalt,
        ground([-half - PITCH, -half - PITCH], [half + PITCH, half + PITCH], 0.0),
    );
    let mut tiers = Vec::new();
    for lot in 0..side * side {
        let (i, j) = (lot % side, lot / side);
        let centre = [(i as f64 + 0.5) * PITCH - half, (j as f64 + 0.5) * PITCH - half];
        street(&mut b, &paint, centre);
        if unit(SEED, &[lot, 0]) < 0.09 && side > 3 {
            park(&mut b, &paint, lot, centre);
        } else {
            tower(&mut tiers, lot, centre, half);
            let top = tiers.last().map_or(0.0, |tier: &Tier| tier.body.hi[1]);
            roof_house(&mut b, &paint, lot, centre, top);
        }
    }
    let cell = cell_size(&tiers, target.saturating_sub(b.triangles() as u64));
    for tier in &tiers {
        facades(&mut b, &paint, tier, cell);
    }
    let edge = half as f32;
    let at = [-0.04 * edge, 24.0, 0.06 * edge];
    b.look([0.62 * edge + 60.0, 0.34 * edge + 90.0, 1.02 * edge + 70.0], at, 42.0);
    b.light([-2.2 * edge - 200.0, 1.6 * edge + 420.0, 1.3 * edge + 200.0], at);
    b.finish()
}

fn paint(b: &mut Builder) -> Paint {
    Paint {
        walls: [
            b.material("sandstone", [0.66, 0.53, 0.36]),
            b.material("brick", [0.48, 0.20, 0.13]),
            b.material("concrete", [0.52, 0.52, 0.50]),
            b.material("plaster", [0.80, 0.75, 0.66]),
            b.material("slate", [0.25, 0.31, 0.37]),
            b.material("ochre", [0.70, 0.44, 0.16]),
        ],
        roof: b.material("roof", [0.30, 0.29, 0.29]),
        glass: [
            b.material("glass", [0.05, 0.09, 0.14]),
            b.material("sky glass", [0.16, 0.28, 0.38]),
            b.material("lit glass", [0.95, 0.74, 0.36]),
        ],
        pavement: b.material("pavement", [0.46, 0.45, 0.43]),
        asphalt: b.material("asphalt", [0.12, 0.12, 0.13]),
        line: b.material("line", [0.80, 0.80, 0.76]),
        grass: b.material("grass", [0.17, 0.34, 0.09]),
        leaves: b.material("leaves", [0.10, 0.26, 0.07]),
    }
}

/// The corners of a rectangle on the ground, seen from above.
fn ground(lo: [f64; 2], hi: [f64; 2], y: f64) -> [Point; 4] {
    [[lo[0], y, lo[1]], [lo[0], y, hi[1]], [hi[0], y, hi[1]], [hi[0], y, lo[1]]]
}

/// The pavement of a lot and the broken lines on two of the streets beside it.
fn street(b: &mut Builder, paint: &Paint, [x, z]: [f64; 2]) {
    let h = 0.5 * PAVEMENT;
    let slab = Block { lo: [x - h, 0.0, z - h], hi: [x + h, 0.25, z + h] };
    b.block(paint.pavement, paint.pavement, slab, false);
    for step in [-1.0, 0.0, 1.0] {
        let at = step * PITCH / 3.6;
        let edge = 0.5 * PITCH;
        b.quad(
            paint.line,
            ground([x + edge - 0.2, z + at - 2.0], [x + edge + 0.2, z + at + 2.0], 0.02),
        );
        b.quad(
            paint.line,
            ground([x + at - 2.0, z + edge - 0.2], [x + at + 2.0, z + edge + 0.2], 0.02),
        );
    }
}

fn park(b: &mut Builder, paint: &Paint, lot: u64, [x, z]: [f64; 2]) {
    let h = 0.5 * TOWER;
    b.quad(paint.grass, ground([x - h, z - h], [x + h, z + h], 0.3));
    for tree in 0..9 {
        let spread = |k| (unit(SEED, &[lot, tree, k]) - 0.5) * 9.0;
        let (px, pz) = (x + (tree % 3) as f64 * 13.0 - 13.0, z + (tree / 3) as f64 * 13.0 - 13.0);
        let radius = 2.0 + 1.8 * unit(SEED, &[lot, tree, 2]);
        b.sphere(paint.leaves, [px + spread(0), 1.0 + 1.3 * radius, pz + spread(1)], radius, 4);
    }
}

/// One to three blocks on top of each other, higher towards the middle of the city.
fn tower(tiers: &mut Vec<Tier>, lot: u64, [x, z]: [f64; 2], half: f64) {
    let draw = |k: u64| unit(SEED, &[lot, 10 + k]);
    let away = (x * x + z * z).sqrt() / half;
    let middle = (1.0 - 0.75 * away).max(0.0);
    let height = 14.0 + 26.0 * draw(0) + 150.0 * middle * middle * draw(1);
    let style = (draw(2) * 6.0) as u32;
    let blocks = if height > 70.0 { 3 } else { 1 + (draw(3) * 2.0) as u32 };
    let mut low = 0.25;
    let mut width = TOWER * (0.75 + 0.25 * draw(4));
    let mut depth = TOWER * (0.75 + 0.25 * draw(5));
    for i in 0..blocks {
        let share = [0.5, 0.3, 0.2][i as usize] / [0.5, 0.8, 1.0][blocks as usize - 1];
        let high = low + height * share;
        let body = Block {
            lo: [x - 0.5 * width, low, z - 0.5 * depth],
            hi: [x + 0.5 * width, high, z + 0.5 * depth],
        };
        tiers.push(Tier { lot, body, style });
        low = high;
        width *= 0.78;
        depth *= 0.78;
    }
}

/// What stands on a flat roof.
fn roof_house(b: &mut Builder, paint: &Paint, lot: u64, [x, z]: [f64; 2], top: f64) {
    let draw = |k: u64| unit(SEED, &[lot, 20 + k]);
    let (px, pz) = (x + 6.0 * draw(0) - 3.0, z + 6.0 * draw(1) - 3.0);
    let (w, d) = (2.0 + 3.0 * draw(2), 2.0 + 3.0 * draw(3));
    let house =
        Block { lo: [px - w, top, pz - d], hi: [px + w, top + 3.0 + 2.0 * draw(4), pz + d] };
    b.block(paint.walls[2], paint.roof, house, false);
}

/// Windows across and up one side of a tier. A side that would have a single one is plain.
fn grid(width: f64, height: f64, cell: f64) -> [u64; 2] {
    let count = |length: f64| ((length / cell).round() as u64).max(1);
    [count(width), count(height * 0.85)]
}

fn side_triangles(width: f64, height: f64, cell: f64) -> u64 {
    match grid(width, height, cell) {
        [1, 1] => 2,
        [across, up] => across * up * WINDOW,
    }
}

/// The window size whose city comes nearest to this many triangles. Counts fall as windows grow, so
/// halving an interval finds it.
fn cell_size(tiers: &[Tier], target: u64) -> f64 {
    let count = |cell: f64| -> u64 {
        let sides = |body: &Block| {
            let [w, h, d] = [0, 1, 2].map(|k| body.hi[k] - body.lo[k]);
            2 + 2 * side_triangles(w, h, cell) + 2 * side_triangles(d, h, cell)
        };
        tiers.iter().map(|tier| sides(&tier.body)).sum()
    };
    let (mut fine, mut coarse) = (0.2, 400.0);
    for _ in 0..48 {
        let middle = 0.5 * (fine + coarse);
        if count(middle) > target {
            fine = middle;
        } else {
            coarse = middle;
        }
    }
    let excess = |cell: f64| count(cell).abs_diff(target);
    if excess(fine) < excess(coarse) { fine } else { coarse }
}

fn facades(b: &mut Builder, paint: &Paint, tier: &Tier, cell: f64) {
    let Block { lo, hi } = tier.body;
    let wall = paint.walls[tier.style as usize];
    b.quad(paint.roof, ground([lo[0], lo[2]], [hi[0], hi[2]], hi[1]));
    // Lower left corner and direction to the right of every side, seen from outside.
    let (w, d) = (hi[0] - lo[0], hi[2] - lo[2]);
    let sides = [
        ([lo[0], lo[1], hi[2]], [1.0, 0.0], w),
        ([hi[0], lo[1], hi[2]], [0.0, -1.0], d),
        ([hi[0], lo[1], lo[2]], [-1.0, 0.0], w),
        ([lo[0], lo[1], lo[2]], [0.0, 1.0], d),
    ];
    for (number, (corner, right, width)) in sides.into_iter().enumerate() {
        let height = hi[1] - lo[1];
        // A point of the side: to the right, up, and into the house.
        let at = |u: f64, v: f64, depth: f64| -> Point {
            let [dx, dz] = right;
            [corner[0] + u * dx + depth * dz, corner[1] + v, corner[2] + u * dz - depth * dx]
        };
        let [across, up] = grid(width, height, cell);
        if across * up == 1 {
            b.quad(
                wall,
                [at(0., 0., 0.), at(width, 0., 0.), at(width, height, 0.), at(0., height, 0.)],
            );
            continue;
        }
        let (cw, ch) = (width / across as f64, height / up as f64);
        for n in 0..across * up {
            let (i, j) = (n % across, n / across);
            let key = [tier.lot, number as u64, n, lo[1] as u64];
            let glass = match unit(SEED, &key) {
                x if x < 0.07 => paint.glass[2],
                x if x < 0.45 => paint.glass[1],
                _ => paint.glass[0],
            };
            let at = |u: f64, v: f64, d: f64| at((i as f64 + u) * cw, (j as f64 + v) * ch, d * cw);
            window(b, wall, glass, at);
        }
    }
}

/// One cell of a facade: wall around, reveals, and the pane set back.
fn window(b: &mut Builder, wall: u32, glass: u32, at: impl Fn(f64, f64, f64) -> Point) {
    let mut ring = |inset: [f64; 2], depth: f64| {
        let ([u, v], [p, q]) = (inset, [1.0 - inset[0], 1.0 - inset[1]]);
        [(u, v), (p, v), (p, q), (u, q)].map(|(x, y)| b.vertex(at(x, y, depth)))
    };
    let (outer, inner, pane) =
        (ring([0.0, 0.0], 0.0), ring([0.2, 0.18], 0.0), ring([0.2, 0.18], 0.12));
    for (outside, inside) in [(outer, inner), (inner, pane)] {
        for i in 0..4 {
            let j = (i + 1) % 4;
            b.join(wall, [outside[i], outside[j], inside[j], inside[i]]);
        }
    }
    b.join(glass, pane);
}
