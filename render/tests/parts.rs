//! The parts of a picture are the picture, however many there are.

use crate::common::{World, ball, cornell, cornell_camera, shoot, try_shoot};
use splitplane_render::{
    Environment, Gather, Light, LightTransport, Material, Part, RenderSettings, Room, Size,
};

/// The room with a ball of glass and a lamp without a size.
fn world() -> World {
    let mut world = cornell();
    world.materials.push(Material::clay().with_dielectric(1.5, [1.0; 3]));
    ball(&mut world, 4, [0.5, -0.6, 0.4], 0.35, false);
    world.lights.push(Light::Point {
        position: [0.0, 0.5, 2.0],
        irradiance: [1.0; 3],
        distance: 2.0,
    });
    world
}

fn ways() -> [RenderSettings; 4] {
    let environment = Environment::SKY;
    let all = RenderSettings { samples: 2, depth: 6, environment, ..RenderSettings::default() };
    let (passes, photons) = (2, 3000);
    let photons = RenderSettings { light: LightTransport::Photons, passes, photons, ..all };
    [
        all,
        RenderSettings { light: LightTransport::Paths, passes, ..all },
        photons,
        RenderSettings { gather: Gather::Final, ..photons },
    ]
}

#[test]
fn parts_together_are_the_picture() {
    let (world, size) = (world(), Size::new(23, 11).unwrap());
    let camera = cornell_camera(size);
    for settings in ways() {
        let whole = shoot(&world, camera, size, &settings);
        for count in [1, 2, 3, 7, 300] {
            let (mut made, mut rays) = (0, 0);
            // Of 300 parts of 253 pixels some are empty; a few show it.
            let asked = if count == 300 { 1..8 } else { 1..count + 1 };
            for index in asked {
                let part = Part::new(index, count).unwrap();
                let settings = RenderSettings { part, ..settings };
                // Slices of few pixels, so that a part is several.
                let room = Room { paths: 1000, ..Room::CPU };
                let shot = try_shoot(&world, camera, size, &settings, room).unwrap();
                let pixels = part.share(size.pixels());
                let pixels = pixels.start as usize..pixels.end as usize;
                let (own, all) = (&shot.renderer, &whole.renderer);
                let bits = |light: &[[f32; 4]]| {
                    light.as_flattened().iter().map(|x| x.to_bits()).collect::<Vec<_>>()
                };
                let place = format!("{:?} {part}", settings.light);
                assert_eq!(
                    bits(&own.radiance()[pixels.clone()]),
                    bits(&all.radiance()[pixels.clone()]),
                    "{place}"
                );
                assert_eq!(own.pixels()[pixels.clone()], all.pixels()[pixels.clone()], "{place}");
                let (hits, costs) = (own.first_hits(), own.first_costs());
                assert_eq!(hits[pixels.clone()], all.first_hits()[pixels.clone()], "{place}");
                assert_eq!(costs[pixels.clone()], all.first_costs()[pixels.clone()], "{place}");
                made += pixels.len();
                rays += shot.stats.paths;
            }
            if count < 300 {
                // Nothing is made twice.
                assert_eq!((made as u32, rays), (size.pixels(), whole.stats.paths));
            } else {
                assert!(made < 7);
            }
        }
    }
}
