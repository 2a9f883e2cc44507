//! A gallery, open to the front: everything that a ray tracer shows. Sizes in metres.

use super::builder::{Block, Builder, Point};
use super::paint;
use super::shape::Tube;
use crate::angle::sin_cos;
use crate::{Material, Scene};

/// Half the room's width, its height, and where it ends at the back and at the open front.
const HALF: f64 = 6.0;
const HEIGHT: f64 = 4.4;
const BACK: f64 = -5.0;
const FRONT: f64 = 5.0;
/// The panel in the ceiling: half its width, and its ends.
const PANEL: [f64; 3] = [2.6, -2.2, 1.2];

pub(super) fn make() -> Scene {
    let mut b = Builder::new("gallery");
    room(&mut b);
    paintings(&mut b);
    let plinth = b.material("plinth", [0.74, 0.73, 0.71]);
    let stand = |b: &mut Builder, [x, z]: [f64; 2], half: f64, height: f64| -> Point {
        let block = Block { lo: [x - half, 0.0, z - half], hi: [x + half, height, z + half] };
        b.block(plinth, plinth, block, false);
        [x, height, z]
    };

    let clear = Material::new("glass", [0.0; 3]).with_dielectric(1.5, [0.98, 0.99, 0.98]);
    let glass = b.add_material(clear);
    let [x, y, z] = stand(&mut b, [-1.55, 0.7], 0.42, 0.62);
    b.round_sphere(glass, [x, y + 0.58, z], 0.58, 44);

    let silver = Material::new("mirror", [0.0; 3]).with_mirror([0.94, 0.94, 0.95]);
    let mirror = b.add_material(silver);
    let [x, y, z] = stand(&mut b, [1.75, -1.3], 0.5, 0.5);
    b.round_sphere(mirror, [x, y + 0.8, z], 0.8, 44);

    let bronze = Material::new("bronze", [0.42, 0.20, 0.08]).with_mirror([0.22, 0.15, 0.10]);
    let bronze = b.add_material(bronze);
    let foot = stand(&mut b, [-0.35, -2.9], 0.5, 0.9);
    knot(&mut b, bronze, [foot[0], foot[1] + 0.80, foot[2]], 0.26);

    let glaze = Material::new("glaze", [0.50, 0.04, 0.03]).with_mirror([0.06; 3]);
    let glaze = b.add_material(glaze);
    let foot = stand(&mut b, [-3.7, -2.4], 0.4, 0.8);
    vase(&mut b, glaze, foot);

    let foot = stand(&mut b, [4.1, -3.2], 0.62, 0.7);
    pyramid(&mut b, foot);

    let foot = stand(&mut b, [-3.75, 1.35], 0.62, 0.25);
    glass_block(&mut b, foot);
    basin(&mut b, [2.75, 0.0, 1.35]);
    columns(&mut b);

    b.look([0.35, 1.72, 8.3], [-0.05, 1.2, -0.6], 42.0);
    b.finish()
}

fn room(b: &mut Builder) {
    let plaster = b.material("plaster", [0.76, 0.74, 0.70]);
    let accent = b.material("accent", [0.10, 0.19, 0.24]);
    let terracotta = b.material("terracotta", [0.55, 0.27, 0.17]);
    let skirting = b.material("skirting", [0.20, 0.14, 0.10]);
    let floor = b.textured("floor", paint::planks());
    let panel = Material::new("panel", [0.8; 3]).with_emission([9.0, 8.5, 7.7]);
    let panel = b.add_material(panel);
    let (w, h, back, front) = (HALF, HEIGHT, BACK, FRONT);

    // The floor goes on as a terrace before the room.
    let start = b.mark();
    let edge = front + 3.0;
    b.quad(floor, [[-w, 0., back], [-w, 0., edge], [w, 0., edge], [w, 0., back]]);
    b.give_texcoords(start, |[x, _, z]| [x / 2.4, -z / 2.4]);

    b.quad(accent, [[-w, 0., back], [w, 0., back], [w, h, back], [-w, h, back]]);
    b.quad(plaster, [[-w, 0., front], [-w, 0., back], [-w, h, back], [-w, h, front]]);
    b.quad(terracotta, [[w, 0., back], [w, 0., front], [w, h, front], [w, h, back]]);
    // The ceiling runs around the panel, which lies flush in it and so lights one side only.
    let [p, far, near] = PANEL;
    let mut down = |material, x: [f64; 2], z: [f64; 2]| {
        b.quad(material, [[x[0], h, z[0]], [x[1], h, z[0]], [x[1], h, z[1]], [x[0], h, z[1]]]);
    };
    down(plaster, [-w, w], [back, far]);
    down(plaster, [-w, w], [near, front]);
    down(plaster, [-w, -p], [far, near]);
    down(plaster, [p, w], [far, near]);
    down(panel, [-p, p], [far, near]);
    // Skirting boards along the walls.
    let (thick, high) = (0.03, 0.12);
    for (lo, hi) in [
        ([-w, 0.0, back], [w, high, back + thick]),
        ([-w, 0.0, back + thick], [-w + thick, high, front]),
        ([w - thick, 0.0, back + thick], [w, high, front]),
    ] {
        b.block(skirting, skirting, Block { lo, hi }, false);
    }
}

