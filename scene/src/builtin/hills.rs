//! Hills with a lake, trees and rocks: what several scenes of many objects stand on.

use super::builder::{Builder, Point};
use super::paint::noise;
use crate::angle::sin_cos;
use crate::instanced::{Geometry, InstancedScene, Placed, Pose};
use splitplane_core::random::unit;

const SEED: u64 = 53;
/// Height of the water.
pub(super) const WATER: f64 = 0.0;
/// Cells of the ground along a side.
const CELLS: u32 = 160;

/// The ground: its height at a place, for a square of this side in metres, around the origin.
#[derive(Clone, Copy)]
pub(super) struct Hills {
    pub(super) side: f64,
}

impl Hills {
    /// Rolling hills, lower in the middle, where the lake is.
    pub(super) fn height(&self, x: f64, z: f64) -> f64 {
        let away = ((x * x + z * z).sqrt() / (0.5 * self.side)).min(1.5);
        let wide = noise(700, x / 46.0 + 31.0, z / 46.0 + 17.0) - 0.5;
        let middle = noise(701, x / 19.0 + 7.0, z / 19.0 + 3.0) - 0.5;
        let small = noise(702, x / 5.0, z / 5.0) - 0.5;
        let rise = 1.0 - 1.0 / (1.0 + 6.0 * away * away * away);
        -2.2 + 13.0 * rise + 9.0 * wide + 3.2 * middle + 0.5 * small
    }
}

/// A scene under construction: geometries one after the other, and instances of them.
pub(super) struct Objects {
    pub(super) builder: Builder,
    geometries: Vec<Geometry>,
    pub(super) instances: Vec<Placed>,
}

impl Objects {
    pub(super) fn new(name: &str) -> Objects {
        let builder = Builder::new(name);
        Objects { builder, geometries: Vec::new(), instances: Vec::new() }
    }

    /// Adds a geometry made by a function.
    pub(super) fn geometry(&mut self, name: &str, make: impl FnOnce(&mut Builder)) -> u32 {
        let start = self.builder.mark();
        make(&mut self.builder);
        let end = self.builder.mark();
        self.geometries.push(Geometry {
            name: name.to_owned(),
            vertices: start.vertex as u32..end.vertex as u32,
            triangles: start.triangle as u32..end.triangle as u32,
            solids: None,
            opacity: None,
        });
        self.geometries.len() as u32 - 1
    }

    /// The scene: a still one has one frame.
    pub(super) fn finish(self, frames: u32, seconds_per_frame: f64) -> InstancedScene {
        let parts = self.builder.finish();
        InstancedScene {
            name: parts.name.clone(),
            parts,
            geometries: self.geometries,
            instances: self.instances,
            frames,
            seconds_per_frame,
            ..InstancedScene::default()
        }
    }
}

/// Ground and water, both in place.
pub(super) fn ground(objects: &mut Objects, hills: Hills) {
    let grass = objects.builder.material("grass", [0.16, 0.23, 0.07]);
    let water = crate::Material::new("water", [0.02, 0.06, 0.07]).with_mirror([0.42, 0.5, 0.54]);
    let water = objects.builder.add_material(water);
    let reach = 0.62 * hills.side;
    let ground = objects.geometry("ground", |b| {
        let start = b.mark();
        let step = 2.0 * reach / f64::from(CELLS);
        let row = |b: &mut Builder, j: u32| -> Vec<u32> {
            let z = f64::from(j) * step - reach;
            let x = |i: u32| f64::from(i) * step - reach;
            (0..=CELLS).map(|i| b.vertex([x(i), hills.height(x(i), z), z])).collect()
        };
        let mut above = row(b, 0);
        for j in 1..=CELLS {
            let below = row(b, j);
            for i in 0..CELLS as usize {
                b.join(grass, [above[i], below[i], below[i + 1], above[i + 1]]);
            }
            above = below;
        }
        b.smooth(start);
    });
    let lake = objects.geometry("lake", |b| {
        let r = reach;
        b.quad(water, [[-r, WATER, -r], [-r, WATER, r], [r, WATER, r], [r, WATER, -r]]);
    });
    let place = Pose::IDENTITY.transform();
    objects.instances.extend([ground, lake].map(|geometry| Placed::new(geometry, place)));
}

