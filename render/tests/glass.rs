//! Refraction against closed forms.

use crate::common::{self, World, along_z, dark, near, shoot};
use splitplane_render::{Material, RenderSettings, Size};

fn settings() -> RenderSettings {
    RenderSettings { depth: 16, minimum_weight: 0.0, area_samples: 0, ..dark() }
}

/// A lamp seen straight through a pane: with all reflections between the two sides, the part that gets
/// through is (1 - R) / (1 + R), R = 0.04 for glass.
#[test]
fn a_pane_lets_through_what_the_series_says() {
    let lamp = Material::new("lamp", [0.0; 3]).with_emission([1.0; 3]);
    let glass = Material::clay().with_dielectric(1.5, [1.0; 3]);
    let mut world = World { materials: vec![lamp, glass], ..World::default() };
    let wall = 50.0;
    world.quad(
        0,
        [[-wall, -wall, -9.0], [wall, -wall, -9.0], [wall, wall, -9.0], [-wall, wall, -9.0]],
    );
    world.block(1, [-40.0, -40.0, -2.0], [40.0, 40.0, -1.0]);
    let size = Size::new(1, 1).unwrap();
    let shot = shoot(&world, along_z([0.0; 3], size, 1e-4), size, &settings());
    near(shot.at(0, 0)[0], 0.96 / 1.04, 1e-5);
}

/// Through a tilted view of a pane the picture is shifted, not turned: the shift is d sin(a - b) /
/// cos(b) for a pane of thickness d.
#[test]
fn a_pane_shifts_what_is_behind_it() {
    let dark_wall = Material::new("wall", [0.0; 3]);
    let lamp = Material::new("lamp", [0.0; 3]).with_emission([1.0; 3]);
    let glass = Material::clay().with_dielectric(1.5, [1.0; 3]);
    // A lamp right of x = 6 on a wall at z = -9.
    for (with_pane, thickness) in [(false, 0.0f64), (true, 3.0)] {
        let materials = vec![dark_wall.clone(), lamp.clone(), glass.clone()];
        let mut world = World { materials, ..World::default() };
        let w = 60.0;
        world.quad(1, [[6.0, -w, -9.0], [w, -w, -9.0], [w, w, -9.0], [6.0, w, -9.0]]);
        if with_pane {
            world.block(2, [-50.0, -50.0, -5.0], [50.0, 50.0, -2.0]);
        }
        let size = Size::new(512, 1).unwrap();
        // The picture is 512 high at distance 1 for every unit of tan: columns are 2 tan / 1 wide.
        let tan = 0.004;
        let mut camera = along_z([0.0; 3], size, tan);
        camera.corner[0] += 0.8;
        let shot = shoot(&world, camera, size, &settings());
        let first = (0..512).find(|&x| shot.at(x, 0)[0] > 0.5).expect("the lamp is seen");
        let tangent = |x: u32| f64::from(camera.corner[0]) + 2.0 * 0.004 * (f64::from(x) + 0.5);
        // Where the ray of tangent `t` meets the wall.
        let meets = |t: f64| {
            let sine = t / (1.0 + t * t).sqrt() / 1.5;
            let inside = sine / (1.0 - sine * sine).sqrt();
            (9.0 - thickness) * t + thickness * inside
        };
        assert!(meets(tangent(first)) >= 6.0 - 1e-3, "{first}");
        assert!(meets(tangent(first - 1)) <= 6.0 + 1e-3, "{first}");
    }
}

/// Seen from inside glass, all beyond the critical angle is a mirror: sin = 1 / 1.5.
#[test]
fn total_internal_reflection_begins_at_the_critical_angle() {
    let glass = Material::clay().with_dielectric(1.5, [1.0; 3]);
    let lamp = Material::new("lamp", [0.0; 3]).with_emission([1.0; 3]);
    let mut world = World { materials: vec![glass, lamp], ..World::default() };
    // The camera is deep in a block whose front is at z = -1; behind it, outside, all shines.
    world.block(0, [-90.0, -90.0, -1.0], [90.0, 90.0, 90.0]);
    let w = 4000.0;
    world.quad(1, [[-w, -w, -2.0], [w, -w, -2.0], [w, w, -2.0], [-w, w, -2.0]]);
    let size = Size::new(256, 1).unwrap();
    let mut camera = along_z([0.0; 3], size, 0.003);
    camera.corner[0] += 0.894;
    let one_bounce = RenderSettings { depth: 1, ..settings() };
    let shot = shoot(&world, camera, size, &one_bounce);
    for x in 0..256 {
        let tangent = f64::from(camera.corner[0]) + 0.006 * (f64::from(x) + 0.5);
        let sine = tangent.abs() / (1.0 + tangent * tangent).sqrt();
        if (sine - 1.0 / 1.5).abs() < 1e-4 {
            continue;
        }
        assert_eq!(shot.at(x, 0)[0] > 0.0, sine < 1.0 / 1.5, "{x}: {sine}");
    }
}

/// A path that splits at every surface outgrows its queue: the frame is made again in smaller slices and
/// comes out the same.
#[test]
fn paths_that_split_more_than_expected_cost_smaller_slices_only() {
    let glass = Material::clay().with_dielectric(1.5, [1.0; 3]);
    let mut world = World { materials: vec![glass], ..World::default() };
    for i in 0..4 {
        let z = -2.0 * i as f32;
        world.block(0, [-3.0, -3.0, z - 1.0], [3.0, 3.0, z]);
    }
    let size = Size::new(16, 16).unwrap();
    let settings = RenderSettings { depth: 6, minimum_weight: 0.0, ..RenderSettings::default() };
    let camera = along_z([0.1, 0.2, 3.0], size, 0.3);
    let whole = shoot(&world, camera, size, &settings);
    let room = splitplane_render::Room { paths: 600, ..splitplane_render::Room::CPU };
    let small = common::try_shoot(&world, camera, size, &settings, room).unwrap();
    assert!(small.stats.plan.slices() > 1, "{}", small.stats.plan.slices());
    assert_eq!(small.renderer.radiance(), whole.renderer.radiance());
    assert_eq!(small.stats.paths, whole.stats.paths);
    let tiny = splitplane_render::Room { paths: 4, ..splitplane_render::Room::CPU };
    let error = common::try_shoot(&world, camera, size, &settings, tiny).err().unwrap();
    assert!(error.to_string().contains("one pixel"), "{error}");
}
