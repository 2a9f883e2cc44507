//! Light of environment maps: furnaces, a small sun against closed forms, what is seen of a map, and by which light.

use crate::common::{World, along_z, ball, dark, downwards, mean, near, shoot};
use splitplane_render::{EnvironmentMap, Gather, LightTransport, Material, RenderSettings, Size};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

fn map(width: u32, height: u32, texel: impl Fn(u32, u32) -> [f32; 3]) -> EnvironmentMap {
    let texels = (0..width * height).map(|at| texel(at % width, at / width));
    EnvironmentMap::new(width, height, texels.collect()).unwrap()
}

fn even(radiance: [f32; 3]) -> EnvironmentMap {
    map(8, 4, |_, _| radiance)
}

/// A dim sky with a small sun, one of 6,000 parts of all directions, that brings most of the light.
fn sunny() -> EnvironmentMap {
    map(128, 64, |column, row| match (column, row) {
        (70, 20) => [2e4, 1e4, 5e3],
        (_, row) if row < 32 => [0.5, 0.6, 0.7],
        _ => [0.1; 3],
    })
}

fn ways() -> [(&'static str, RenderSettings); 4] {
    let settings = RenderSettings { samples: 16, passes: 2, depth: 32, ..dark() };
    let photons = RenderSettings { light: LightTransport::Photons, photons: 60_000, ..settings };
    [
        ("direct", RenderSettings { depth: 16, ..settings }),
        ("paths", RenderSettings { light: LightTransport::Paths, ..settings }),
        ("photons", photons),
        ("final", RenderSettings { gather: Gather::Final, ..photons }),
    ]
}

/// A ball that scatters the part rho of what comes from an even environment looks like rho of it; a white one cannot be seen.
#[test]
fn furnaces() {
    let size = Size::new(16, 16).unwrap();
    for rho in [1.0, 0.5] {
        let mut world = World {
            materials: vec![Material::new("ball", [rho; 3])],
            environment: Some(Arc::new(even([0.5, 1.0, 2.0]))),
            ..World::default()
        };
        ball(&mut world, 0, [0.0; 3], 1.0, false);
        for (name, settings) in ways() {
            // It fills the picture.
            let shot = shoot(&world, along_z([0.0, 0.0, 4.0], size, 0.15), size, &settings);
            for (got, want) in mean(&shot).into_iter().zip([0.5, 1.0, 2.0]) {
                let want = want * f64::from(rho);
                assert!((got / want - 1.0).abs() < 0.03, "{name} {rho}: {got} {want}");
            }
            // And here it does not: no pixel is far from the others.
            if rho == 1.0 && name == "paths" {
                let shot = shoot(&world, along_z([0.0, 0.0, 4.0], size, 0.5), size, &settings);
                for pixel in shot.renderer.radiance() {
                    near(pixel[1], 1.0, 0.5);
                }
            }
        }
    }
}

/// Light through glass and off a mirror: in even surroundings all of it looks like these.
#[test]
fn mirrors_and_glass_in_a_furnace() {
    let size = Size::new(10, 10).unwrap();
    for material in [
        Material::new("mirror", [0.0; 3]).with_mirror([1.0; 3]),
        Material::new("glass", [0.0; 3]).with_dielectric(1.5, [1.0; 3]),
        Material::new("steel", [0.0; 3]).with_mirror([1.0; 3]).with_roughness(0.05),
    ] {
        let mut world = World {
            materials: vec![material],
            environment: Some(Arc::new(even([1.0; 3]))),
            ..World::default()
        };
        ball(&mut world, 0, [0.0; 3], 1.0, false);
        for (name, settings) in ways() {
            let settings = RenderSettings { minimum_weight: 0.0, ..settings };
            let shot = shoot(&world, along_z([0.0, 0.0, 4.0], size, 0.15), size, &settings);
            let got = mean(&shot)[0];
            assert!((got - 1.0).abs() < 0.01, "{name} {:?}: {got}", world.materials[0].name);
        }
    }
}

/// The irradiance of a floor: of a row of texels it is the sum of radiance times a closed form.
fn on_floor(map: &EnvironmentMap, texel: impl Fn(u32, u32) -> f64) -> f64 {
    let squared = |row: u32| (PI * f64::from(row) / f64::from(map.height())).sin().powi(2);
    let strip = |row: u32| (squared(row + 1) - squared(row)) / 2.0 * TAU / f64::from(map.width());
    let rows = 0..map.height() / 2;
    rows.map(|row| strip(row) * (0..map.width()).map(|column| texel(column, row)).sum::<f64>())
        .sum()
}

/// Most light of a floor comes from a sun that even samples seldom meet.
#[test]
fn a_floor_under_a_small_sun() {
    let size = Size::new(8, 8).unwrap();
    let sky = sunny();
    let want = on_floor(&sky, |column, row| if (column, row) == (70, 20) { 2e4 } else { 0.5 });
    let mut world = World {
        materials: vec![Material::new("floor", [0.8; 3])],
        environment: Some(Arc::new(sky)),
        ..World::default()
    };
    world.floor(0, 0.0, 3.0);
    for (name, settings) in ways() {
        let shot = shoot(&world, downwards([0.0, 1.0, 0.0], size, 0.2), size, &settings);
        let got = mean(&shot)[0] / (0.8 / PI * want);
        // 2,048 samples in all.
        assert!((got - 1.0).abs() < 0.03, "{name}: {got}");
        // The noise of pixels, each of 32 samples: by even samples it would be ten times the mean.
        let pixels = shot.renderer.radiance();
        let mean = mean(&shot)[0];
        let squares: f64 = pixels.iter().map(|pixel| (f64::from(pixel[0]) - mean).powi(2)).sum();
        let noise = (squares / pixels.len() as f64).sqrt() / mean;
        assert!(noise < 0.2, "{name}: {noise}");
    }
}

/// A wall between floor and sun leaves the light of the sky, and what the wall sends back.
#[test]
fn walls_cast_shadows() {
    let size = Size::new(8, 8).unwrap();
    let sky = sunny();
    let sun = PI * 20.5 / 64.0;
    let across = TAU * (70.5 / 128.0 - 0.5);
    let towards = [sun.sin() * across.sin(), sun.cos(), -sun.sin() * across.cos()];
    let mut world = World {
        materials: vec![Material::new("floor", [0.8; 3]), Material::new("black", [0.0; 3])],
        environment: Some(Arc::new(sky)),
        ..World::default()
    };
    world.floor(0, 0.0, 3.0);
    // A small black square on the way to the sun.
    let [x, y, z] = towards.map(|part| (part * 2.0) as f32);
    let h = 0.25;
    let square = [[x - h, y, z + h], [x + h, y, z + h], [x + h, y, z - h], [x - h, y, z - h]];
    let lit = |world: &World, settings: &RenderSettings| {
        mean(&shoot(world, downwards([0.0, 0.5, 0.0], size, 0.05), size, settings))[0]
    };
    for (name, settings) in ways() {
        let open = lit(&world, &settings);
        let mut walled = world.clone();
        walled.quad(1, square);
        let shadow = lit(&walled, &settings);
        assert!(shadow < 0.35 * open && shadow > 0.05 * open, "{name}: {shadow} {open}");
    }
}

/// What is behind everything is the map, turned, and as strong as was said; a mirror shows what is behind the eye.
#[test]
fn maps_are_seen_and_mirrored() {
    let size = Size::new(2, 1).unwrap();
    // Eight columns, the middle between 4 and 5.
    let columns = || map(8, 2, |column, row| [column as f32 + 1.0, row as f32, 0.0]);
    let [_, (_, paths), ..] = ways();
    let (direct, camera) = (RenderSettings::default(), along_z([0.0; 3], size, 0.1));
    let seen = |world: &World| {
        [direct, paths].map(|settings| {
            let settings = RenderSettings { samples: 1, passes: 1, ..settings };
            let shot = shoot(world, camera, size, &settings);
            [shot.at(0, 0)[0], shot.at(1, 0)[0]]
        })
    };
    let mut world = World { materials: vec![Material::clay()], ..World::default() };
    // Something that is there, and not in view.
    world.floor(0, -9.0, 0.1);
    for (degrees, strength, want) in [
        (0.0, 1.0, [4.0, 5.0]),
        (90.0, 1.0, [6.0, 7.0]),
        (-90.0, 1.0, [2.0, 3.0]),
        (180.0, 0.5, [4.0, 0.5]),
        (405.0, 2.0, [10.0, 12.0]),
    ] {
        let own = columns().with_rotation(degrees).unwrap().with_strength(strength).unwrap();
        world.environment = Some(Arc::new(own));
        assert_eq!(seen(&world), [want; 2], "{degrees} {strength}");
    }
    // A mirror across the view shows what is behind, left and right exchanged: columns 8 and 1.
    world.environment = Some(Arc::new(columns()));
    world.materials.push(Material::new("mirror", [0.0; 3]).with_mirror([1.0; 3]));
    world.quad(1, [[-5.0, -5.0, -1.0], [5.0, -5.0, -1.0], [5.0, 5.0, -1.0], [-5.0, 5.0, -1.0]]);
    assert_eq!(seen(&world), [[1.0, 8.0]; 2]);
}

/// The plan samples a map where it shines, and direct light as often as it samples surfaces that shine.
#[test]
fn maps_are_sampled_where_they_shine() {
    let size = Size::new(2, 2).unwrap();
    let mut world = World { materials: vec![Material::clay()], ..World::default() };
    world.floor(0, 0.0, 1.0);
    let samples = |world: &World, light, area_samples| {
        let settings = RenderSettings { light, area_samples, ..dark() };
        let shot = shoot(world, downwards([0.0, 0.5, 0.0], size, 0.1), size, &settings);
        (shot.stats.plan.sky_samples(), shot.stats.shadow_rays > 0, mean(&shot)[0] > 0.0)
    };
    assert_eq!(samples(&world, LightTransport::Direct, 3), (0, false, false));
    world.environment = Some(Arc::new(even([1.0; 3])));
    assert_eq!(samples(&world, LightTransport::Direct, 3), (3, true, true));
    assert_eq!(samples(&world, LightTransport::Direct, 0), (0, false, false));
    assert_eq!(samples(&world, LightTransport::Paths, 0), (1, true, true));
    world.environment = Some(Arc::new(even([0.0; 3])));
    assert_eq!(samples(&world, LightTransport::Direct, 3), (0, false, false));
    assert_eq!(samples(&world, LightTransport::Paths, 3), (0, false, false));
}