/// What grows and lies around.
#[derive(Clone)]
pub(super) struct Kinds {
    pines: Vec<u32>,
    leafy: Vec<u32>,
    rocks: Vec<u32>,
    stone: [u32; 3],
}

impl Kinds {
    pub(super) fn new(objects: &mut Objects) -> Kinds {
        let bark = objects.builder.material("bark", [0.20, 0.13, 0.08]);
        let needles = [[0.045, 0.12, 0.05], [0.06, 0.15, 0.055], [0.035, 0.10, 0.06]];
        let leaves =
            [[0.13, 0.24, 0.05], [0.20, 0.26, 0.05], [0.42, 0.22, 0.04], [0.36, 0.10, 0.03]];
        let stones = [[0.34, 0.33, 0.31], [0.42, 0.38, 0.33], [0.26, 0.27, 0.29]];
        let mut own = |name: &str, colour| objects.builder.material(name, colour);
        let needles = needles.map(|colour| own("needles", colour));
        let leaves = leaves.map(|colour| own("leaves", colour));
        let stone = stones.map(|colour| own("stone", colour));
        let pines = needles.iter().enumerate().map(|(number, needles)| {
            objects.geometry(&format!("pine {number}"), |b| pine(b, number as u64, bark, *needles))
        });
        let pines = pines.collect();
        let leafy = leaves.iter().enumerate().map(|(number, leaves)| {
            objects.geometry(&format!("tree {number}"), |b| tree(b, number as u64, bark, *leaves))
        });
        let leafy = leafy.collect();
        let rocks = (0..2).map(|number| {
            objects.geometry(&format!("rock {number}"), |b| rock(b, number, stone[0]))
        });
        let rocks = rocks.collect();
        Kinds { pines, leafy, rocks, stone }
    }

    /// Scatters so many trees and rocks, none in the water or nearer than this to the eye.
    pub(super) fn scatter(&self, objects: &mut Objects, hills: Hills, count: u64, eye: [f64; 3]) {
        let mut placed = 0;
        let mut attempt = 0;
        while placed < count {
            let number = attempt;
            let draw = |k: u64| unit(SEED, &[number, k]);
            let spread = |k| (draw(k) - 0.5) * 1.16 * hills.side;
            let (x, z) = (spread(0), spread(1));
            let y = hills.height(x, z);
            let near = ((x - eye[0]) * (x - eye[0]) + (z - eye[2]) * (z - eye[2])).sqrt();
            let grove = noise(710, x / 24.0 + 90.0, z / 24.0 + 40.0);
            attempt += 1;
            // After many attempts anything dry will do, so that it ends.
            let picky = attempt < 60 * count;
            if y < WATER + 0.35 && attempt < 200 * count {
                continue;
            }
            if picky && (near < 19.0 || draw(2) > 2.6 * grove - 0.45) {
                continue;
            }
            let rock = draw(3) < 0.10;
            let pine = noise(711, x / 33.0 + 5.0, z / 33.0) + 0.25 * (draw(4) - 0.5) > 0.47;
            let list = if rock {
                &self.rocks
            } else if pine {
                &self.pines
            } else {
                &self.leafy
            };
            let kind = list[((draw(5) * list.len() as f64) as usize).min(list.len() - 1)];
            let size = 0.65 + 0.75 * draw(6);
            let lean = [draw(7) - 0.5, if rock { 0.4 } else { 6.0 }, draw(8) - 0.5];
            let rotate = Pose::rotation(lean, 360.0 * draw(9)).unwrap_or(Pose::IDENTITY.rotate);
            let scale = if rock {
                [0, 1, 2].map(|k| size * (0.6 + 0.8 * draw(10 + k)))
            } else {
                [size, size * (0.85 + 0.35 * draw(10)), size]
            };
            let pose = Pose { translate: [x, y - 0.12, z], rotate, scale };
            let material = rock.then(|| self.stone[(draw(13) * 3.0) as usize % 3]);
            objects.instances.push(Placed { material, ..Placed::new(kind, pose.transform()) });
            placed += 1;
        }
    }
}

