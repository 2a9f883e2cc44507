//! Path tracing: closed forms of light that goes from surface to surface, and the same picture always.

use crate::common::{
    Point, World, along_z, ball, cornell, cornell_camera, dark, digest, downwards, mean, near,
    shoot,
};
use splitplane_render::{
    Environment, Light, LightTransport, MAX_BOUNCES, Material, Outputs, RenderSettings, Size,
};
use std::f64::consts::PI;

fn settings() -> RenderSettings {
    RenderSettings {
        light: LightTransport::Paths,
        depth: MAX_BOUNCES,
        samples: 64,
        passes: 2,
        ..dark()
    }
}

fn furnace() -> RenderSettings {
    RenderSettings { environment: Environment::uniform([1.0; 3]), ..settings() }
}

const RHO: Point = [0.5, 0.25, 0.75];

/// Inside of a closed surface that shines with the radiance E and scatters the part rho, the radiance is E / (1 - rho) everywhere.
fn grey_sphere(settings: &RenderSettings) -> [f64; 3] {
    let shining = Material::new("grey", RHO).with_emission([1.0, 2.0, 3.0]);
    let mut world = World { materials: vec![shining], ..World::default() };
    ball(&mut world, 0, [0.1, 0.2, 0.3], 2.0, true);
    let size = Size::new(24, 16).unwrap();
    mean(&shoot(&world, along_z([0.6, 0.1, 0.9], size, 0.7), size, settings))
}

fn is_grey_sphere(mean: [f64; 3]) {
    for (channel, got) in mean.into_iter().enumerate() {
        let want = [1.0, 2.0, 3.0][channel] / (1.0 - f64::from(RHO[channel]));
        near(got as f32, want, 0.005);
    }
}

#[test]
fn the_inside_of_a_shining_grey_sphere() {
    is_grey_sphere(grey_sphere(&settings()));
}

/// With more samples of the light, or none, other ways find the same light.
#[test]
fn the_inside_of_a_shining_grey_sphere_by_other_samples() {
    for area_samples in [0, 3] {
        is_grey_sphere(grey_sphere(&RenderSettings { area_samples, ..settings() }));
    }
}

/// Units do not matter.
#[test]
fn a_grey_sphere_of_any_size() {
    for size in [1e-20f32, 1e15] {
        let shining = Material::new("grey", [0.5; 3]).with_emission([1.0; 3]);
        let mut world = World { materials: vec![shining], ..World::default() };
        ball(&mut world, 0, [0.0; 3], 2.0 * size, true);
        let picture = Size::new(8, 8).unwrap();
        let shot = shoot(&world, along_z([0.0; 3], picture, 0.7), picture, &settings());
        near(mean(&shot)[0] as f32, 2.0, 0.01);
    }
}

/// Two plates, far wider than their distance: the lower shines with E, and they scatter the parts a and b. Below there is
/// E / (1 - a b), above b times that.
#[test]
fn two_parallel_plates() {
    let (a, b) = (0.6, 0.8);
    let mut world = World {
        materials: vec![
            Material::new("lower", [a; 3]).with_emission([1.0; 3]),
            Material::new("upper", [b; 3]),
        ],
        ..World::default()
    };
    world.floor(0, 0.0, 3000.0);
    world.floor(1, 1.0, 3000.0);
    let size = Size::new(12, 12).unwrap();
    let below = f64::from(1.0 / (1.0 - a * b));
    let down = shoot(&world, downwards([0.0, 0.9, 0.0], size, 0.4), size, &settings());
    near(mean(&down)[0] as f32, below, 0.005);
    let up = along_z([0.0, 0.5, 0.0], size, 0.4);
    let up = splitplane_render::Pinhole {
        corner: [-0.4, 1.0, -0.4],
        step_y: [0.0, 0.0, up.step_x[0]],
        ..up
    };
    let above = shoot(&world, up, size, &settings());
    near(mean(&above)[0] as f32, f64::from(b) * below, 0.005);
}

/// A body that sends back all light cannot be told from its evenly bright surroundings, whatever it is of.
#[test]
fn white_furnaces() {
    let black = || Material::new("black", [0.0; 3]);
    let clear = |index| black().with_dielectric(index, [1.0; 3]);
    for material in [
        Material::new("white", [1.0; 3]),
        black().with_mirror([1.0; 3]),
        Material::new("both", [0.5; 3]).with_mirror([0.5; 3]),
        clear(1.5),
        clear(1.0),
    ] {
        let mut world = World { materials: vec![material], ..World::default() };
        world.block(0, [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]);
        let size = Size::new(16, 16).unwrap();
        let shot = shoot(&world, along_z([0.3, 0.6, 4.0], size, 0.3), size, &furnace());
        near(mean(&shot)[0] as f32, 1.0, 0.002);
    }
}

