//! A scene that moves: a merry-go-round with riders of glass and metal, gears, bouncing balls and a
//! curtain in the wind. The same triangles in every frame; sizes in metres.

use super::BuiltinError;
use super::builder::{Block, Builder, Mark, Point};
use crate::angle::sin_cos;
use crate::{Material, Scene, normals};
use glam::DVec3;
use std::ops::Range;

/// Frames of a round, after which it begins again without a seam, and how long one is.
pub(crate) const FRAMES: usize = 120;
#[cfg(feature = "animation")]
pub(crate) const SECONDS_PER_FRAME: f64 = 1.0 / 24.0;

/// Fewest and most triangles.
pub(super) const LEAST: u64 = 4_000;
pub(super) const MOST: u64 = 10_000_000;
const DEFAULT: u64 = 40_000;

const RIDERS: u32 = 8;
/// From the axis to the riders' poles, and how high the riders hang when they are not lifted.
const RIDE: f64 = 2.45;
const SADDLE: f64 = 1.45;
/// Corners of the curtain's grid for a detail of 1: across and up.
const CURTAIN: [f64; 2] = [11.0, 6.0];

/// How the scene of frame 0 becomes that of any other.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    /// Every vertex before it is moved to its place.
    rest: Vec<[f32; 3]>,
    parts: Vec<(Range<usize>, Move)>,
    /// The first triangle of the curtain, whose normals change with its shape.
    curtain: usize,
    sums: Vec<DVec3>,
}

/// How vertices move. Angles are in turns, and whole numbers of them make the seam vanish.
#[derive(Clone, Copy, Debug)]
enum Move {
    /// Around a line through a point, along the y or z axis.
    Turn { centre: Point, axis: usize, rounds: f64 },
    /// With the merry-go-round at a place of its rim, lifted and lowered.
    Ride { place: f64 },
    /// Up and down on the ground.
    Bounce { height: f64, phase: f64 },
    /// As cloth in the wind.
    Wave,
}

pub(super) fn open(size: Option<&str>) -> Result<(Scene, Motion), BuiltinError> {
    let target = super::size("carousel", size, DEFAULT, [LEAST, MOST])?;
    // Only spheres and the curtain get finer; what is left of a coarse one does not change.
    let variable = |detail: f64| -> u64 {
        let sphere = |rings: u32| u64::from(4 * rings * (rings - 1));
        let spheres =
            u64::from(RIDERS) * sphere(rider_rings(detail)) + 4 * sphere(ball_rings(detail));
        let [across, up] = curtain_grid(detail);
        spheres + 2 * u64::from(across) * u64::from(up)
    };
    let fixed = make(1.0).0.indices.len() as u64 - variable(1.0);
    let (mut coarse, mut fine) = (1.0, 400.0);
    for _ in 0..48 {
        let middle = 0.5 * (coarse + fine);
        if fixed + variable(middle) > target {
            fine = middle;
        } else {
            coarse = middle;
        }
    }
    Ok(make(coarse))
}

fn rider_rings(detail: f64) -> u32 {
    (2.3 * detail).round() as u32 + 2
}

fn ball_rings(detail: f64) -> u32 {
    (1.6 * detail).round() as u32 + 2
}

fn curtain_grid(detail: f64) -> [u32; 2] {
    CURTAIN.map(|cells| (cells * detail).round() as u32)
}

fn make(detail: f64) -> (Scene, Motion) {
    let mut b = Builder::new("carousel");
    let mut parts = Vec::new();
    ground(&mut b);
    merry_go_round(&mut b, &mut parts);
    riders(&mut b, &mut parts, rider_rings(detail));
    gears(&mut b, &mut parts);
    balls(&mut b, &mut parts, ball_rings(detail));
    // Last, so that its triangles run to the end.
    let curtain = curtain(&mut b, &mut parts, curtain_grid(detail));
    b.look([1.3, 3.0, 12.6], [0.15, 1.95, 0.0], 36.0);
    b.light([-6.5, 9.0, 9.5], [0.0, 1.5, 0.0]);
    let mut scene = b.finish();
    let rest = scene.positions.clone();
    let mut motion = Motion { rest, parts, curtain: curtain.triangle, sums: Vec::new() };
    motion.set(0, &mut scene);
    (scene, motion)
}

