//! Textures, smooth normals, plans.

use crate::common::{World, along_z, dark, near, shoot};
use splitplane_core::mesh::Mesh;
use splitplane_render::{
    Appearance, Environment, Light, Material, Outputs, Plan, PlanError, RenderSettings, Room,
    SceneData, Size, Texture,
};

/// A wall of two by two units, its texture once over.
fn wall(texture: Option<Texture>) -> World {
    let mut material = Material::new("wall", [1.0; 3]);
    material.texture = Some(0);
    let mut world = World { materials: vec![material], ..World::default() };
    world.quad(0, [[-1.0, -1.0, -1.0], [1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, -1.0]]);
    world.textures.extend(texture);
    world.texcoords = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    world.texcoord_indices = vec![[0, 1, 2], [0, 2, 3]];
    world
}

fn evenly_lit() -> RenderSettings {
    RenderSettings {
        environment: Environment::uniform([1.0; 3]),
        ambient: 1.0,
        ..Default::default()
    }
}

#[test]
fn texels_lie_where_they_should_and_are_mixed_in_linear_light() {
    let [red, green, blue, grey] =
        [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [188, 188, 188, 255]];
    let texture = Texture::new("four", 2, 2, vec![red, green, blue, grey]).unwrap();
    let world = wall(Some(texture));
    let size = Size::new(4, 4).unwrap();
    let shot = shoot(&world, along_z([0.0; 3], size, 1.0), size, &evenly_lit());
    // Pixel centres at eighths: the outer ones lie at a quarter of a texel from its centre, mixed with
    // what the picture repeats beyond its edge.
    let grey = ((188.0f64 / 255.0 + 0.055) / 1.055).powf(2.4);
    near(shot.at(0, 0)[0], 0.75 * 0.75 + 0.25 * 0.25 * grey, 1e-5);
    near(shot.at(3, 3)[1], 0.75 * 0.75 * grey + 0.25 * 0.75, 1e-5);
    // Near the middle all four meet.
    let one = Size::new(1, 1).unwrap();
    let middle = shoot(&world, along_z([0.0; 3], one, 1e-4), one, &evenly_lit());
    near(middle.at(0, 0)[0], 0.25 * (1.0 + grey), 1e-4);
    near(middle.at(0, 0)[2], 0.25 * (1.0 + grey), 1e-4);
}

#[test]
fn a_material_without_its_texture_keeps_its_colour() {
    let world = wall(None);
    let size = Size::new(2, 2).unwrap();
    let shot = shoot(&world, along_z([0.0; 3], size, 0.5), size, &evenly_lit());
    assert_eq!(shot.at(0, 0), [1.0; 3]);
    assert!(!shot.stats.plan.needs().textures);
}

/// A flat triangle with the normals of a sphere is shaded like the sphere.
#[test]
fn smooth_normals_shade_between_corners() {
    let sun = Light::Directional { towards: [0.0, 0.0, 1.0], irradiance: [1.0; 3] };
    let mut world = wall(None);
    world.materials[0].texture = None;
    world.lights = vec![sun];
    world.normals = vec![[-1.0, -1.0, 2.0], [1.0, -1.0, 2.0], [1.0, 1.0, 2.0], [-1.0, 1.0, 2.0]];
    world.normal_indices = vec![[0, 1, 2], [0, 2, 3]];
    let size = Size::new(9, 9).unwrap();
    let camera = along_z([0.0; 3], size, 1.0);
    let smooth = shoot(&world, camera, size, &dark());
    let corner = smooth.at(0, 0)[0];
    let (x, y) = (8.0f64 / 9.0, 8.0 / 9.0);
    // On the diagonal the normal runs between those of two corners: unit ones are mixed.
    let unit = 1.0 / 6.0f64.sqrt();
    let mixed = [x * unit, y * unit, 2.0 * unit];
    let length = mixed.iter().map(|part| part * part).sum::<f64>().sqrt();
    near(corner, mixed[2] / length / std::f64::consts::PI, 1e-5);
    near(smooth.at(4, 4)[0], 1.0 / std::f64::consts::PI, 1e-5);
    world.normal_indices = vec![[u32::MAX; 3]; 2];
    let flat = shoot(&world, camera, size, &dark());
    near(flat.at(0, 0)[0], 1.0 / std::f64::consts::PI, 1e-5);
}

fn plan_of(world: &World, settings: &RenderSettings, outputs: Outputs) -> Result<Plan, PlanError> {
    let size = Size::new(640, 480).unwrap();
    Plan::new(&world.data(), size, settings, outputs, Room::CPU)
}

