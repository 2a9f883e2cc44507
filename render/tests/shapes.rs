//! Pictures of spheres and capsules: true normals, no shadow of their own, and clear bodies.

use crate::common::{ALL, along_z};
use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::shape::{Capsule, Shapes, Sphere};
use splitplane_core::scene::{IDENTITY, Instance, Scene, Transform};
use splitplane_cpu::CpuBackend;
use splitplane_render::instances::Geometries;
use splitplane_render::layout::FirstHit;
use splitplane_render::tracer::{FrameRequest, InstanceTracer, InstancedLook};
use splitplane_render::{
    Appearance, Environment, Light, LightTransport, Material, RenderSettings, Size,
};

const EYE: [f32; 3] = [0.25, 0.5, 8.0];
const SUN: [f64; 3] = [0.0, 0.6, 0.8];

fn ball() -> Shapes {
    Shapes::Spheres(vec![Sphere { centre: [0.0; 3], radius: 1.0 }])
}

fn pill() -> Capsule {
    Capsule { ends: [[-1.0, -0.5, 0.25], [1.5, 0.75, -0.5]], radius: 0.75 }
}

/// Turned by a third and a half, stretched, and moved.
const STRETCHED: Transform =
    [[1.5, -0.4, 0.3, 0.25], [0.2, 0.5, 0.1, 0.5], [0.0, -0.3, 1.25, -0.75]];
/// The same in a mirror.
const MIRRORED: Transform =
    [[-1.5, 0.4, -0.3, 0.25], [0.2, 0.5, 0.1, 0.5], [0.0, -0.3, 1.25, -0.75]];
/// A rotation by the Pythagorean triple 3, 4, 5.
const TURNED: Transform = [[0.8, -0.6, 0.0, 0.0], [0.6, 0.8, 0.0, 0.25], [0.0, 0.0, 1.0, -0.5]];

struct Picture {
    hits: Vec<FirstHit>,
    radiance: Vec<[f32; 4]>,
    tests: u64,
}

