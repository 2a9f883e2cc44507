//! Faults of light that are planted, and found by closed forms.

#[path = "../tests/common/mod.rs"]
mod common;

use crate::planted::Fault;
use crate::{EnvironmentMap, Gather, LightTransport, Material, RenderSettings, Size};
use common::{World, along_z, ball, dark, downwards, mean, shoot};
use std::f64::consts::PI;
use std::sync::Arc;

fn settings(light: LightTransport, gather: Gather) -> RenderSettings {
    let depth = if light == LightTransport::Direct { 16 } else { 64 };
    RenderSettings { light, gather, depth, samples: 32, photons: 60_000, ..dark() }
}

/// By how much the radiance inside of a shining grey sphere is off.
fn sphere(settings: &RenderSettings) -> f64 {
    let shining = Material::new("grey", [0.7; 3]).with_emission([1.0; 3]);
    let mut world = World { materials: vec![shining], ..World::default() };
    ball(&mut world, 0, [0.0; 3], 1.0, true);
    let size = Size::new(16, 12).unwrap();
    let shot = shoot(&world, along_z([0.1, 0.2, 0.3], size, 0.9), size, settings);
    mean(&shot)[0] * 0.3 - 1.0
}

/// By how much the light of a square is off on a floor below it, with that of its image in a mirror where there is one.
fn square(settings: &RenderSettings, mirrored: bool) -> f64 {
    let mut world = World {
        materials: vec![
            Material::new("floor", [0.8; 3]),
            Material::new("lamp", [0.0; 3]).with_emission([5.0; 3]),
            Material::new("mirror", [0.0; 3]).with_mirror([1.0; 3]),
        ],
        ..World::default()
    };
    world.floor(0, 0.0, 2.0);
    world.quad(1, [[-1.0, 2.0, -1.0], [1.0, 2.0, -1.0], [1.0, 2.0, 1.0], [-1.0, 2.0, 1.0]]);
    let k = 1.0 / 5.0f64.sqrt();
    let mut irradiance = 4.0 * 5.0 * k * k.atan();
    if mirrored {
        // Just beside the lamp: the image is the other half of a lamp of 4 x 2, from x = 1 to 3, less half of the one from 1 to -1.
        world.quad(2, [[1.0, 0.0, 9.0], [1.0, 0.0, -9.0], [1.0, 9.0, -9.0], [1.0, 9.0, 9.0]]);
        let quarter = |x: f64| {
            let (a, b) = (x / 2.0, 0.5f64);
            let (u, v) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
            0.5 * (a / u * (b / u).atan() + b / v * (a / v).atan())
        };
        irradiance = 2.0 * 5.0 * (quarter(3.0) + quarter(1.0));
    }
    let size = Size::new(4, 4).unwrap();
    let shot = shoot(&world, downwards([0.0, 1.0, 0.0], size, 0.1), size, settings);
    mean(&shot)[0] / (0.8 / PI * irradiance) - 1.0
}

/// By how much the light of a grey floor is off that lies under a map of two halves, one of them four times as bright.
fn sky(settings: &RenderSettings) -> f64 {
    let texels = vec![[4.0; 3], [1.0; 3], [4.0; 3], [1.0; 3]];
    let map = EnvironmentMap::new(2, 2, texels).unwrap();
    let mut world = World {
        materials: vec![Material::new("floor", [0.5; 3])],
        environment: Some(Arc::new(map)),
        ..World::default()
    };
    world.floor(0, 0.0, 2.0);
    let size = Size::new(4, 4).unwrap();
    let shot = shoot(&world, downwards([0.0, 1.0, 0.0], size, 0.1), size, settings);
    mean(&shot)[0] / (0.5 * 2.5) - 1.0
}

/// What judges, and by how much it may be off by chance.
type Judge = (fn(&RenderSettings) -> f64, f64);
/// A fault, the light in which it is planted, and its judge.
type Case = (Fault, LightTransport, Gather, Judge);

#[test]
fn faults_of_light_are_found() {
    use Gather::{Final, Maps};
    use LightTransport::{Paths, Photons};
    let sphere: Judge = (sphere, 0.02);
    let floor: Judge = (|settings| square(settings, false), 0.02);
    // A few photons beside the mirror.
    let mirror: Judge = (|settings| square(settings, true), 0.08);
    let sky: Judge = (sky, 0.03);
    let cases: [Case; 16] = [
        (Fault::SharesOfOne, Paths, Maps, sphere),
        (Fault::SharesOfOne, Photons, Final, sphere),
        (Fault::SurvivorsAsTheyAre, Paths, Maps, sphere),
        (Fault::LightsFace, Paths, Maps, floor),
        (Fault::LightsFace, Photons, Maps, floor),
        (Fault::EmissionWhole, Paths, Maps, sphere),
        (Fault::EmissionWhole, Photons, Maps, sphere),
        (Fault::EmissionWhole, Photons, Final, sphere),
        (Fault::SquareDisks, Photons, Maps, sphere),
        (Fault::PhotonsAsTheyAre, Photons, Maps, sphere),
        (Fault::CausticsTwice, Photons, Final, mirror),
        (Fault::SharesOfOne, Paths, Maps, sky),
        (Fault::MapDensity, LightTransport::Direct, Maps, sky),
        (Fault::MapDensity, Paths, Maps, sky),
        (Fault::MapDensity, Photons, Maps, sky),
        (Fault::MapDensity, Photons, Final, sky),
    ];
    for (fault, light, gather, (judge, chance)) in cases {
        let right = settings(light, gather);
        let off = judge(&right);
        assert!(off.abs() < chance, "{light:?} {gather:?}: off by {off}");
        let off = judge(&RenderSettings { planted: Some(fault), ..right });
        assert!(off.abs() > 2.0 * chance, "{fault:?} in {light:?} {gather:?}: off by {off} only");
    }
}
