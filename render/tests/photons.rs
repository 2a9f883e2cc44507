//! Photon mapping: closed forms, the pictures of path tracing, energy, and the same picture always.

mod common;

use common::{
    Point, World, along_z, ball, cornell, cornell_camera, dark, downwards, mean, near, shoot,
};
use splitplane_core::tree::digest::Xxh64;
use splitplane_render::cpu::PhotonReport;
use splitplane_render::{
    Environment, Gather, Light, LightTransport, MAX_BOUNCES, Material, RenderError, RenderSettings,
    Room, Size,
};
use std::f64::consts::PI;

fn settings() -> RenderSettings {
    RenderSettings {
        light: LightTransport::Photons,
        depth: MAX_BOUNCES,
        samples: 16,
        passes: 4,
        photons: 100_000,
        ..dark()
    }
}

const GATHERS: [Gather; 2] = [Gather::Maps, Gather::Final];
const RHO: Point = [0.5, 0.25, 0.75];

/// Inside of a closed surface that shines with the radiance E and scatters the part rho, the radiance is E / (1 - rho) everywhere.
#[test]
fn the_inside_of_a_shining_grey_sphere() {
    let shining = Material::new("grey", RHO).with_emission([1.0, 2.0, 3.0]);
    let mut world = World { materials: vec![shining], ..World::default() };
    ball(&mut world, 0, [0.1, 0.2, 0.3], 2.0, true);
    let size = Size::new(24, 16).unwrap();
    for gather in GATHERS {
        let settings = RenderSettings { gather, ..settings() };
        let shot = shoot(&world, along_z([0.6, 0.1, 0.9], size, 0.7), size, &settings);
        println!("{gather:?} {:?} {:?}", mean(&shot), shot.renderer.photons());
        for (channel, got) in mean(&shot).into_iter().enumerate() {
            let want = [1.0, 2.0, 3.0][channel] / (1.0 - f64::from(RHO[channel]));
            near(got as f32, want, 0.005);
        }
    }
}
