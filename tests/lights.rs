//! Lights of scenes that bring none.

use splitplane::scene::{Light, Material, Placement, Scene, View};
use splitplane::{Accelerator, Backend, BuildOptions, CpuBackend, Hit, QueryOptions, Ray};

fn built(scene: &Scene) -> Box<dyn Accelerator> {
    let mesh = scene.mesh().unwrap();
    CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap()
}

fn place(scene: &Scene, lights: usize) -> Placement {
    Placement::of_with(scene, built(scene).as_ref(), 1.5, lights).unwrap()
}

/// Puts a box of quads into a scene, seen from both sides.
fn add_box(scene: &mut Scene, lo: [f32; 3], hi: [f32; 3]) {
    let first = scene.positions.len() as u32;
    for i in 0..8usize {
        scene.positions.push([0, 1, 2].map(|k| if i >> k & 1 == 0 { lo[k] } else { hi[k] }));
    }
    let quads =
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    for [a, b, c, d] in quads {
        scene.indices.extend([[a, b, c], [a, c, d]].map(|t: [u32; 3]| t.map(|v| first + v)));
    }
    scene.material_of.resize(scene.indices.len(), 0);
    scene.materials = vec![Material::clay()];
}

/// Two rooms with a wall that leaves a doorway, pillars in both.
fn rooms() -> Scene {
    let mut scene = Scene { name: "rooms".into(), ..Scene::default() };
    add_box(&mut scene, [0.0, 0.0, 0.0], [12.0, 3.0, 6.0]);
    add_box(&mut scene, [6.0, 0.01, 0.01], [6.3, 2.99, 4.5]);
    for x in [1.5, 4.0, 7.5, 10.0] {
        add_box(&mut scene, [x, 0.01, 2.0], [x + 0.3, 2.99, 2.3]);
        add_box(&mut scene, [x, 0.01, 4.0], [x + 0.5, 0.8, 4.5]);
    }
    // Things on the floor, so that most triangles are within.
    for i in 0..60 {
        let (x, z) = (0.4 + 0.9 * (i % 12) as f32, 0.5 + 1.1 * (i / 12) as f32);
        add_box(&mut scene, [x, 0.01, z], [x + 0.2, 0.2, z + 0.2]);
    }
    scene
}

fn object() -> Scene {
    let mut scene = Scene { name: "object".into(), ..Scene::default() };
    add_box(&mut scene, [-1.0, 0.0, -1.0], [1.0, 1.0, 1.0]);
    scene
}

fn point(light: &Light) -> ([f32; 3], [f32; 3], f32) {
    match *light {
        Light::Point { position, irradiance, distance } => (position, irradiance, distance),
        _ => panic!("{light:?}"),
    }
}

fn between(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
}

#[test]
fn light_of_the_scene_wins() {
    let mut scene = object();
    let own = Light::Directional { towards: [0.0, 1.0, 0.0], irradiance: [2.0; 3] };
    scene.lights = vec![own];
    assert_eq!(place(&scene, 3).lights, [own]);
    let mut scene = object();
    scene.materials[0] = Material::clay().with_emission([1.0; 3]);
    let placement = place(&scene, 3);
    assert_eq!((placement.lights.len(), placement.view), (0, View::Outside));
    // A material that no triangle has does not light.
    scene.materials.insert(0, Material::clay());
    assert_eq!(place(&scene, 3).lights.len(), 3);
    // A camera alone stays.
    scene.camera = Some(placement.camera);
    let given = place(&scene, 2);
    assert_eq!((given.camera, given.view, given.lights.len()), (placement.camera, View::Given, 2));
}

#[test]
fn together_they_give_daylight_to_what_is_looked_at() {
    let scene = object();
    for count in 1..=Placement::MAX_LIGHTS + 1 {
        let placement = place(&scene, count);
        assert_eq!(placement.view, View::Outside);
        assert_eq!(placement.lights.len(), count.min(Placement::MAX_LIGHTS));
        let at = placement.camera.look_at();
        let mut sum = [0.0f32; 3];
        for (i, light) in placement.lights.iter().enumerate() {
            let (position, irradiance, distance) = point(light);
            assert!((between(position, at) / distance - 1.0).abs() < 1e-4);
            assert!(position[1] > at[1]);
            assert!(i == 0 || irradiance[0] <= Light::DAYLIGHT[0] * (0.4 + 1e-6));
            sum = [0, 1, 2].map(|k| sum[k] + irradiance[k]);
        }
        for (sum, want) in sum.iter().zip(Light::DAYLIGHT) {
            assert!((sum / want - 1.0).abs() < 1e-5, "{count}: {sum}");
        }
        assert_eq!(place(&scene, 1).lights[0], place(&scene, 0).lights[0]);
    }
}

/// No wall between a light and what it lights: each reaches a fair part of what the camera sees.
#[test]
fn lights_inside_reach_what_is_seen() {
    let scene = rooms();
    let tree = built(&scene);
    let placement = Placement::of_with(&scene, tree.as_ref(), 1.5, 4).unwrap();
    assert_eq!(placement.view, View::Inside);
    assert!((2..=4).contains(&placement.lights.len()));
    let options = QueryOptions::default();
    let primary = placement.camera.rays(60, 40);
    let mut hits = vec![Hit::MISS; primary.len()];
    tree.closest_hits(&primary, &mut hits, &options).unwrap();
    let seen: Vec<[f32; 3]> = primary
        .iter()
        .zip(&hits)
        .filter(|(_, hit)| hit.is_hit())
        // A little before the surface.
        .map(|(ray, hit)| [0, 1, 2].map(|k| ray.origin[k] + 0.999 * hit.t * ray.direction[k]))
        .collect();
    let bounds = scene.bounds();
    for light in &placement.lights {
        let (position, _, _) = point(light);
        assert!((0..3).all(|k| bounds.lo[k] < position[k] && position[k] < bounds.hi[k]));
        let rays: Vec<Ray> = seen.iter().map(|&from| Ray::segment(from, position)).collect();
        let mut dark = vec![false; rays.len()];
        tree.any_hits(&rays, &mut dark, &options).unwrap();
        let part = dark.iter().filter(|dark| !**dark).count() as f64 / seen.len() as f64;
        assert!(part > 0.2, "{position:?} reaches {part}");
    }
    // The first alone is where it is among several, and gives all.
    let alone = Placement::of(&scene, tree.as_ref(), 1.5).unwrap();
    let (one, many) = (point(&alone.lights[0]), point(&placement.lights[0]));
    assert_eq!((one.0, one.1), (many.0, Light::DAYLIGHT));
}

#[test]
fn lights_of_scenes_of_any_size_are_finite() {
    for size in [1e-37f32, 1e-20, 1e20, 1e38] {
        let mut scene = object();
        scene.positions.as_flattened_mut().iter_mut().for_each(|x| *x *= size);
        for light in place(&scene, 3).lights {
            let (position, irradiance, distance) = point(&light);
            let numbers = [position, irradiance];
            assert!(numbers.as_flattened().iter().all(|x| x.is_finite()), "{size}: {light:?}");
            assert!(distance.is_finite() && distance > 0.0, "{size}: {light:?}");
        }
    }
}
