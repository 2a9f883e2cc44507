//! A field of spheres of many sizes and colours, resting on the ground.

use super::builder::Builder;
use crate::random::unit;
use crate::scene::Scene;

const SEED: u64 = 7;
/// Places tried; those that meet a sphere placed before are left out.
const TRIES: u64 = 260;

const COLOURS: [[f32; 3]; 8] = [
    [0.80, 0.19, 0.10],
    [0.90, 0.48, 0.08],
    [0.92, 0.74, 0.18],
    [0.20, 0.48, 0.24],
    [0.08, 0.44, 0.50],
    [0.10, 0.25, 0.60],
    [0.42, 0.16, 0.45],
    [0.82, 0.80, 0.75],
];

pub(super) fn make() -> Scene {
    let mut b = Builder::new("spheres");
    let ground = b.material("ground", [0.42, 0.40, 0.36]);
    let colours: Vec<u32> =
        (0..COLOURS.len()).map(|i| b.material(&format!("colour {i}"), COLOURS[i])).collect();
    let edge = 60.0;
    b.quad(ground, [[-edge, 0., -edge], [-edge, 0., edge], [edge, 0., edge], [edge, 0., -edge]]);
    // Three large ones are where the eye goes; the rest falls into place around them.
    let mut placed: Vec<[f64; 3]> = vec![[0.0, 0.0, 1.9], [-4.1, 1.2, 1.3], [3.6, 1.5, 1.1]];
    for i in 0..TRIES {
        let radius = 0.16 + 0.55 * cube(unit(SEED, &[i, 0]));
        let x = 24.0 * unit(SEED, &[i, 1]) - 12.0;
        let z = 20.0 * unit(SEED, &[i, 2]) - 13.0;
        let room = |other: &[f64; 3]| {
            let (dx, dz) = (x - other[0], z - other[1]);
            // Resting on the same plane, two spheres touch at this distance.
            dx * dx + dz * dz > 4.2 * radius * other[2]
        };
        if placed.iter().all(room) {
            placed.push([x, z, radius]);
        }
    }
    for (i, [x, z, radius]) in placed.into_iter().enumerate() {
        let rings = if i < 3 { 36 } else { 6 + (radius * 14.0) as u32 };
        let colour = match i {
            0 => 0,
            1 => 4,
            2 => 2,
            _ => (unit(SEED, &[i as u64, 3]) * COLOURS.len() as f64) as usize,
        };
        b.sphere(colours[colour], [x, radius, z], radius, rings);
    }
    b.look([1.5, 3.4, 13.5], [0.0, 1.0, 0.0], 34.0, [-12.0, 16.0, 12.0]);
    b.finish()
}

fn cube(x: f64) -> f64 {
    x * x * x
}