/// Framed pictures on the back wall.
fn paintings(b: &mut Builder) {
    let frame = b.material("frame", [0.36, 0.24, 0.09]);
    let canvas = b.textured("painting", paint::painting());
    for [x, half] in [[-3.1, 1.0], [2.6, 1.3]] {
        let (low, high) = (2.1 - 0.7 * half, 2.1 + 0.7 * half);
        let lo = [x - half - 0.08, low - 0.08, BACK];
        let hi = [x + half + 0.08, high + 0.08, BACK + 0.05];
        b.block(frame, frame, Block { lo, hi }, true);
        let start = b.mark();
        let z = BACK + 0.055;
        let [left, right] = [x - half, x + half];
        b.quad(canvas, [[left, low, z], [right, low, z], [right, high, z], [left, high, z]]);
        let of = |point: [f32; 3]| {
            let part =
                |value: f32, from: f64, to: f64| ((f64::from(value) - from) / (to - from)) as f32;
            [part(point[0], left, right), part(point[1], low, high)]
        };
        b.give_texcoords(start, of);
    }
}

/// A (2, 3) torus knot, standing upright.
fn knot(b: &mut Builder, material: u32, centre: Point, scale: f64) {
    let start = b.mark();
    let tube = Tube { along: 260, around: 22, radius: 0.46 * scale };
    b.tube(material, tube, |turns| {
        let (wave_sin, wave_cos) = sin_cos(3.0 * turns);
        let (sin, cos) = sin_cos(2.0 * turns + 0.75);
        let r = 2.0 + 1.1 * wave_cos;
        let here = [r * cos, r * sin, 1.1 * wave_sin];
        let outwards = [here[0] - 2.0 * cos, here[1] - 2.0 * sin, here[2]];
        [std::array::from_fn(|k| centre[k] + scale * here[k]), outwards]
    });
    b.smooth(start);
}

fn vase(b: &mut Builder, material: u32, base: Point) {
    // Radius and height of its outside from lip to foot, then straight lines between.
    let shape = [
        [0.20, 1.05],
        [0.16, 0.98],
        [0.115, 0.88],
        [0.13, 0.76],
        [0.21, 0.64],
        [0.29, 0.50],
        [0.31, 0.38],
        [0.27, 0.24],
        [0.19, 0.12],
        [0.14, 0.04],
        [0.17, 0.0],
    ];
    // Catmull and Rom's curve through the points, so that the wall is smooth.
    let at = |i: isize| shape[i.clamp(0, shape.len() as isize - 1) as usize];
    let mut profile = Vec::new();
    for i in 0..shape.len() as isize - 1 {
        for step in 0..4 {
            let t = f64::from(step) / 4.0;
            profile.push(std::array::from_fn(|k| {
                let [p, q, r, s] = [at(i - 1)[k], at(i)[k], at(i + 1)[k], at(i + 2)[k]];
                let bend = 2.0 * p - 5.0 * q + 4.0 * r - s + t * (3.0 * (q - r) + s - p);
                q + 0.5 * t * (r - p + t * bend)
            }));
        }
    }
    profile.push(shape[shape.len() - 1]);
    let start = b.mark();
    b.turned(material, base, &profile, 48);
    b.smooth(start);
    // The neck's inside, closed below, and the lip, sharp on both sides.
    let inside = [[0.0, 0.75], [0.09, 0.80], [0.10, 0.88], [0.17, 1.03]];
    for part in [&inside[..], &[[0.17, 1.03], [0.20, 1.05]]] {
        let start = b.mark();
        b.turned(material, base, part, 48);
        b.smooth(start);
    }
}

/// Ten balls in three layers.
fn pyramid(b: &mut Builder, [x, y, z]: Point) {
    let colours = [
        [0.85, 0.60, 0.12],
        [0.12, 0.35, 0.55],
        [0.70, 0.16, 0.10],
        [0.80, 0.78, 0.72],
        [0.20, 0.45, 0.28],
    ];
    let paints: Vec<u32> = colours
        .iter()
        .enumerate()
        .map(|(i, &colour)| {
            b.add_material(Material::new(format!("ball {i}"), colour).with_mirror([0.05; 3]))
        })
        .collect();
    let r = 0.19;
    // Unit steps within a layer, and up to the next one, of balls that touch.
    let (row, third) = (3f64.sqrt(), 1.0 / 3f64.sqrt());
    let up = 2.0 * (2.0f64 / 3.0).sqrt();
    let mut number = 0;
    for layer in 0..3u32 {
        let side = 3 - layer;
        let middle = f64::from(side - 1);
        for i in 0..side {
            for j in 0..side - i {
                let across = 2.0 * f64::from(j) + f64::from(i) - middle;
                let deep = row * f64::from(i) - middle * third;
                let centre = [x + r * across, y + r + r * up * f64::from(layer), z - r * deep];
                b.round_sphere(paints[number % paints.len()], centre, r, 16);
                number += 1;
            }
        }
    }
}

