//! Pictures do not depend on how the work is cut up.

use crate::common::{World, along_z, shoot, try_shoot};
use splitplane_render::{Light, Material, RenderError, RenderSettings, Room, Size};

fn world() -> World {
    let mut world = World {
        materials: vec![
            Material::new("white", [0.8; 3]),
            Material::new("steel", [0.2; 3]).with_mirror([0.6; 3]),
            Material::clay().with_dielectric(1.4, [0.9; 3]),
            Material::new("lamp", [0.0; 3]).with_emission([3.0, 2.0, 1.0]),
        ],
        lights: vec![Light::Point {
            position: [2.0, 4.0, 3.0],
            irradiance: [2.0; 3],
            distance: 5.0,
        }],
        ..World::default()
    };
    world.floor(0, -1.0, 20.0);
    world.block(1, [-2.0, -1.0, -3.0], [-0.5, 0.8, -1.5]);
    world.block(2, [0.2, -1.0, -2.0], [1.2, 0.4, -1.0]);
    world.quad(3, [[-1.0, 3.0, -3.0], [1.0, 3.0, -3.0], [1.0, 3.0, -1.0], [-1.0, 3.0, -1.0]]);
    world
}

#[test]
fn slices_and_threads_do_not_change_a_picture() {
    let (world, size) = (world(), Size::new(37, 23).unwrap());
    let settings = RenderSettings { samples: 3, area_samples: 2, ..RenderSettings::default() };
    let camera = along_z([0.0, 0.3, 3.0], size, 0.7);
    let whole = shoot(&world, camera, size, &settings);
    assert_eq!(whole.stats.plan.slices(), 1);
    for paths in [6, 100, 1001, 4096] {
        let room = Room { paths, ..Room::CPU };
        // The smallest room may be too small for what a pixel splits into.
        let cut = match try_shoot(&world, camera, size, &settings, room) {
            Ok(cut) => cut,
            Err(error) => {
                assert!(
                    matches!(error, RenderError::PixelTooDeep { .. }) && paths < 100,
                    "{error}"
                );
                continue;
            }
        };
        assert!(cut.stats.plan.slices() > 1);
        assert_eq!(cut.renderer.radiance(), whole.renderer.radiance(), "{paths}");
        assert_eq!(cut.renderer.pixels(), whole.renderer.pixels(), "{paths}");
        assert_eq!(cut.renderer.first_hits(), whole.renderer.first_hits(), "{paths}");
        assert_eq!(cut.renderer.first_costs(), whole.renderer.first_costs(), "{paths}");
        assert_eq!(
            (cut.stats.paths, cut.stats.shadow_rays),
            (whole.stats.paths, whole.stats.shadow_rays)
        );
    }
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let other = pool.install(|| shoot(&world, camera, size, &settings));
        assert_eq!(other.renderer.radiance(), whole.renderer.radiance(), "{threads} threads");
    }
}

/// What is counted of the first ray agrees with what it met.
#[test]
fn first_hits_and_costs_belong_to_the_first_ray() {
    let (world, size) = (world(), Size::new(16, 16).unwrap());
    let camera = along_z([0.0, 0.3, 3.0], size, 0.7);
    let one = shoot(&world, camera, size, &RenderSettings::default());
    let four = shoot(&world, camera, size, &RenderSettings { samples: 4, ..Default::default() });
    assert_eq!(one.renderer.first_hits(), four.renderer.first_hits());
    assert_eq!(one.renderer.first_costs(), four.renderer.first_costs());
    let hits = one.renderer.first_hits().iter().zip(one.renderer.first_costs());
    for (hit, cost) in hits {
        let length: f32 = hit.normal.iter().map(|part| part * part).sum();
        if hit.triangle == u32::MAX {
            assert_eq!((length, hit.depth), (0.0, f32::INFINITY));
        } else {
            assert!((length - 1.0).abs() < 1e-6 && hit.depth > 0.0);
            assert!(cost.nodes > 0 && cost.triangles > 0);
        }
    }
}