impl Motion {
    /// Vertices of the scene.
    #[cfg(feature = "animation")]
    pub(crate) fn vertices(&self) -> usize {
        self.rest.len()
    }

    /// Moves the vertices of the scene to where they are in a frame.
    pub(crate) fn set(&mut self, frame: usize, scene: &mut Scene) {
        let part = (frame % FRAMES) as f64 / FRAMES as f64;
        for (vertices, how) in &self.parts {
            let moved = how.at(part);
            let from = &self.rest[vertices.clone()];
            for (to, &from) in scene.positions[vertices.clone()].iter_mut().zip(from) {
                *to = moved(from.map(f64::from)).map(|x| x as f32);
            }
        }
        normals::smooth(scene, self.curtain, &mut self.sums);
    }
}

impl Move {
    /// Where a point is when a part of the round has passed.
    fn at(self, part: f64) -> impl Fn(Point) -> Point {
        // Everything that does not depend on the point, for any kind of move.
        let (sin, cos) = match self {
            Move::Turn { rounds, .. } => sin_cos(rounds * part),
            Move::Ride { place } => sin_cos(place + part),
            _ => (0.0, 1.0),
        };
        move |point| match self {
            Move::Turn { centre, axis, .. } => {
                // The two axes that are turned, the first towards the second.
                let (i, j) = if axis == 1 { (0, 2) } else { (0, 1) };
                let (x, y) = (point[i] - centre[i], point[j] - centre[j]);
                let mut turned = point;
                turned[i] = centre[i] + x * cos - y * sin;
                turned[j] = centre[j] + x * sin + y * cos;
                turned
            }
            Move::Ride { place } => {
                let lift = 0.34 * sin_cos(2.0 * part + 3.0 * place).0;
                [point[0] + RIDE * cos, point[1] + lift, point[2] + RIDE * sin]
            }
            Move::Bounce { height, phase } => {
                let beat = 4.0 * part + phase;
                let fall = beat - beat.floor();
                [point[0], point[1] + height * 4.0 * fall * (1.0 - fall), point[2]]
            }
            Move::Wave => {
                let [x, y, z] = point;
                // The curtain hangs from above: what is lower swings more.
                let free = 1.0 - y / 6.0;
                let fold = 0.16 * sin_cos(0.62 * x).0;
                let long = 0.26 * sin_cos(0.13 * x - 2.0 * part + 0.05 * y).0;
                let short = 0.08 * sin_cos(0.41 * x + 0.2 * y - 3.0 * part).0;
                [x, y, z + fold + free * (long + short)]
            }
        }
    }
}

fn ground(b: &mut Builder) {
    let ground = b.material("ground", [0.36, 0.38, 0.33]);
    let stone = b.material("stone", [0.55, 0.53, 0.49]);
    let e = 30.0;
    b.quad(ground, [[-e, 0., -e], [-e, 0., e], [e, 0., e], [e, 0., -e]]);
    b.turned(
        stone,
        [0.0; 3],
        &[[0.0, 0.26], [3.7, 0.26], [3.7, 0.13], [4.0, 0.13], [4.0, 0.0]],
        64,
    );
}

/// Adds the vertices since `start` as a part that moves.
fn moving(b: &Builder, parts: &mut Vec<(Range<usize>, Move)>, start: Mark, how: Move) {
    parts.push((start.vertex..b.mark().vertex, how));
}