/// A block of green glass on its foot, with a little air between, so that no two faces coincide.
fn glass_block(b: &mut Builder, [x, y, z]: Point) {
    let green = Material::new("green glass", [0.0; 3]).with_dielectric(1.52, [0.80, 0.93, 0.86]);
    let green = b.add_material(green);
    let block = Block { lo: [x - 0.45, y + 0.002, z - 0.2], hi: [x + 0.45, y + 1.15, z + 0.2] };
    b.block(green, green, block, true);
    let ball = b.material("sunflower", [0.85, 0.50, 0.04]);
    b.round_sphere(ball, [x + 0.1, y + 0.16, z - 0.42], 0.16, 14);
}

/// A round basin of stone with water in it.
fn basin(b: &mut Builder, base: Point) {
    const AROUND: u32 = 72;
    let stone = b.material("stone", [0.46, 0.44, 0.41]);
    let bed = b.textured("bed", paint::tiles());
    let water = Material::new("water", [0.0; 3]).with_dielectric(1.33, [0.93, 0.98, 0.99]);
    let water = b.add_material(water);
    let (inner, outer, rim, floor) = (1.0, 1.14, 0.55, 0.08);
    let start = b.mark();
    b.turned(bed, base, &[[0.0, floor], [inner, floor]], AROUND);
    b.give_texcoords(start, |[x, _, z]| [0.5 * x, -0.5 * z]);
    // Walls and rim one by one: sharp where they meet, smooth around.
    for ends in
        [[[inner, floor], [inner, rim]], [[inner, rim], [outer, rim]], [[outer, rim], [outer, 0.0]]]
    {
        let start = b.mark();
        b.turned(stone, base, &ends, AROUND);
        b.smooth(start);
    }
    // The water's surface goes a little into the wall, so that there is no gap at its edge. Rings
    // run outwards from where a drop fell.
    let ripple = |radius: f64| {
        let fade = 1.0 - 0.8 * radius;
        0.43 + 0.011 * fade * sin_cos(4.5 * radius).1
    };
    let rings = 36;
    let profile: Vec<[f64; 2]> = (0..=rings)
        .map(|i| (inner + 0.04) * f64::from(i) / f64::from(rings))
        .map(|radius| [radius, ripple(radius)])
        .collect();
    let start = b.mark();
    b.turned(water, base, &profile, AROUND);
    b.smooth(start);
    let pebble = b.material("pebble", [0.62, 0.33, 0.24]);
    for [x, z, radius] in [[-0.35, 0.28, 0.10], [0.30, 0.42, 0.07], [0.12, -0.3, 0.13]] {
        let centre = [base[0] + x, floor + 0.7 * radius, base[2] + z];
        b.round_sphere(pebble, centre, radius, 10);
    }
}

/// Fluted columns along both sides.
fn columns(b: &mut Builder) {
    const FLUTES: u32 = 16;
    let marble = b.material("marble", [0.78, 0.77, 0.74]);
    for z in [-3.9, -0.3, 3.3] {
        for x in [-5.3, 5.3] {
            let square = |b: &mut Builder, half: f64, low: f64, high: f64| {
                let block = Block { lo: [x - half, low, z - half], hi: [x + half, high, z + half] };
                b.block(marble, marble, block, true);
            };
            square(b, 0.34, 0.0, 0.18);
            square(b, 0.34, HEIGHT - 0.2, HEIGHT - 0.001);
            let around = 6 * FLUTES;
            let start = b.mark();
            let rows: Vec<Vec<u32>> = (0..=8u32)
                .rev()
                .map(|step| {
                    let part = f64::from(step) / 8.0;
                    let y = 0.18 + part * (HEIGHT - 0.38);
                    // Narrower at the top, a little swollen below the middle.
                    let thick = 0.27 - 0.05 * part * part;
                    (0..around)
                        .map(|i| {
                            let turns = f64::from(i) / f64::from(around);
                            let (sin, cos) = sin_cos(turns);
                            let flute = 0.5 + 0.5 * sin_cos(f64::from(FLUTES) * turns).1;
                            let radius = thick - 0.022 * flute * flute;
                            b.vertex([x + radius * cos, y, z + radius * sin])
                        })
                        .collect()
                })
                .collect();
            for pair in rows.windows(2) {
                b.band(marble, &pair[0], &pair[1]);
            }
            b.smooth(start);
        }
    }
}