fn picture(
    shapes: Option<Shapes>,
    place: Transform,
    material: Material,
    light: LightTransport,
) -> Picture {
    let mut scene = Scene::new();
    let instances = usize::from(shapes.is_some());
    if let Some(shapes) = shapes {
        let geometry = scene.add_shapes(shapes).unwrap();
        scene.add_instance(Instance::new(geometry, place)).unwrap();
    }
    let mesh = Mesh::soup(&[]).unwrap();
    let is_clear = material.dielectric.is_some();
    let materials = [Material::clay(), material];
    let lights = [Light::Directional { towards: SUN.map(|x| x as f32), irradiance: [2.0; 3] }];
    let appearance = Appearance {
        materials: &materials,
        lights: if is_clear { &[] } else { &lights },
        ..Appearance::default()
    };
    let of_instances = vec![1; instances];
    let geometries = Geometries { first_triangles: &[], materials: &of_instances };
    let look = InstancedLook { mesh, appearance, geometries };
    let options = BuildOptions::default();
    let mut tracer = InstanceTracer::load(CpuBackend::new(), &scene, &look, &options).unwrap();
    let size = Size::new(80, 60).unwrap();
    let settings = RenderSettings {
        samples: 1,
        area_samples: 0,
        depth: 6,
        ambient: 0.0,
        headlight: 0.0,
        environment: if is_clear { Environment::SKY } else { Environment::BLACK },
        light,
        ..RenderSettings::default()
    };
    let camera = along_z(EYE, size, 0.35);
    let request = FrameRequest { settings, outputs: ALL, ..FrameRequest::new(camera, size) };
    tracer.frame(&mesh, &request).unwrap();
    Picture {
        hits: tracer.first_hits().to_vec(),
        radiance: tracer.radiance().to_vec(),
        tests: tracer.first_costs().iter().map(|cost| u64::from(cost.triangles)).sum(),
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    a.map(|x| x / dot(a, a).sqrt())
}

fn placed(transform: &Transform, point: [f64; 3]) -> [f64; 3] {
    transform.map(|row| {
        let [a, b, c, d] = row.map(f64::from);
        dot([a, b, c], point) + d
    })
}

/// How far the point that has this normal is from lying where the ray met the surface: rays have length 1, so `depth` is the distance
/// from the eye. Of an ellipsoid the point with normal n is A y, y the direction of A^T n.
fn off(hit: &FirstHit, transform: &Transform, turn: impl Fn([f64; 3]) -> [f64; 3]) -> f64 {
    let normal = turn(hit.normal.map(f64::from));
    let y = [0, 1, 2].map(|k| (0..3).map(|row| f64::from(transform[row][k]) * normal[row]).sum());
    distance_off(hit, placed(transform, unit(y)))
}

fn distance_off(hit: &FirstHit, point: [f64; 3]) -> f64 {
    let from = [0, 1, 2].map(|k| point[k] - f64::from(EYE[k]));
    (dot(from, from).sqrt() - f64::from(hit.depth)).abs()
}

fn worst(hits: &[FirstHit], off: impl Fn(&FirstHit) -> f64) -> f64 {
    let met: Vec<f64> = hits.iter().filter(|hit| hit.triangle == 0).map(off).collect();
    assert!(met.len() > 200, "{} pixels", met.len());
    met.into_iter().fold(0.0, f64::max)
}

#[test]
fn normals_are_those_of_the_surface() {
    let white = || Material::new("white", [0.5; 3]);
    for transform in [IDENTITY, TURNED, STRETCHED, MIRRORED] {
        let Picture { hits, tests, .. } =
            picture(Some(ball()), transform, white(), LightTransport::Direct);
        let right = worst(&hits, |hit| off(hit, &transform, |normal| normal));
        assert!(right < 2e-5, "{transform:?}: {right}");
        // Normals that are a little off are noticed.
        let wrong = worst(&hits, |hit| off(hit, &transform, |[x, y, z]| [x, y + 0.01, z]));
        assert!(wrong > 1e-3, "{transform:?}: {wrong}");
        assert!(tests as usize >= hits.iter().filter(|hit| hit.triangle == 0).count());
    }
    let Picture { hits, .. } =
        picture(Some(Shapes::Capsules(vec![pill()])), TURNED, white(), LightTransport::Direct);
    let on = |hit: &FirstHit, radius: f64| {
        let [a, b] = pill().ends.map(|end| end.map(f64::from));
        let axis = [0, 1, 2].map(|k| a[k] + f64::from(hit.u) * (b[k] - a[k]));
        let (axis, normal) = (placed(&TURNED, axis), hit.normal.map(f64::from));
        distance_off(hit, [0, 1, 2].map(|k| axis[k] + radius * normal[k]))
    };
    let right = worst(&hits, |hit| on(hit, 0.75));
    assert!(right < 2e-5, "{right}");
    assert!(worst(&hits, |hit| on(hit, 0.76)) > 1e-3);
    assert!(hits.iter().any(|hit| hit.triangle == 0 && hit.u == 0.0), "an end");
    assert!(hits.iter().any(|hit| hit.u > 0.2 && hit.u < 0.8), "the side");
}

/// Light falls off with the cosine, and nothing else: a surface that met its own shadow rays would have dark spots.
#[test]
fn lit_by_a_sun_with_no_shadow_of_their_own() {
    let shapes = [
        (ball(), IDENTITY),
        (ball(), STRETCHED),
        (ball(), MIRRORED),
        (Shapes::Capsules(vec![pill()]), TURNED),
    ];
    for (shapes, transform) in shapes {
        for light in [LightTransport::Direct, LightTransport::Paths] {
            let white = Material::new("white", [0.5; 3]);
            let made = picture(Some(shapes.clone()), transform, white, light);
            let (mut least, mut most, mut lit, mut dark) = (f64::INFINITY, 0.0f64, 0, 0);
            for (hit, radiance) in made.hits.iter().zip(&made.radiance) {
                if hit.triangle != 0 {
                    continue;
                }
                let cosine = dot(hit.normal.map(f64::from), SUN);
                if cosine > 0.02 {
                    let part = f64::from(radiance[0]) / cosine;
                    (least, most) = (least.min(part), most.max(part));
                    lit += 1;
                } else if cosine < -0.001 {
                    assert_eq!(radiance[0], 0.0, "{hit:?}");
                    dark += 1;
                }
            }
            assert!(lit > 200 && dark > 5, "{lit} {dark}");
            assert!(least > 0.0 && most / least < 1.001, "{transform:?}: {least} to {most}");
        }
    }
}

/// A clear ball that does not bend light is not to be seen; one that does is.
#[test]
fn rays_go_into_a_clear_ball_and_out_of_it() {
    let empty = picture(
        None,
        IDENTITY,
        Material::clay().with_dielectric(1.0, [1.0; 3]),
        LightTransport::Direct,
    );
    let differs = |index: f32, transform: Transform| {
        let clear = Material::clay().with_dielectric(index, [1.0; 3]);
        let made = picture(Some(ball()), transform, clear, LightTransport::Direct);
        let pairs = made.radiance.iter().zip(&empty.radiance);
        pairs.map(|(a, b)| (a[2] - b[2]).abs()).fold(0.0, f32::max)
    };
    for transform in [IDENTITY, STRETCHED, MIRRORED] {
        assert!(differs(1.0, transform) < 1e-3, "{transform:?}: {}", differs(1.0, transform));
        assert!(differs(1.5, transform) > 0.05, "{transform:?}");
    }
}
