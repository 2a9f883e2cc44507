//! Photon mapping: closed forms, the pictures of path tracing, energy, limits, and the same picture always.

use crate::common::{
    ALL, Point, Shot, World, along_z, ball, cornell, cornell_camera, dark, digest, downwards,
    everything, mean, near, shoot, try_shoot,
};
use splitplane_core::backend::BuildOptions;
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::points::build::PointBuildError;
use splitplane_core::ray::QueryOptions;
use splitplane_core::watch::{Progress, Stage, Watch};
use splitplane_cpu::CpuBackend;
use splitplane_render::cpu::CpuRenderer;
use splitplane_render::{
    Environment, FrameInput, Gather, LightTransport, MAX_BOUNCES, Material, Pinhole, RenderError,
    RenderSettings, Room, Size,
};
use std::f64::consts::PI;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

fn settings() -> RenderSettings {
    RenderSettings {
        light: LightTransport::Photons,
        depth: MAX_BOUNCES,
        samples: 8,
        passes: 2,
        photons: 200_000,
        ..dark()
    }
}

const GATHERS: [Gather; 2] = [Gather::Maps, Gather::Final];
const RHO: Point = [0.5, 0.25, 0.75];

/// Inside of a closed surface that shines with the radiance E and scatters the part rho, the radiance is E / (1 - rho) everywhere.
#[test]
fn the_inside_of_a_shining_grey_sphere() {
    for (size, ways) in [(1.0f32, &GATHERS[..]), (1e-20, &GATHERS[..1]), (1e15, &GATHERS[..1])] {
        let shining = Material::new("grey", RHO).with_emission([1.0, 2.0, 3.0]);
        let mut world = World { materials: vec![shining], ..World::default() };
        ball(&mut world, 0, [0.1, 0.2, 0.3].map(|x| x * size), 2.0 * size, true);
        let picture = Size::new(24, 16).unwrap();
        for &gather in ways {
            let settings = RenderSettings { gather, ..settings() };
            let eye = [0.6, 0.1, 0.9].map(|x| x * size);
            let shot = shoot(&world, along_z(eye, picture, 0.7), picture, &settings);
            for (channel, got) in mean(&shot).into_iter().enumerate() {
                let want = [1.0, 2.0, 3.0][channel] / (1.0 - f64::from(RHO[channel]));
                near(got as f32, want, 0.005);
            }
        }
    }
}

/// Lamps that are not sampled are found by chance.
#[test]
fn a_grey_sphere_whose_light_is_not_sampled() {
    let shining = Material::new("grey", [0.5; 3]).with_emission([1.0; 3]);
    let mut world = World { materials: vec![shining], ..World::default() };
    ball(&mut world, 0, [0.0; 3], 1.0, true);
    let size = Size::new(12, 12).unwrap();
    for gather in GATHERS {
        let settings = RenderSettings { gather, area_samples: 0, ..settings() };
        let shot = shoot(&world, along_z([0.0; 3], size, 0.7), size, &settings);
        near(mean(&shot)[0] as f32, 2.0, 0.01);
    }
}

/// Two plates, wider than their distance: the lower shines with E, and they scatter the parts a and b. Below there is E / (1 - a b), above b times that.
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
    world.floor(0, 0.0, 40.0);
    world.floor(1, 1.0, 40.0);
    let size = Size::new(16, 16).unwrap();
    let below = f64::from(1.0 / (1.0 - a * b));
    let settings = RenderSettings { gather: Gather::Final, ..settings() };
    let down = shoot(&world, downwards([0.0, 0.9, 0.0], size, 18.0), size, &settings);
    near(mean(&down)[0] as f32, below, 0.005);
    let up = along_z([0.0, 0.5, 0.0], size, 32.0);
    let up = Pinhole { corner: [-32.0, 1.0, -32.0], step_y: [0.0, 0.0, up.step_x[0]], ..up };
    let above = shoot(&world, up, size, &settings);
    near(mean(&above)[0] as f32, f64::from(b) * below, 0.005);
}

