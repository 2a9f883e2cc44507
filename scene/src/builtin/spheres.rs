//! A field of spheres of many sizes and colours, resting on the ground.

use super::builder::Builder;
use crate::{Material, Scene};
use splitplane_core::random::unit;

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
    let glass = Material::new("glass", [0.0; 3]).with_dielectric(1.5, [0.97, 0.99, 0.98]);
    let mirror = Material::new("mirror", [0.0; 3]).with_mirror([0.92, 0.92, 0.94]);
    // Among the small ones: metals, and lacquer that mirrors a little.
    let gold = Material::new("gold", [0.10, 0.06, 0.01]).with_mirror([0.85, 0.60, 0.22]);
    let lacquer = Material::new("lacquer", [0.45, 0.03, 0.03]).with_mirror([0.10; 3]);
    let [glass, mirror, gold, lacquer] = [glass, mirror, gold, lacquer].map(|m| b.add_material(m));
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
        let material = match i {
            0 => glass,
            1 => mirror,
            2 => colours[2],
            _ => match unit(SEED, &[i as u64, 4]) {
                x if x < 0.06 => gold,
                x if x < 0.14 => lacquer,
                _ => colours[(unit(SEED, &[i as u64, 3]) * COLOURS.len() as f64) as usize],
            },
        };
        b.round_sphere(material, [x, radius, z], radius, rings);
    }
    b.look([1.5, 3.4, 13.5], [0.0, 1.0, 0.0], 34.0);
    b.light([-12.0, 16.0, 12.0], [0.0, 1.0, 0.0]);
    b.finish()
}

fn cube(x: f64) -> f64 {
    x * x * x
}
