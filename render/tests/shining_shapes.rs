//! Spheres and capsules that shine: closed forms, by every transport.

use crate::common::{World, along_z, dark, downwards, near};
use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::shape::{Capsule, Shapes, Sphere};
use splitplane_core::scene::{IDENTITY, Instance, Scene, Transform, translation};
use splitplane_cpu::CpuBackend;
use splitplane_render::instances::Geometries;
use splitplane_render::scene_data::NONE;
use splitplane_render::tracer::{FrameRequest, InstanceTracer, InstancedLook};
use splitplane_render::{Gather, LightTransport, Material, Outputs, Pinhole, RenderSettings, Size};
use std::f64::consts::PI;

/// Turned and stretched, and in a mirror.
const STRETCHED: Transform =
    [[-1.5, 0.4, -0.3, 0.25], [0.2, 0.5, 0.1, 0.5], [0.0, -0.3, 1.25, -0.75]];

/// The mean radiance of a picture of shapes of material 0 and a mesh in its own materials.
fn mean(
    (world, shapes, place): (&World, Shapes, Transform),
    (camera, size): (Pinhole, Size),
    settings: RenderSettings,
) -> [f64; 3] {
    let mut scene = Scene::new();
    let shining = scene.add_shapes(shapes).unwrap();
    scene.add_instance(Instance::new(shining, place)).unwrap();
    let mesh = Mesh::soup(&world.triangles).unwrap();
    if !world.triangles.is_empty() {
        let floor = scene.add_mesh(&mesh).unwrap();
        scene.add_instance(Instance::new(floor, IDENTITY)).unwrap();
    }
    let geometries = Geometries { first_triangles: &[0, 0], materials: &[0, NONE] };
    let look = InstancedLook { mesh, appearance: world.appearance(), geometries };
    let options = BuildOptions::default();
    let mut tracer = InstanceTracer::load(CpuBackend::new(), &scene, &look, &options).unwrap();
    assert_eq!(tracer.appearance().needs().emitters, 1);
    let outputs = Outputs { radiance: true, ..Outputs::PIXELS };
    let new = FrameRequest::new(camera, size);
    tracer.frame(&mesh, &FrameRequest { settings, outputs, ..new }).unwrap();
    let pixels = tracer.radiance();
    let channel = |k: usize| pixels.iter().map(|pixel| f64::from(pixel[k])).sum::<f64>();
    [0, 1, 2].map(|k| channel(k) / pixels.len() as f64)
}

fn settings(light: LightTransport) -> RenderSettings {
    let few = RenderSettings { light, samples: 8, passes: 4, photons: 50_000, ..dark() };
    match light {
        LightTransport::Direct => few,
        _ => RenderSettings { depth: 64, ..few },
    }
}

/// Inside of a closed surface that shines with the radiance E and scatters the part rho, the radiance is E / (1 - rho) everywhere, whatever
/// its shape: so a density of samples that is wrong anywhere is seen.
#[test]
fn the_inside_of_what_shines() {
    let rho = [0.5, 0.25, 0.75];
    let grey = Material::new("grey", rho).with_emission([1.0, 2.0, 3.0]);
    let world = World { materials: vec![grey], ..World::default() };
    let ball = || Shapes::Spheres(vec![Sphere { centre: [0.1, 0.2, 0.3], radius: 2.0 }]);
    let pill = Capsule { ends: [[-1.0, -0.5, 0.25], [1.5, 0.75, -0.5]], radius: 0.75 };
    let size = Size::new(24, 16).unwrap();
    let camera = along_z([0.25, 0.5, -0.6], size, 0.7);
    let pill = Shapes::Capsules(vec![pill]);
    for (shapes, place) in [(ball(), IDENTITY), (ball(), STRETCHED), (pill, STRETCHED)] {
        for (light, area_samples) in
            [(LightTransport::Paths, 1), (LightTransport::Paths, 0), (LightTransport::Photons, 1)]
        {
            let settings = RenderSettings { area_samples, ..settings(light) };
            let got = mean((&world, shapes.clone(), place), (camera, size), settings);
            for (channel, got) in got.into_iter().enumerate() {
                let want = [1.0, 2.0, 3.0][channel] / (1.0 - f64::from(rho[channel]));
                near(got as f32, want, 0.01);
            }
        }
    }
}

/// A ball of radiance E and radius r, d away from a floor that it stands wholly above, gives it the irradiance pi E (r / d)^2 times the
/// cosine; and the same where a transform makes it from another ball.
#[test]
fn a_ball_that_shines_lights_a_floor() {
    let mut world = World {
        materials: vec![
            Material::new("ball", [0.0; 3]).with_emission([3.0, 2.0, 1.0]),
            Material::new("floor", [0.8; 3]),
        ],
        ..World::default()
    };
    world.floor(1, 0.0, 9.0);
    let ball = |centre, radius| Shapes::Spheres(vec![Sphere { centre, radius }]);
    let size = Size::new(8, 8).unwrap();
    let camera = downwards([1.5, 0.5, 0.0], size, 0.2);
    // The mean over what is seen of the floor, a tenth of the height to each side.
    let mut irradiance = 0.0;
    for i in 0..64 {
        let [x, z] = [i % 8, i / 8].map(|i| (f64::from(i) - 3.5) * 0.025);
        let squared = (x + 1.5).powi(2) + z * z + 4.0;
        irradiance += PI * 0.25 / squared * (2.0 / squared.sqrt()) / 64.0;
    }
    let [zoomed, moved] = [
        [[0.25, 0.0, 0.0, 0.0], [0.0, 0.25, 0.0, 2.0], [0.0, 0.0, 0.25, 0.0]],
        translation([0.0, 1.0, 0.0]),
    ];
    for (shapes, place) in [(ball([0.0, 1.0, 0.0], 0.5), moved), (ball([0.0; 3], 2.0), zoomed)] {
        for light in [LightTransport::Direct, LightTransport::Paths, LightTransport::Photons] {
            let settings = RenderSettings { gather: Gather::Maps, passes: 16, ..settings(light) };
            let got = mean((&world, shapes.clone(), place), (camera, size), settings);
            for (got, radiance) in got.into_iter().zip([3.0, 2.0, 1.0]) {
                near(got as f32, 0.8 / PI * irradiance * radiance, 0.01);
            }
        }
    }
}