/// A white ball in a glass ball, in evenly bright surroundings, looks like these: photons of the environment bring all its light.
#[test]
fn a_white_ball_in_glass() {
    let glass = Material::new("glass", [0.0; 3]).with_dielectric(1.5, [1.0; 3]);
    let white = Material::new("white", [1.0; 3]);
    let mut world = World { materials: vec![glass, white], ..World::default() };
    ball(&mut world, 0, [0.0; 3], 1.0, false);
    ball(&mut world, 1, [0.0; 3], 0.6, false);
    let size = Size::new(12, 12).unwrap();
    let settings =
        RenderSettings { environment: Environment::uniform([1.0; 3]), passes: 4, ..settings() };
    let shot = shoot(&world, along_z([0.0, 0.0, 4.0], size, 0.2), size, &settings);
    near(mean(&shot)[0] as f32, 1.0, 0.01);
}

/// The irradiance of a point by a rectangle that shines, seen from below: the integral, in `f64`.
fn by_rectangle(radiance: f64, x: [f64; 2], z: [f64; 2], height: f64) -> f64 {
    let steps = 100;
    let at = |[from, to]: [f64; 2], i| from + (to - from) * (f64::from(i) + 0.5) / f64::from(steps);
    let area = (x[1] - x[0]) * (z[1] - z[0]) / f64::from(steps * steps);
    let mut sum = 0.0;
    for i in 0..steps {
        for j in 0..steps {
            let (x, z) = (at(x, i), at(z, j));
            let squared = x * x + z * z + height * height;
            sum += height * height / (squared * squared) * area;
        }
    }
    radiance * sum
}

/// A floor between a lamp and a perfect mirror: the lamp's light, and once that of its mirror image.
#[test]
fn a_mirror_image_lights_a_floor_once() {
    let mut world = World {
        materials: vec![
            Material::new("floor", [0.8; 3]),
            Material::new("lamp", [0.0; 3]).with_emission([5.0; 3]),
            Material::new("mirror", [0.0; 3]).with_mirror([1.0; 3]),
        ],
        ..World::default()
    };
    world.floor(0, 0.0, 3.0);
    world.quad(1, [[-1.0, 2.0, -1.0], [1.0, 2.0, -1.0], [1.0, 2.0, 1.0], [-1.0, 2.0, 1.0]]);
    let x = 1.5;
    world.quad(2, [[x, 0.0, 9.0], [x, 0.0, -9.0], [x, 9.0, -9.0], [x, 9.0, 9.0]]);
    let size = Size::new(6, 6).unwrap();
    let camera = downwards([0.0, 1.0, 0.0], size, 0.3);
    // The mean over what is seen of the floor, from -0.3 to 0.3.
    let mut irradiance = 0.0;
    for i in 0..36 {
        let [x, z] = [i % 6, i / 6].map(|i| f64::from(i) * 0.1 - 0.25);
        let at = |lamp: [f64; 2]| by_rectangle(5.0, lamp.map(|e| e - x), [-1.0 - z, 1.0 - z], 2.0);
        irradiance += (at([-1.0, 1.0]) + at([2.0, 4.0])) / 36.0;
    }
    let wanted = 0.8 / PI * irradiance;
    for gather in GATHERS {
        let settings = RenderSettings { gather, passes: 8, ..settings() };
        let shot = shoot(&world, camera, size, &settings);
        let photons = shot.renderer.photons().unwrap();
        assert!(photons.caustics > 1000 && photons.rays > photons.photons, "{photons:?}");
        near(mean(&shot)[0] as f32, wanted, 0.01);
    }
}

/// Means of the radiance of blocks of 6 x 6 pixels, red and green and blue, over some seeds, and their standard errors.
fn blocks(shots: &[Shot]) -> Vec<[f64; 2]> {
    let (width, height) = (shots[0].size.width(), shots[0].size.height());
    let mut found = Vec::new();
    for y in (0..height).step_by(6) {
        for x in (0..width).step_by(6) {
            let values: Vec<f64> = shots
                .iter()
                .map(|shot| {
                    let pixels = (0..36).map(|i| shot.at(x + i % 6, y + i / 6));
                    pixels.flatten().map(f64::from).sum::<f64>() / 108.0
                })
                .collect();
            let count = values.len() as f64;
            let mean = values.iter().sum::<f64>() / count;
            let spread = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
            found.push([mean, (spread / (count - 1.0) / count).sqrt()]);
        }
    }
    found
}

