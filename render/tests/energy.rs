//! Light that comes and goes: furnaces, closed forms, mirrors of mirrors.

use crate::common::{World, along_z, dark, downwards, near, shoot};
use splitplane_render::{Environment, Light, Material, RenderSettings, Size};
use std::f64::consts::PI;

fn furnace() -> RenderSettings {
    RenderSettings {
        environment: Environment::uniform([1.0; 3]),
        ambient: 1.0,
        depth: 16,
        minimum_weight: 0.0,
        ..RenderSettings::default()
    }
}

/// A block that sends back all light cannot be told from its evenly bright surroundings.
fn furnace_with(material: Material, tolerance: f64) {
    let mut world = World { materials: vec![material], ..World::default() };
    world.block(0, [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]);
    let size = Size::new(32, 32).unwrap();
    let shot = shoot(&world, along_z([0.3, 0.6, 4.0], size, 0.5), size, &furnace());
    let covered = shot.renderer.first_hits().iter().filter(|hit| hit.triangle != u32::MAX).count();
    assert!((200..900).contains(&covered), "{covered} pixels show the block");
    for radiance in shot.renderer.radiance() {
        for part in &radiance[..3] {
            near(*part, 1.0, tolerance);
        }
    }
}

#[test]
fn white_furnace_of_a_diffuse_block() {
    furnace_with(Material::new("white", [1.0; 3]), 1e-6);
}

#[test]
fn white_furnace_of_a_mirror() {
    furnace_with(Material::new("black", [0.0; 3]).with_mirror([1.0; 3]), 1e-6);
    furnace_with(Material::new("grey", [0.5; 3]).with_mirror([0.5; 3]), 1e-6);
}

/// What is reflected and what is refracted add up to all there is; what is lost is lost to paths that
/// are longer than 16 bounces.
#[test]
fn white_furnace_of_glass() {
    furnace_with(Material::clay().with_dielectric(1.5, [1.0; 3]), 1e-3);
    furnace_with(Material::clay().with_dielectric(1.0, [1.0; 3]), 1e-6);
}

/// A furnace that is only half as bright at the top tells the upper half of the block from it: the test
/// above can fail.
#[test]
fn an_uneven_furnace_shows_the_block() {
    let mut world = World { materials: vec![Material::new("white", [1.0; 3])], ..World::default() };
    world.block(0, [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]);
    let size = Size::new(16, 16).unwrap();
    let environment = Environment { zenith: [0.5; 3], ..Environment::uniform([1.0; 3]) };
    let settings = RenderSettings { environment, ..furnace() };
    let shot = shoot(&world, along_z([0.0, 0.0, 4.0], size, 0.5), size, &settings);
    // The front faces the horizon: half its light comes from above, on average 1 - 0.5 * 2/(3 pi).
    near(shot.at(8, 8)[0], 1.0 - 0.5 * 2.0 / (3.0 * PI), 0.01);
    assert!((shot.at(8, 0)[0] - 1.0).abs() > 0.01);
}

/// A floor under a point: irradiance times albedo over pi, falling off with the square of the distance
/// and the cosine.
#[test]
fn a_point_light_over_a_floor() {
    let light =
        Light::Point { position: [0.5, 2.0, -0.25], irradiance: [3.0, 2.0, 1.0], distance: 1.5 };
    let mut world = World {
        materials: vec![Material::new("grey", [0.5, 0.25, 0.75])],
        lights: vec![light],
        ..World::default()
    };
    world.floor(0, 0.0, 100.0);
    let size = Size::new(24, 16).unwrap();
    let (eye, tan) = ([0.0, 3.0, 0.0], 0.8);
    let shot = shoot(&world, downwards(eye, size, tan), size, &dark());
    for y in 0..16 {
        for x in 0..24 {
            let step = 2.0 * f64::from(tan) / 16.0 * 3.0;
            let px = (f64::from(x) + 0.5 - 12.0) * step;
            let pz = (f64::from(y) + 0.5 - 8.0) * step;
            let squared = (0.5 - px).powi(2) + 4.0 + (-0.25 - pz).powi(2);
            let cosine = 2.0 / squared.sqrt();
            let share = 1.5f64.powi(2) / squared * cosine / PI;
            for (channel, (albedo, power)) in
                [(0.5, 3.0), (0.25, 2.0), (0.75, 1.0)].into_iter().enumerate()
            {
                near(shot.at(x, y)[channel], albedo * power * share, 5e-5);
            }
        }
    }
}

#[test]
fn the_sun_on_a_floor_and_a_light_below_it() {
    let sun = Light::Directional { towards: [3.0, 4.0, 0.0], irradiance: [2.0; 3] };
    let below = Light::Directional { towards: [0.0, -1.0, 0.0], irradiance: [9.0; 3] };
    let mut world = World {
        materials: vec![Material::new("white", [1.0; 3])],
        lights: vec![below, sun],
        ..World::default()
    };
    world.floor(0, 0.0, 10.0);
    let size = Size::new(4, 4).unwrap();
    let shot = shoot(&world, downwards([0.0, 1.0, 0.0], size, 0.5), size, &dark());
    near(shot.at(1, 2)[0], 2.0 * 0.8 / PI, 1e-6);
    // The light below is not worth a ray.
    assert_eq!((shot.stats.paths, shot.stats.shadow_rays), (16, 16));
}

