//! Rough mirrors and rough glass in a furnace: no energy is made, and what is lost is what an integral in `f64` says.

use crate::common::{World, along_z, dark, mean, near, shoot};
use splitplane_render::{Environment, LightTransport, Material, Pinhole, RenderSettings, Size};
use std::f64::consts::{PI, TAU};

/// Five, the last the greatest.
const ROUGHNESSES: [f32; 5] = [0.1, 0.3, 0.5, 0.75, 1.0];

fn furnace() -> RenderSettings {
    RenderSettings {
        light: LightTransport::Paths,
        depth: 64,
        samples: 64,
        passes: 2,
        environment: Environment::uniform([1.0; 3]),
        ..dark()
    }
}

/// Walter et al. 2007: density of facets, and what Smith's function hides.
fn facets(alpha: f64, cosine: f64) -> f64 {
    let square = alpha * alpha;
    square / (PI * (cosine * cosine * (square - 1.0) + 1.0).powi(2))
}

fn hidden(alpha: f64, cosine: f64) -> f64 {
    let tangent = (1.0 - cosine * cosine) / (cosine * cosine);
    0.5 * ((1.0 + alpha * alpha * tangent).sqrt() - 1.0)
}

/// What a white rough mirror sends back of light that comes at this cosine, once scattered: the integral over facets.
fn sent_back(alpha: f64, cosine: f64) -> f64 {
    let (rows, columns) = (1000, 400);
    let view = [(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
    let mut sum = 0.0;
    for row in 0..rows {
        // Squares of tangents that are spread as the facets are.
        let part = (f64::from(row) + 0.5) / f64::from(rows);
        let height = 1.0 / (1.0 + alpha * alpha * part / (1.0 - part)).sqrt();
        let around = (1.0 - height * height).sqrt();
        for column in 0..columns {
            let angle = TAU * (f64::from(column) + 0.5) / f64::from(columns);
            let facet = [around * angle.cos(), around * angle.sin(), height];
            let along: f64 = (0..3).map(|k| view[k] * facet[k]).sum();
            let light = 2.0 * along * facet[2] - view[2];
            if along <= 0.0 || light <= 0.0 {
                continue;
            }
            let both = 1.0 / (1.0 + hidden(alpha, cosine) + hidden(alpha, light));
            // Facets are drawn with the density D cos; f cos dl = D G / (4 v l) l, dl = 4 (v.h) dh.
            sum += both * along / (cosine * height);
        }
    }
    sum / f64::from(rows * columns)
}

#[test]
fn the_integral_is_one_for_smooth_mirrors_and_its_density_has_area_one() {
    assert!((sent_back(0.001, 0.7) - 1.0).abs() < 1e-3);
    let steps = 100_000;
    let area: f64 = (0..steps)
        .map(|i| (f64::from(i) + 0.5) / f64::from(steps))
        .map(|cosine| TAU * facets(0.3, cosine) * cosine / f64::from(steps))
        .sum();
    assert!((area - 1.0).abs() < 1e-3, "{area}");
}

/// A camera that looks at the plane y = 0 with this cosine to its normal, through a narrow angle.
fn slanted(cosine: f32, size: Size) -> Pinhole {
    let sine = (1.0 - cosine * cosine).sqrt();
    let step = 1e-3 / size.width() as f32;
    Pinhole {
        eye: [0.0, cosine * 2.0, sine * 2.0],
        corner: [-0.5e-3, -cosine, -sine],
        step_x: [step, 0.0, 0.0],
        step_y: [0.0, -step, 0.0],
    }
}

#[test]
fn rough_mirrors_send_back_what_the_integral_says() {
    let size = Size::new(8, 8).unwrap();
    for roughness in ROUGHNESSES {
        let white = Material::new("metal", [0.0; 3]).with_mirror([1.0, 0.5, 0.25]);
        let mut world =
            World { materials: vec![white.with_roughness(roughness)], ..World::default() };
        world.floor(0, 0.0, 10.0);
        for cosine in [1.0, 0.6, 0.2] {
            let shot = shoot(&world, slanted(cosine, size), size, &furnace());
            let got = mean(&shot);
            let want = sent_back(f64::from(roughness * roughness), f64::from(cosine));
            assert!(want <= 1.0 + 1e-6, "{roughness} {cosine}: {want}");
            for (got, part) in got.into_iter().zip([1.0, 0.5, 0.25]) {
                near(got as f32, want * part, 0.01);
            }
        }
    }
}

/// A convex body of rough metal or rough glass: no pixel's mean is above the surroundings by more than noise, and what scattering once
/// loses is bounded: less than 60 % at the greatest roughness, which is glass that light passes several surfaces of.
#[test]
fn no_rough_body_makes_energy() {
    let black = || Material::new("black", [0.0; 3]);
    let size = Size::new(12, 12).unwrap();
    for roughness in ROUGHNESSES {
        for material in [
            black().with_mirror([1.0; 3]),
            Material::new("both", [0.5; 3]).with_mirror([0.5; 3]),
            black().with_dielectric(1.5, [1.0; 3]),
        ] {
            let mut world =
                World { materials: vec![material.with_roughness(roughness)], ..World::default() };
            world.block(0, [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]);
            let camera = along_z([0.3, 0.6, 4.0], size, 0.2);
            let [got, ..] = mean(&shoot(&world, camera, size, &furnace()));
            assert!(got <= 1.005, "{roughness}: {got}");
            assert!(got >= 0.4, "{roughness}: {got}");
            if roughness < 0.2 {
                assert!(got >= 0.98, "{roughness}: {got}");
            }
        }
    }
}

/// The smoother, the nearer to a perfect mirror and to perfect glass, which direct light shows too.
#[test]
fn a_nearly_smooth_surface_looks_like_a_smooth_one() {
    let size = Size::new(12, 12).unwrap();
    let sky = RenderSettings { environment: Environment::SKY, ..furnace() };
    for material in [
        Material::new("metal", [0.0; 3]).with_mirror([0.9, 0.7, 0.5]),
        Material::new("glass", [0.0; 3]).with_dielectric(1.5, [0.9, 1.0, 0.8]),
    ] {
        let of = |roughness| {
            let material = material.clone().with_roughness(roughness);
            let mut world = World { materials: vec![material], ..World::default() };
            world.block(0, [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]);
            mean(&shoot(&world, along_z([0.3, 0.6, 4.0], size, 0.2), size, &sky))
        };
        let (smooth, rough) = (of(0.0), of(0.08));
        for channel in 0..3 {
            near(rough[channel] as f32, smooth[channel], 0.03);
        }
    }
}