/// Holds photons to paths: blocks may differ by four standard errors of the two, which four seeds each give, and by the part `bias` for
/// disks that have not shrunk yet; the whole picture by a fifth of that and its noise.
fn photons_are_like_paths(world: &World, camera: Pinhole, size: Size, bias: f64) {
    let shots = |settings: RenderSettings| -> Vec<[f64; 2]> {
        let of = |seed| shoot(world, camera, size, &RenderSettings { seed, ..settings });
        blocks(&(1..=4).map(of).collect::<Vec<_>>())
    };
    // As many samples of each pixel, so that both see the same.
    let depth = 24;
    let light = LightTransport::Paths;
    let paths = shots(RenderSettings { light, depth, samples: 32, passes: 3, ..settings() });
    let whole = |blocks: &[[f64; 2]]| {
        let count = blocks.len() as f64;
        let noise = blocks.iter().map(|[_, error]| error * error).sum::<f64>().sqrt() / count;
        (blocks.iter().map(|[mean, _]| mean).sum::<f64>() / count, noise)
    };
    for gather in GATHERS {
        let wanted = RenderSettings {
            depth,
            gather,
            photons: 60_000,
            neighbours: 24,
            samples: 16,
            passes: 6,
            ..settings()
        };
        let photons = shots(wanted);
        for (place, ([by_paths, noise], [by_photons, other])) in
            paths.iter().zip(&photons).enumerate()
        {
            let bound = 4.0 * (noise * noise + other * other).sqrt() + bias * by_paths;
            let off = (by_paths - by_photons).abs();
            assert!(off <= bound, "{gather:?} {place}: {by_paths} {by_photons} +- {bound}");
        }
        let (paths, photons) = (whole(&paths), whole(&photons));
        let bound = 4.0 * (paths.1.powi(2) + photons.1.powi(2)).sqrt() + 0.2 * bias * paths.0;
        assert!((paths.0 - photons.0).abs() <= bound, "{gather:?}: {paths:?} {photons:?}");
    }
}

#[test]
fn a_cornell_box_by_photons_and_by_paths() {
    let size = Size::new(24, 18).unwrap();
    photons_are_like_paths(&cornell(), cornell_camera(size), size, 0.02);
}

/// A clear ball over a floor that a lamp shines on: a caustic, which paths find by chance. The surfaces of half of the world have normals of their own.
#[test]
fn a_caustic_by_photons_and_by_paths() {
    let mut world = World {
        materials: vec![
            Material::new("floor", [0.7, 0.6, 0.5]).with_mirror([0.1; 3]),
            Material::new("lamp", [0.2; 3]).with_emission([8.0; 3]),
            Material::new("glass", [0.0; 3]).with_dielectric(1.5, [0.9, 1.0, 0.8]),
            Material::new("rough", [0.1, 0.2, 0.3]).with_mirror([0.6; 3]).with_roughness(0.5),
        ],
        ..World::default()
    };
    world.floor(0, 0.0, 2.0);
    world.quad(1, [[-1.0, 3.0, -1.0], [1.0, 3.0, -1.0], [1.0, 3.0, 1.0], [-1.0, 3.0, 1.0]]);
    let first = world.triangles.len();
    ball(&mut world, 2, [0.0, 0.8, 0.0], 0.6, false);
    world.normal_indices = vec![[u32::MAX; 3]; first];
    for corners in &world.triangles[first..] {
        let next = world.normals.len() as u32;
        let outwards = |[x, y, z]: Point| [x, y - 0.8, z];
        world.normals.extend(corners.map(outwards));
        world.normal_indices.push([next, next + 1, next + 2]);
    }
    world.block(3, [-1.9, 0.01, -1.0], [-1.4, 1.0, 1.0]);
    world.normal_indices.resize(world.triangles.len(), [u32::MAX; 3]);
    let size = Size::new(18, 18).unwrap();
    photons_are_like_paths(&world, downwards([0.0, 2.9, 0.0], size, 0.6), size, 0.03);
}