/// A square that shines, straight above a point of the floor, sends it the irradiance `4 L k (atan k)
/// sqrt`: the form factor of a parallel rectangle over its corner, four times (Howell, configuration
/// B-3).
#[test]
fn an_area_light_gives_its_form_factor() {
    let (half, height, radiance) = (0.5f64, 1.5f64, 4.0f64);
    let mut world = World {
        materials: vec![
            Material::new("white", [1.0; 3]),
            Material::new("lamp", [0.0; 3]).with_emission([radiance as f32; 3]),
        ],
        ..World::default()
    };
    world.floor(0, 0.0, 10.0);
    let (h, y) = (half as f32, height as f32);
    world.quad(1, [[-h, y, -h], [h, y, -h], [h, y, h], [-h, y, h]]);
    let size = Size::new(1, 1).unwrap();
    let settings = RenderSettings { samples: 64, area_samples: 8, ..dark() };
    // The camera stands below the lamp and sees only the point under it.
    let shot = shoot(&world, downwards([0.0, 1.0, 0.0], size, 1e-3), size, &settings);
    let k = half / height;
    let root = (1.0 + k * k).sqrt();
    let form_factor = 4.0 * (2.0 / (2.0 * PI)) * (k / root) * (k / root).atan();
    near(shot.at(0, 0)[0], radiance * form_factor, 0.02);
    assert_eq!(shot.stats.shadow_rays, 64 * 8);
    // Equal seeds give equal pictures, others other ones.
    let again = shoot(&world, downwards([0.0, 1.0, 0.0], size, 1e-3), size, &settings);
    assert_eq!(shot.at(0, 0), again.at(0, 0));
    let other = RenderSettings { seed: 2, ..settings };
    let other = shoot(&world, downwards([0.0, 1.0, 0.0], size, 1e-3), size, &other);
    assert_ne!(shot.at(0, 0), other.at(0, 0));
    near(other.at(0, 0)[0], radiance * form_factor, 0.02);
}

/// Two parallel mirrors, the lamp behind the camera: seen in the first mirror, then in the second, and
/// so on, every time a reflectance dimmer.
#[test]
fn a_mirror_of_a_mirror() {
    let lamp = Material::new("lamp", [0.0; 3]).with_emission([1.0; 3]);
    let mirror = Material::new("mirror", [0.0; 3]).with_mirror([0.8, 0.5, 0.25]);
    let mut world = World { materials: vec![lamp, mirror], ..World::default() };
    // A corridor along x: floor and ceiling mirror, a lamp at its end.
    world.floor(1, 0.0, 40.0);
    world.quad(1, [[-40.0, 1.0, -40.0], [40.0, 1.0, -40.0], [40.0, 1.0, 40.0], [-40.0, 1.0, 40.0]]);
    world.quad(
        0,
        [[-40.0, 0.0, -20.0], [40.0, 0.0, -20.0], [40.0, 1.0, -20.0], [-40.0, 1.0, -20.0]],
    );
    let size = Size::new(1, 64).unwrap();
    let settings = RenderSettings { depth: 16, minimum_weight: 0.0, area_samples: 0, ..dark() };
    let shot = shoot(&world, along_z([0.0, 0.5, 0.0], size, 0.35), size, &settings);
    for y in 0..64 {
        // Unfolded, the ray goes straight on and passes a mirror at every whole height.
        let slope = 0.35 * (1.0 - 2.0 * (f64::from(y) + 0.5) / 64.0);
        let height = 0.5 + 20.0 * slope;
        if (height - height.round()).abs() < 1e-3 {
            continue;
        }
        let bounces = height.floor().abs() as i32;
        assert!(bounces <= 8);
        for (channel, reflectance) in [0.8f64, 0.5, 0.25].into_iter().enumerate() {
            near(shot.at(0, y)[channel], reflectance.powi(bounces), 1e-5);
        }
    }
}

/// Depth and least weight end paths where they say.
#[test]
fn paths_end_at_depth_and_weight() {
    let mirror = Material::new("mirror", [0.0; 3]).with_mirror([0.5; 3]);
    let mut world = World { materials: vec![mirror], ..World::default() };
    world.floor(0, 0.0, 1e4);
    let h = 1e4;
    world.quad(0, [[-h, 1.0, -h], [h, 1.0, -h], [h, 1.0, h], [-h, 1.0, h]]);
    let size = Size::new(1, 1).unwrap();
    let camera = downwards([0.0, 0.5, 0.0], size, 1e-3);
    for (depth, minimum_weight, paths) in
        [(0, 0.0, 1), (3, 0.0, 4), (16, 0.0, 17), (16, 0.25, 3), (16, 0.26, 2), (16, 1.0, 1)]
    {
        let settings = RenderSettings { depth, minimum_weight, ..dark() };
        let shot = shoot(&world, camera, size, &settings);
        assert_eq!(shot.stats.paths, paths, "depth {depth}, least weight {minimum_weight}");
    }
}