/// Floor, roof and poles, which turn as one.
fn merry_go_round(b: &mut Builder, parts: &mut Vec<(Range<usize>, Move)>) {
    let wood =
        [b.material("dark wood", [0.30, 0.16, 0.08]), b.material("wood", [0.55, 0.34, 0.17])];
    let roof = [b.material("red", [0.62, 0.06, 0.05]), b.material("cream", [0.80, 0.74, 0.60])];
    let brass = Material::new("brass", [0.32, 0.22, 0.06]).with_mirror([0.55, 0.42, 0.16]);
    let brass = b.add_material(brass);
    let start = b.mark();
    sectors(b, wood, 48, &[[0.0, 0.46], [3.3, 0.46], [3.3, 0.30]]);
    sectors(b, roof, 48, &[[0.0, 4.45], [1.7, 3.72], [3.45, 3.28], [3.45, 3.0]]);
    // The roof seen from below.
    sectors(b, [roof[1], wood[1]], 48, &[[3.43, 3.0], [3.43, 3.24], [0.0, 3.24]]);
    sectors(b, [roof[1], roof[0]], 24, &[[0.55, 3.24], [0.42, 3.0], [0.42, 0.7], [0.55, 0.46]]);
    for rider in 0..RIDERS {
        let (sin, cos) = sin_cos(f64::from(rider) / f64::from(RIDERS));
        let at = [RIDE * cos, 0.0, RIDE * sin];
        b.turned(brass, at, &[[0.035, 3.24], [0.035, 0.46]], 12);
    }
    let how = Move::Turn { centre: [0.0; 3], axis: 1, rounds: 1.0 };
    moving(b, parts, start, how);
    b.round_sphere(brass, [0.0, 4.62, 0.0], 0.24, 16);
}

/// A surface of revolution in sectors of two colours; its profile as for [`Builder::turned`].
fn sectors(b: &mut Builder, colours: [u32; 2], around: u32, profile: &[[f64; 2]]) {
    let point = |turns: f64, [radius, y]: [f64; 2]| -> Point {
        let (sin, cos) = sin_cos(turns);
        [radius * cos, y, radius * sin]
    };
    for i in 0..around {
        let colour = colours[(i / (around / 12) % 2) as usize];
        let [from, to] = [i, i + 1].map(|i| f64::from(i) / f64::from(around));
        for pair in profile.windows(2) {
            let corners = [(from, pair[0]), (to, pair[0]), (to, pair[1]), (from, pair[1])];
            let [a, b1, c, d] = corners.map(|(turns, at)| b.vertex(point(turns, at)));
            if pair[0][0] != 0.0 {
                b.triangle(colour, [a, b1, c]);
            }
            if pair[1][0] != 0.0 {
                b.triangle(colour, [a, c, d]);
            }
        }
    }
}

fn riders(b: &mut Builder, parts: &mut Vec<(Range<usize>, Move)>, rings: u32) {
    let plain = |name: &str, colour: [f32; 3]| Material::new(name, colour).with_mirror([0.05; 3]);
    let kinds = [
        Material::new("glass", [0.0; 3]).with_dielectric(1.5, [0.97, 0.99, 0.98]),
        plain("blue", [0.08, 0.20, 0.55]),
        Material::new("mirror", [0.0; 3]).with_mirror([0.93, 0.93, 0.94]),
        plain("orange", [0.85, 0.36, 0.06]),
        Material::new("amber", [0.0; 3]).with_dielectric(1.55, [0.96, 0.72, 0.36]),
        plain("green", [0.10, 0.40, 0.18]),
        Material::new("gold", [0.10, 0.06, 0.01]).with_mirror([0.86, 0.62, 0.24]),
        plain("violet", [0.36, 0.14, 0.45]),
    ];
    for (rider, kind) in (0..RIDERS).zip(kinds) {
        let material = b.add_material(kind);
        let start = b.mark();
        b.round_sphere(material, [0.0, SADDLE, 0.0], 0.44, rings);
        // The glass one comes by in front when the round begins.
        let place = f64::from(rider + 2) / f64::from(RIDERS);
        moving(b, parts, start, Move::Ride { place });
    }
}

/// Two gears of 16 and 8 teeth on a post.
fn gears(b: &mut Builder, parts: &mut Vec<(Range<usize>, Move)>) {
    let iron = b.material("iron", [0.30, 0.31, 0.34]);
    let steel = Material::new("steel", [0.22, 0.22, 0.23]).with_mirror([0.40, 0.40, 0.42]);
    let steel = b.add_material(steel);
    let red = b.material("red lead", [0.55, 0.13, 0.06]);
    let (large, small) = ([4.75, 1.5, 1.6], [4.75, 3.0, 1.6]);
    let post = Block { lo: [4.6, 0.0, 1.05], hi: [4.9, 3.2, 1.35] };
    b.block(iron, iron, post, false);
    let foot = Block { lo: [4.15, 0.0, 0.8], hi: [5.35, 0.12, 2.1] };
    b.block(iron, iron, foot, false);
    let start = b.mark();
    gear(b, red, large, 16, 1.0, 0.0);
    moving(b, parts, start, Move::Turn { centre: large, axis: 2, rounds: 1.0 });
    // A gap of the small one meets a tooth of the large one, which points straight up.
    let start = b.mark();
    gear(b, steel, small, 8, 0.5, 0.5 / 8.0);
    moving(b, parts, start, Move::Turn { centre: small, axis: 2, rounds: -2.0 });
}