/// What is emitted is absorbed, escapes or is cut off; chance takes as much as it gives.
#[test]
fn the_energy_of_photons_is_conserved() {
    let world = everything();
    let size = Size::new(4, 4).unwrap();
    let all = RenderSettings { environment: Environment::SKY, depth: 12, ..settings() };
    let sums = |world: &World, settings: &RenderSettings| {
        let shot = shoot(world, cornell_camera(size), size, settings);
        *shot.renderer.photons().unwrap()
    };
    let report = sums(&world, &all);
    let counts = [report.photons, report.caustics, report.global];
    assert!(counts[0] >= 400_000 && counts[1] > 500 && counts[2] > 20_000, "{counts:?}");
    let energy = report.energy;
    for channel in 0..3 {
        let [emitted, escaped, absorbed, cut, chance] =
            [energy.emitted, energy.escaped, energy.absorbed, energy.cut, energy.chance]
                .map(|sum| sum[channel]);
        near((escaped + absorbed + cut + chance) as f32, emitted, 1e-6);
        assert!(chance.abs() < 0.003 * emitted, "{energy:?}");
        assert!(escaped > 0.1 * emitted && absorbed > 0.1 * emitted, "{energy:?}");
        assert!((0.0..0.05 * emitted).contains(&cut), "{energy:?}");
    }
    // A lamp of which area and radiance are known, in a box that keeps all: the front of the box is open, so nothing else is there.
    let black = Material::new("black", [1e-30; 3]);
    let lamp = Material::new("lamp", [0.0; 3]).with_emission([1.0, 2.0, 4.0]);
    let mut closed = World { materials: vec![black, lamp], ..World::default() };
    closed.block(0, [-1.0; 3], [1.0; 3]);
    closed.quad(1, [[-0.5, 0.0, -0.5], [0.5, 0.0, -0.5], [0.5, 0.0, 0.5], [-0.5, 0.0, 0.5]]);
    let kept = sums(&closed, &settings());
    let unit = f64::from(kept.exponent).exp2().powi(2) / 2.0;
    for (channel, radiance) in [1.0, 2.0, 4.0].into_iter().enumerate() {
        let emitted = kept.energy.emitted[channel] * unit;
        near(emitted as f32, 2.0 * PI * radiance, 1e-5);
        near(kept.energy.absorbed[channel] as f32, kept.energy.emitted[channel], 1e-6);
    }
}

#[test]
fn pictures_are_equal_on_any_number_of_threads_and_always() {
    let world = everything();
    let size = Size::new(16, 12).unwrap();
    let mut all = Vec::new();
    for gather in GATHERS {
        let environment = Environment::SKY;
        let settings = RenderSettings {
            gather,
            environment,
            depth: 8,
            photons: 20_000,
            samples: 4,
            ..settings()
        };
        let picture = |threads, settings: &RenderSettings| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let shot = shoot(&world, cornell_camera(size), size, settings);
                (digest(shot.renderer.radiance()), *shot.renderer.photons().unwrap())
            })
        };
        let one = picture(1, &settings);
        assert_eq!([picture(2, &settings), picture(3, &settings)], [one; 2]);
        assert_ne!(picture(2, &RenderSettings { seed: 2, ..settings }).0, one.0);
        all.push(format!("{gather:?} {:016x} {} {}", one.0, one.1.caustics, one.1.global));
    }
    insta::assert_snapshot!("room_by_photons", all.join("\n"));
}

/// A scene that no photon can light has none, and is that of path tracing where the two do the same.
#[test]
fn what_needs_no_photons_has_none() {
    let size = Size::new(12, 9).unwrap();
    let photons = |world: &World, settings: &RenderSettings| {
        let shot = shoot(world, cornell_camera(size), size, settings);
        assert_eq!(shot.stats.plan.photons() > 0, shot.renderer.photons().is_some());
        let text = shot.stats.plan.explain();
        assert_eq!(text.contains("\nphotons  "), shot.stats.plan.photons() > 0, "{text}");
        (shot.renderer.photons().is_some(), shot.renderer.radiance().to_vec(), text)
    };
    let some = RenderSettings { photons: 64, samples: 1, passes: 1, depth: 6, ..settings() };
    let as_paths = RenderSettings { light: LightTransport::Paths, ..some };
    assert!(photons(&cornell(), &some).0);
    assert!(!photons(&cornell(), &as_paths).0);
    let (any, _, text) = photons(&cornell(), &RenderSettings { depth: 0, ..some });
    assert!(!any && text.contains("photons: the depth is 0"), "{text}");
    let mut dark = cornell();
    dark.materials[3] = Material::new("off", [0.5; 3]);
    let (any, _, text) = photons(&dark, &some);
    assert!(!any && text.contains("photons: nothing shines"), "{text}");
    let mut mirrors = cornell();
    for material in &mut mirrors.materials[..3] {
        *material = Material::new("mirror", [0.0; 3]).with_mirror([0.9, 0.8, 0.7]);
    }
    let (any, picture, text) = photons(&mirrors, &some);
    assert!(!any && text.contains("photons: no surface scatters light evenly"), "{text}");
    assert_eq!(picture, photons(&mirrors, &as_paths).1);
}

