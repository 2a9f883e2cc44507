//! Shadows where geometry says they are.

use crate::common::{World, dark, downwards, near, shoot};
use splitplane_render::{Light, Material, RenderSettings, Size};

/// A square between a lamp and the floor: its shadow is the square seen from the lamp. The camera is
/// below the square, so that it sees nothing but the floor.
#[test]
fn the_shadow_of_a_square_is_its_central_projection() {
    for scale in [1.0f32, 1e-12, 1e12] {
        let s = |x: f64| x as f32 * scale;
        let lamp = [0.3, 4.0, -0.2];
        let mut world = World {
            materials: vec![Material::new("white", [1.0; 3])],
            lights: vec![Light::Point {
                position: lamp.map(s),
                irradiance: [1.0; 3],
                distance: s(4.0),
            }],
            ..World::default()
        };
        world.floor(0, 0.0, s(50.0));
        let (half, height) = (0.5, 2.0);
        let (h, y) = (s(half), s(height));
        world.quad(0, [[-h, y, h], [h, y, h], [h, y, -h], [-h, y, -h]]);
        let size = Size::new(64, 64).unwrap();
        let shot = shoot(&world, downwards([0.0, s(1.5), 0.0], size, 1.2), size, &dark());
        let step = 2.0 * 1.2 / 64.0 * 1.5;
        let mut dark_pixels = 0;
        for row in 0..64u32 {
            for column in 0..64u32 {
                let x = (f64::from(column) + 0.5 - 32.0) * step;
                let z = (f64::from(row) + 0.5 - 32.0) * step;
                // Where the ray to the lamp passes the square's height.
                let part = height / lamp[1];
                let cross = [x + (lamp[0] - x) * part, z + (lamp[2] - z) * part];
                let outside = cross.map(|c| c.abs() - half);
                let nearest = outside[0].max(outside[1]);
                if nearest.abs() < 1e-5 {
                    continue;
                }
                let lit = shot.at(column, row)[0] > 0.0;
                assert_eq!(lit, nearest > 0.0, "{scale}: {column},{row}");
                dark_pixels += usize::from(!lit);
            }
        }
        assert!((300..3000).contains(&dark_pixels), "{dark_pixels} in shadow");
    }
}

/// No surface shades itself: a finely divided floor under a low sun is lit everywhere, near the origin
/// and far from it.
#[test]
fn surfaces_do_not_shade_themselves() {
    for offset in [0.0f32, 1e3, 1e6] {
        let mut world = World {
            materials: vec![Material::new("white", [1.0; 3])],
            lights: vec![Light::Directional { towards: [1.0, 0.05, 0.3], irradiance: [1.0; 3] }],
            ..World::default()
        };
        let cells = 32;
        for i in 0..cells {
            for j in 0..cells {
                let at =
                    |i: i32, j: i32| [offset + i as f32 - 16.0, offset, offset + j as f32 - 16.0];
                world.quad(0, [at(i, j + 1), at(i + 1, j + 1), at(i + 1, j), at(i, j)]);
            }
        }
        let size = Size::new(64, 64).unwrap();
        let eye = [offset, offset + 8.0, offset];
        let shot = shoot(&world, downwards(eye, size, 1.0), size, &dark());
        let shaded = shot.renderer.radiance().iter().filter(|radiance| radiance[0] == 0.0).count();
        assert_eq!(shaded, 0, "at {offset}");
    }
}

/// Clear bodies tint the light of a lamp, once at each of their sides, and opaque ones behind them
/// still shade.
#[test]
fn glass_tints_shadows() {
    let tint = [0.9, 0.5, 0.1];
    let glass = Material::clay().with_dielectric(1.5, tint);
    let mut world = World {
        materials: vec![Material::new("white", [1.0; 3]), glass],
        lights: vec![Light::Directional { towards: [0.0, 1.0, 0.0], irradiance: [1.0; 3] }],
        ..World::default()
    };
    world.floor(0, 0.0, 10.0);
    world.block(1, [0.0, 2.0, -1.0], [1.0, 2.5, 1.0]);
    let size = Size::new(32, 32).unwrap();
    let camera = downwards([0.0, 1.5, 0.0], size, 0.5);
    let shot = shoot(&world, camera, size, &dark());
    let clear = 1.0 / std::f64::consts::PI;
    for (channel, part) in tint.into_iter().enumerate() {
        near(shot.at(4, 16)[channel], clear, 1e-5);
        near(shot.at(26, 16)[channel], clear * f64::from(part * part), 1e-5);
    }
    world.quad(0, [[-5.0, 3.0, 5.0], [5.0, 3.0, 5.0], [5.0, 3.0, -5.0], [-5.0, 3.0, -5.0]]);
    let shot = shoot(&world, camera, size, &dark());
    assert!(shot.renderer.radiance().iter().all(|radiance| radiance[..3] == [0.0; 3]));
}

/// A surface's lights are asked only where they can matter.
#[test]
fn no_rays_go_to_lights_behind() {
    let lamp =
        |y: f32| Light::Point { position: [0.0, y, 0.0], irradiance: [1.0; 3], distance: 1.0 };
    let mut world = World {
        materials: vec![Material::new("white", [1.0; 3]), Material::new("black", [0.0; 3])],
        lights: vec![lamp(2.0), lamp(-2.0), lamp(3.0)],
        ..World::default()
    };
    world.floor(0, 0.0, 10.0);
    let size = Size::new(8, 8).unwrap();
    let camera = downwards([0.0, 1.0, 0.0], size, 0.5);
    let shot = shoot(&world, camera, size, &dark());
    assert_eq!(shot.stats.shadow_rays, 64 * 2);
    world.material_of = vec![1; 2];
    let shot = shoot(&world, camera, size, &RenderSettings::default());
    assert_eq!(shot.stats.shadow_rays, 0);
}