/// A gear that faces along z, with a hole in it; a tooth is at a quarter turn plus `shift`.
fn gear(b: &mut Builder, material: u32, centre: Point, teeth: u32, radius: f64, shift: f64) {
    let depth = 0.09;
    // Around a tooth: where its flanks begin and end, in parts of a step, and how far out.
    let outline = [(-0.29, -depth), (-0.14, depth), (0.14, depth), (0.29, -depth)];
    let rim: Vec<(f64, f64)> = (0..teeth)
        .flat_map(|tooth| {
            outline.map(|(part, out)| {
                (0.25 + shift + (f64::from(tooth) + part) / f64::from(teeth), radius + out)
            })
        })
        .collect();
    let hole = 0.3 * radius;
    let half = 0.14;
    let ring = |b: &mut Builder, z: f64, hole: Option<f64>| -> Vec<u32> {
        let at = |&(turns, out): &(f64, f64)| {
            let (sin, cos) = sin_cos(turns);
            let radius = hole.unwrap_or(out);
            [centre[0] + radius * cos, centre[1] + radius * sin, centre[2] + z]
        };
        rim.iter().map(|place| b.vertex(at(place))).collect()
    };
    let front = [ring(b, half, None), ring(b, half, Some(hole))];
    let back = [ring(b, -half, None), ring(b, -half, Some(hole))];
    // Seen from outside, every band runs around its own way.
    b.band(material, &front[0], &front[1]);
    b.band(material, &back[1], &back[0]);
    b.band(material, &back[0], &front[0]);
    b.band(material, &front[1], &back[1]);
}

fn balls(b: &mut Builder, parts: &mut Vec<(Range<usize>, Move)>, rings: u32) {
    let silver = Material::new("silver", [0.05; 3]).with_mirror([0.88, 0.88, 0.90]);
    let kinds = [
        Material::new("rubber red", [0.72, 0.10, 0.08]),
        Material::new("rubber yellow", [0.85, 0.66, 0.10]),
        Material::new("rubber teal", [0.05, 0.42, 0.44]),
        silver,
    ];
    let places = [([-4.9, 2.6], 1.7), ([-4.1, 4.0], 0.9), ([-5.6, 1.0], 2.4), ([3.3, 4.2], 0.55)];
    for (i, (kind, ([x, z], height))) in kinds.into_iter().zip(places).enumerate() {
        let material = b.add_material(kind);
        let radius = 0.32;
        let start = b.mark();
        b.round_sphere(material, [x, radius, z], radius, rings);
        moving(b, parts, start, Move::Bounce { height, phase: 0.15 + 0.29 * i as f64 });
    }
}

/// Where the curtain begins.
fn curtain(b: &mut Builder, parts: &mut Vec<(Range<usize>, Move)>, [across, up]: [u32; 2]) -> Mark {
    let cloth = b.material("cloth", [0.16, 0.13, 0.36]);
    let start = b.mark();
    for row in 0..=up {
        let y = 0.15 + 5.85 * f64::from(row) / f64::from(up);
        for column in 0..=across {
            b.vertex([18.0 * f64::from(column) / f64::from(across) - 9.0, y, -5.2]);
        }
    }
    let at = |row: u32, column: u32| start.vertex as u32 + row * (across + 1) + column;
    for row in 0..up {
        for column in 0..across {
            let (r, c) = (row, column);
            b.join(cloth, [at(r, c), at(r, c + 1), at(r + 1, c + 1), at(r + 1, c)]);
        }
    }
    b.smooth(start);
    moving(b, parts, start, Move::Wave);
    start
}