#[test]
fn limits_and_settings() {
    let size = Size::new(4, 4).unwrap();
    let world = cornell();
    let shot = |settings: &RenderSettings, room| {
        try_shoot(&world, cornell_camera(size), size, settings, room).err()
    };
    let small = Room { buffer_bytes: 100_000, ..Room::CPU };
    let refused = shot(&settings(), small).unwrap();
    assert!(matches!(refused, RenderError::TooManyPhotons { allowed: 100_000, .. }), "{refused}");
    // The photons fit, their tree does not.
    let few = RenderSettings { photons: 20_000, passes: 1, ..settings() };
    let stored = shoot(&world, cornell_camera(size), size, &few).renderer.photons().unwrap().global;
    let tree = Room { buffer_bytes: 30 * stored, ..Room::CPU };
    let refused = shot(&few, tree).unwrap();
    let of_tree = RenderError::PhotonMap(PointBuildError::OutOfMemory { needed: 0, limit: 0 });
    assert_eq!(std::mem::discriminant(&refused), std::mem::discriminant(&of_tree), "{refused}");
    assert_eq!(shot(&few, Room::CPU), None);
    for (settings, name) in [
        (RenderSettings { photons: 63, ..settings() }, "photons"),
        (RenderSettings { photons: (1 << 24) + 1, ..settings() }, "photons"),
        (RenderSettings { neighbours: 7, ..settings() }, "neighbours"),
        (RenderSettings { neighbours: 1025, ..settings() }, "neighbours"),
    ] {
        assert!(shot(&settings, Room::CPU).unwrap().to_string().contains(name));
    }
}

/// A watch ends photons on their way, the build of their tree, and their look-up.
#[test]
fn photons_can_be_cancelled() {
    let world = cornell();
    let mesh = Mesh::soup(&world.triangles).unwrap();
    let accelerator = CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).unwrap();
    let (scene, size) = (world.data(), Size::new(4, 4).unwrap());
    let settings = RenderSettings { photons: 5000, ..settings() };
    let render = |watch: &dyn Watch| {
        let query = QueryOptions { watch: Some(watch), ..QueryOptions::default() };
        let (camera, settings) = (cornell_camera(size), &settings);
        let input = FrameInput { mesh, scene: &scene, camera, size, settings, outputs: ALL, query };
        CpuRenderer::new().render(&accelerator, &input)
    };
    let stop = |when: bool| if when { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let on_their_way = render(&|progress: &Progress| stop(progress.stage == Stage::Rays));
    assert!(matches!(on_their_way, Err(RenderError::Query(QueryError::Cancelled { .. }))));
    let tree = render(&|progress: &Progress| stop(progress.stage == Stage::Points));
    let cancelled = |error: &RenderError| {
        matches!(error, RenderError::PhotonMap(PointBuildError::Cancelled { .. }))
    };
    assert!(tree.as_ref().is_err_and(cancelled), "{tree:?}");
    let is_built = AtomicBool::new(false);
    let after = render(&|progress: &Progress| {
        let is_tree = progress.stage == Stage::Points;
        is_built.fetch_or(is_tree, Ordering::Relaxed);
        stop(!is_tree && is_built.load(Ordering::Relaxed))
    });
    assert!(matches!(after, Err(RenderError::Query(QueryError::Cancelled { .. }))), "{after:?}");
    assert!(render(&|_: &Progress| stop(false)).is_ok());
}