/// A trunk and ragged skirts of branches.
fn pine(b: &mut Builder, number: u64, bark: u32, needles: u32) {
    b.turned(bark, [0.0; 3], &[[0.0, 4.0], [0.14, 2.0], [0.24, 0.0], [0.3, -0.5]], 9);
    let skirts = 6 + number;
    for skirt in 0..skirts {
        let part = skirt as f64 / skirts as f64;
        let (top, low) = (7.6 - 5.4 * part, 6.2 - 5.2 * part);
        let radius = 0.55 + 1.5 * part;
        let around = 14u32;
        let apex = b.vertex([0.0, top, 0.0]);
        let rim: Vec<u32> = (0..2 * around)
            .map(|i| {
                let ragged = unit(SEED, &[50 + number, skirt, u64::from(i)]);
                let out = radius * if i % 2 == 0 { 1.0 + 0.25 * ragged } else { 0.62 };
                let (sin, cos) = sin_cos((f64::from(i) + part * 7.0) / f64::from(2 * around));
                b.vertex([out * cos, low - 0.35 * (out - 0.5) + 0.2 * ragged, out * sin])
            })
            .collect();
        let under = b.vertex([0.0, low + 0.3, 0.0]);
        b.band(needles, &vec![apex; rim.len()], &rim);
        b.band(needles, &rim, &vec![under; rim.len()]);
    }
}

/// A trunk and clouds of leaves.
fn tree(b: &mut Builder, number: u64, bark: u32, leaves: u32) {
    b.turned(bark, [0.0; 3], &[[0.0, 3.2], [0.16, 1.8], [0.22, 0.5], [0.36, -0.4]], 9);
    for cloud in 0..7 {
        let draw = |k: u64| unit(SEED, &[80 + number, cloud, k]);
        let part = cloud as f64 / 6.0;
        let (sin, cos) = sin_cos(draw(0) + cloud as f64 * 0.39);
        let out = 1.15 * (1.0 - part) * (0.6 + 0.5 * draw(1));
        let centre = [out * cos, 2.5 + 2.3 * part + 0.5 * draw(2), out * sin];
        lump(b, leaves, centre, 1.3 - 0.45 * part + 0.25 * draw(3), 9, [0.30, 700.0 + draw(4)]);
    }
}

/// A stone, flatter below.
fn rock(b: &mut Builder, number: u64, stone: u32) {
    lump(b, stone, [0.0, 0.25, 0.0], 0.9, 12, [0.42, 800.0 + 13.0 * number as f64]);
}

/// A sphere that noise has pushed in and out, with smooth normals.
fn lump(
    b: &mut Builder,
    material: u32,
    centre: Point,
    radius: f64,
    rings: u32,
    [by, seed]: [f64; 2],
) {
    let start = b.mark();
    b.sphere(material, [0.0; 3], 1.0, rings);
    b.reshape(start, |[x, y, z]| {
        let bump = noise(720, 2.3 * x + 1.1 * z + seed, 2.3 * y - 0.9 * z)
            + 0.5 * noise(721, 5.1 * z + seed, 5.1 * y + 4.0 * x);
        let radius = radius * (1.0 + by * (bump - 0.75));
        [centre[0] + radius * x, centre[1] + 0.86 * radius * y, centre[2] + radius * z]
    });
    b.smooth(start);
}