/// Radiance in glass is as much higher as the square of its index: a white ball in a glass ball looks like a white ball, to an eye
/// outside, and so do both in a furnace.
#[test]
fn a_white_ball_in_glass() {
    let glass = Material::new("glass", [0.0; 3]).with_dielectric(1.5, [1.0; 3]);
    let white = Material::new("white", [1.0; 3]);
    let mut world = World { materials: vec![glass, white], ..World::default() };
    ball(&mut world, 0, [0.0; 3], 1.0, false);
    ball(&mut world, 1, [0.0; 3], 0.6, false);
    let size = Size::new(12, 12).unwrap();
    let shot = shoot(&world, along_z([0.0, 0.0, 4.0], size, 0.2), size, &furnace());
    near(mean(&shot)[0] as f32, 1.0, 0.01);
}

/// Lights without a size do what they do in pictures of direct light, where nothing else sends light.
#[test]
fn lights_without_a_size_over_a_floor() {
    let lights = vec![
        Light::Point { position: [0.5, 2.0, -0.25], irradiance: [3.0, 2.0, 1.0], distance: 1.5 },
        Light::Directional { towards: [3.0, 4.0, 0.0], irradiance: [2.0; 3] },
    ];
    let mut world =
        World { materials: vec![Material::new("grey", [0.5; 3])], lights, ..World::default() };
    world.floor(0, 0.0, 100.0);
    let size = Size::new(8, 8).unwrap();
    let camera = downwards([0.0, 3.0, 0.0], size, 0.8);
    let paths =
        shoot(&world, camera, size, &RenderSettings { samples: 1, passes: 1, ..settings() });
    let direct = shoot(&world, camera, size, &dark());
    for y in 0..8 {
        for x in 0..8 {
            near(paths.at(x, y)[0], f64::from(direct.at(x, y)[0]), 1e-5);
        }
    }
}

/// A square that shines, over a floor: the form factor of a parallel rectangle, as for direct light. Its mirror image in a perfect
/// mirror is found by the path alone.
#[test]
fn a_square_over_a_floor_and_its_mirror_image() {
    let mut world = World {
        materials: vec![
            Material::new("white", [0.8; 3]),
            Material::new("lamp", [0.0; 3]).with_emission([5.0; 3]),
        ],
        ..World::default()
    };
    world.floor(0, 0.0, 50.0);
    world.quad(1, [[-1.0, 2.0, -1.0], [1.0, 2.0, -1.0], [1.0, 2.0, 1.0], [-1.0, 2.0, 1.0]]);
    let size = Size::new(4, 4).unwrap();
    let camera = downwards([0.0, 1.0, 0.0], size, 0.01);
    let k: f64 = 1.0 / (1.0 + 4.0f64).sqrt();
    let irradiance = 4.0 * 5.0 * k * (k).atan();
    let wanted = 0.8 / PI * irradiance;
    let shot = shoot(&world, camera, size, &RenderSettings { depth: 1, ..settings() });
    near(mean(&shot)[0] as f32, wanted, 0.005);
    // By chance alone.
    let blind = RenderSettings { depth: 1, area_samples: 0, passes: 64, ..settings() };
    near(mean(&shoot(&world, camera, size, &blind))[0] as f32, wanted, 0.01);
}

#[test]
fn pictures_are_equal_on_any_number_of_threads_and_always() {
    let world = cornell();
    let size = Size::new(32, 24).unwrap();
    let settings = RenderSettings { samples: 4, passes: 3, depth: 8, ..settings() };
    let picture = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let shot = shoot(&world, cornell_camera(size), size, &settings);
            assert!(shot.stats.paths > 10_000, "{:?}", shot.stats);
            digest(shot.renderer.radiance())
        })
    };
    let one = picture(1);
    assert_eq!([picture(2), picture(1), picture(3)], [one; 3]);
    let other = RenderSettings { seed: 2, ..settings };
    let other = shoot(&world, cornell_camera(size), size, &other);
    assert_ne!(digest(other.renderer.radiance()), one);
    insta::assert_snapshot!("cornell_by_paths", format!("{one:016x}"));
}

/// Slices do not matter, and passes add samples: the light of 2 x 8 and of 1 x 16 is that of the same paths, but for rounding.
#[test]
fn passes_continue_one_another() {
    let world = cornell();
    let size = Size::new(16, 12).unwrap();
    let of = |samples, passes| {
        let settings = RenderSettings { samples, passes, depth: 6, ..settings() };
        shoot(&world, cornell_camera(size), size, &settings)
    };
    let (once, twice) = (of(16, 1), of(8, 2));
    for (a, b) in once.renderer.radiance().iter().zip(twice.renderer.radiance()) {
        near(a[0], f64::from(b[0]), 1e-5);
    }
    assert_eq!(once.stats.paths, twice.stats.paths);
    assert_eq!(once.renderer.first_hits(), twice.renderer.first_hits());
    assert_eq!(Outputs::PIXELS, Outputs { first_hits: false, ..Outputs::PIXELS });
}