/// A scene pays for what it uses.
#[test]
fn plans_follow_from_scenes() {
    let lamp = Light::Point { position: [0.0, 1.0, 0.0], irradiance: [1.0; 3], distance: 1.0 };
    let mirror = Material::new("mirror", [0.0; 3]).with_mirror([0.9; 3]);
    let glass = Material::clay().with_dielectric(1.5, [1.0; 3]);
    let shining = Material::new("lamp", [0.0; 3]).with_emission([1.0; 3]);
    let diffuse = Material::new("white", [0.7; 3]);
    let scene = |materials: &[&Material], lights: &[Light]| {
        let mut world = World { lights: lights.to_vec(), ..World::default() };
        for (index, material) in materials.iter().enumerate() {
            world.materials.push((*material).clone());
            world.floor(index as u32, index as f32, 1.0);
        }
        world
    };
    let defaults = RenderSettings::default();
    let flat = RenderSettings { depth: 0, area_samples: 0, ..defaults };
    let depth_only = Outputs { pixels: false, first_hits: true, ..Outputs::PIXELS };
    let linear = Outputs { pixels: false, radiance: true, first_costs: true, ..Outputs::PIXELS };
    let lights = [lamp; 3];
    let plans = [
        ("nothing but diffuse surfaces", scene(&[&diffuse], &[]), defaults, Outputs::PIXELS),
        ("three lights", scene(&[&diffuse], &lights), defaults, Outputs::PIXELS),
        ("a mirror", scene(&[&diffuse, &mirror], &lights[..1]), defaults, Outputs::PIXELS),
        ("mirrors alone", scene(&[&mirror], &lights), defaults, Outputs::PIXELS),
        ("glass", scene(&[&diffuse, &glass], &lights[..1]), defaults, Outputs::PIXELS),
        (
            "all, no bounce",
            scene(&[&diffuse, &mirror, &glass, &shining], &[]),
            flat,
            Outputs::PIXELS,
        ),
        (
            "all, linear, with costs",
            scene(&[&diffuse, &mirror, &glass, &shining], &lights),
            defaults,
            linear,
        ),
        ("depth alone", scene(&[&diffuse, &mirror], &lights), defaults, depth_only),
    ];
    let mut text = String::new();
    for (name, world, settings, outputs) in plans {
        text += &format!("# {name}\n{}\n", plan_of(&world, &settings, outputs).unwrap().explain());
    }
    insta::assert_snapshot!("plans", text);
}

#[test]
fn too_many_lights_and_bad_settings_are_refused() {
    let lamp = Light::Point { position: [0.0, 1.0, 0.0], irradiance: [1.0; 3], distance: 1.0 };
    let mut world = World {
        materials: vec![Material::new("white", [0.7; 3])],
        lights: vec![lamp; 33],
        ..World::default()
    };
    world.floor(0, 0.0, 1.0);
    let plan = |world: &World, settings: &RenderSettings| plan_of(world, settings, Outputs::PIXELS);
    let error = plan(&world, &RenderSettings::default()).unwrap_err();
    assert_eq!(error, PlanError::TooManyLights { rays: 33 });
    world.lights.pop();
    assert!(plan(&world, &RenderSettings::default()).is_ok());
    let bad = RenderSettings { exposure: 0.0, ..RenderSettings::default() };
    assert!(plan(&world, &bad).unwrap_err().to_string().contains("exposure"));
}

/// Indices that name nothing do no harm.
#[test]
fn odd_appearances_are_read_as_nothing() {
    let soup = [[[-1.0, -1.0, -1.0], [1.0, -1.0, -1.0], [0.0, 1.0, -1.0]]];
    let mesh = Mesh::soup(&soup).unwrap();
    let mut material = Material::new("odd", [0.5; 3]);
    material.texture = Some(7);
    let texture = Texture::new("one", 1, 1, vec![[255; 4]]).unwrap();
    let appearance = Appearance {
        materials: &[material],
        material_of: &[9],
        lights: &[],
        textures: &[texture],
        normals: &[[f32::NAN, 0.0, 1.0]],
        normal_indices: &[[0, 5, u32::MAX]],
        texcoords: &[[f32::INFINITY, 0.0]],
        texcoord_indices: &[[0, 5, u32::MAX]],
        environment: None,
    };
    let data = SceneData::new(&mesh, &appearance).unwrap();
    assert!(!data.needs().textures && data.needs().smooth_normals);
    assert_eq!(data.triangles(), 1);
    let world = World { triangles: soup.to_vec(), ..World::default() };
    let size = Size::new(3, 3).unwrap();
    let shot = shoot(&world, along_z([0.0; 3], size, 0.5), size, &RenderSettings::default());
    assert!(shot.at(1, 1)[0] > 0.0);
}
