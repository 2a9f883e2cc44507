//! Small scenes with every kind of surface and light, of any size.

use splitplane_core::mesh::Mesh;
use splitplane_core::ray::QueryOptions;
use splitplane_render::{
    Appearance, FrameInput, Light, Material, Outputs, Pinhole, RenderSettings, SceneData, Size,
    Texture,
};

/// A scene and how it is seen.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    pub name: &'static str,
    pub triangles: Vec<[[f32; 3]; 3]>,
    pub material_of: Vec<u32>,
    pub materials: Vec<Material>,
    pub lights: Vec<Light>,
    pub textures: Vec<Texture>,
    /// Of the corners; none where empty.
    pub normals: Vec<[f32; 3]>,
    pub texcoords: Vec<[f32; 2]>,
    pub settings: RenderSettings,
    pub eye: [f32; 3],
    pub scale: f32,
    pub outputs: Outputs,
    pub query: QueryOptions<'static>,
    pub size: [u32; 2],
}

/// All that can be asked for.
pub(crate) const EVERYTHING: Outputs =
    Outputs { pixels: true, radiance: true, first_hits: true, first_costs: true };

impl Scene {
    fn new(name: &'static str) -> Scene {
        Scene {
            name,
            triangles: Vec::new(),
            material_of: Vec::new(),
            materials: Vec::new(),
            lights: Vec::new(),
            textures: Vec::new(),
            normals: Vec::new(),
            texcoords: Vec::new(),
            settings: RenderSettings::default(),
            eye: [0.3, 1.1, 4.0],
            scale: 1.0,
            outputs: EVERYTHING,
            query: QueryOptions::default(),
            size: [24, 16],
        }
    }

    pub(crate) fn mesh(&self) -> Mesh<'_> {
        Mesh::soup(&self.triangles).expect("not too many triangles")
    }

    /// The appearance, with a normal and a texture coordinate for every corner where there are any.
    pub(crate) fn data(&self) -> SceneData {
        self.with_appearance(|appearance| {
            SceneData::new(&self.mesh(), appearance).expect("not too many words")
        })
    }

    /// Gives an appearance that was described before the normals that the scene has now.
    pub(crate) fn update_normals(&self, data: &mut SceneData) {
        self.with_appearance(|appearance| data.update_normals(&self.mesh(), appearance));
    }

    pub(crate) fn with_appearance<T>(&self, run: impl FnOnce(&Appearance<'_>) -> T) -> T {
        let corners = |any: bool| -> Vec<[u32; 3]> {
            let count = if any { self.triangles.len() as u32 } else { 0 };
            (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect()
        };
        let normal_indices = corners(!self.normals.is_empty());
        let texcoord_indices = corners(!self.texcoords.is_empty());
        let appearance = Appearance {
            materials: &self.materials,
            material_of: &self.material_of,
            lights: &self.lights,
            textures: &self.textures,
            normals: &self.normals,
            normal_indices: &normal_indices,
            texcoords: &self.texcoords,
            texcoord_indices: &texcoord_indices,
            environment: None,
        };
        run(&appearance)
    }

    /// The frame of an appearance that was described before.
    pub(crate) fn input<'a>(&'a self, data: &'a SceneData) -> FrameInput<'a> {
        let size = Size::new(self.size[0], self.size[1]).expect("a size");
        FrameInput {
            mesh: self.mesh(),
            scene: data,
            camera: self.camera(),
            size,
            settings: &self.settings,
            outputs: self.outputs,
            query: self.query,
        }
    }

    /// Looks from the eye along -z, a little down.
    fn camera(&self) -> Pinhole {
        let [width, height] = self.size.map(|side| side as f32);
        Pinhole {
            eye: self.eye.map(|part| part * self.scale),
            corner: [-0.5 * width / height, 0.3, -1.0],
            step_x: [1.0 / height, 0.0, 0.0],
            step_y: [0.0, -1.0 / height, 0.0],
        }
    }

    fn triangle(&mut self, corners: [[f32; 3]; 3], material: u32) {
        self.triangles.push(corners);
        self.material_of.push(material);
    }

    fn quad(&mut self, a: [f32; 3], b: [f32; 3], c: [f32; 3], material: u32) {
        let d = [0, 1, 2].map(|i| a[i] + c[i] - b[i]);
        self.triangle([a, b, c], material);
        self.triangle([a, c, d], material);
    }

    /// A ball of a few flat triangles.
    fn ball(&mut self, centre: [f32; 3], radius: f32, rings: u32, material: u32) {
        let point = |ring: u32, segment: u32| -> [f32; 3] {
            let polar = std::f32::consts::PI * ring as f32 / rings as f32;
            let around = std::f32::consts::PI * segment as f32 / rings as f32;
            let unit = [polar.sin() * around.cos(), polar.cos(), -polar.sin() * around.sin()];
            [0, 1, 2].map(|i| centre[i] + radius * unit[i])
        };
        for ring in 0..rings {
            for segment in 0..2 * rings {
                let [a, b] = [point(ring, segment), point(ring + 1, segment)];
                let [d, c] = [point(ring, segment + 1), point(ring + 1, segment + 1)];
                if ring + 1 < rings {
                    self.triangle([a, b, c], material);
                }
                if ring > 0 {
                    self.triangle([a, c, d], material);
                }
            }
        }
    }

    fn point_light(&mut self, position: [f32; 3]) {
        let irradiance = [2.0, 1.8, 1.5];
        self.lights.push(Light::Point { position, irradiance, distance: 2.0 });
    }

    fn sun(&mut self) {
        self.lights.push(Light::Directional { towards: [0.4, 1.0, 0.6], irradiance: [1.0; 3] });
    }

    /// The same scene, larger or smaller.
    pub(crate) fn scaled(mut self, name: &'static str, factor: f32) -> Scene {
        self.name = name;
        self.scale *= factor;
        for x in self.triangles.as_flattened_mut().as_flattened_mut() {
            *x *= factor;
        }
        for light in &mut self.lights {
            if let Light::Point { position, distance, .. } = light {
                *position = position.map(|part| part * factor);
                *distance *= factor;
            }
        }
        self
    }

    pub(crate) fn with_samples(mut self, name: &'static str, samples: u32) -> Scene {
        self.name = name;
        self.settings.samples = samples;
        self
    }
}

const FLOOR: u32 = 0;
const BALL: u32 = 1;

/// A floor, a wall and two balls.
fn base(name: &'static str, ball: Material) -> Scene {
    let mut scene = Scene::new(name);
    scene.materials = vec![Material::new("floor", [0.7, 0.6, 0.5]), ball];
    scene.quad([-3.0, 0.0, 2.0], [3.0, 0.0, 2.0], [3.0, 0.0, -3.0], FLOOR);
    scene.quad([-3.0, 0.0, -3.0], [3.0, 0.0, -3.0], [3.0, 3.0, -3.0], FLOOR);
    scene.ball([-0.7, 0.6, -0.4], 0.6, 5, BALL);
    scene.ball([0.9, 0.5, 0.3], 0.5, 4, BALL);
    scene
}

pub(crate) fn diffuse() -> Scene {
    let mut scene = base("diffuse", Material::new("ball", [0.3, 0.5, 0.8]));
    scene.point_light([1.5, 2.5, 2.0]);
    scene.sun();
    scene.settings.headlight = 0.2;
    scene
}

pub(crate) fn mirrors() -> Scene {
    let ball = Material::new("ball", [0.1, 0.1, 0.2]).with_mirror([0.8, 0.7, 0.6]);
    let mut scene = base("mirrors", ball);
    scene.materials[0] = Material::new("floor", [0.6; 3]).with_mirror([0.3; 3]);
    scene.point_light([1.5, 2.5, 2.0]);
    scene
}

pub(crate) fn glass() -> Scene {
    let ball = Material::new("ball", [0.0; 3]).with_dielectric(1.5, [0.9, 1.0, 0.8]);
    let mut scene = base("glass", ball);
    scene.point_light([1.5, 2.5, 2.0]);
    scene.sun();
    scene.settings.samples = 2;
    scene
}

pub(crate) fn textures() -> Scene {
    let mut scene = base("textures", Material::new("ball", [0.9; 3]));
    let texels = (0..35u32).map(|i| (i.wrapping_mul(0x9e37_79b9) | 0xff00_0000).to_le_bytes());
    scene.textures.push(Texture::new("noise", 7, 5, texels.collect()).expect("7 by 5 texels"));
    scene.textures.push(Texture::new("one", 1, 1, vec![[200, 100, 50, 255]]).expect("a texel"));
    scene.materials[0].texture = Some(0);
    scene.materials[1].texture = Some(1);
    // Beyond the picture on both sides, and where texels can no longer be told apart.
    let coordinate = |p: &[f32; 3]| [p[0] * 0.7 + 0.1, p[1] - p[2] * 0.9];
    scene.texcoords = scene.triangles.as_flattened().iter().map(coordinate).collect();
    scene.texcoords[0] = [5.0e6, 1.0];
    scene.sun();
    scene
}

pub(crate) fn smooth() -> Scene {
    let ball = Material::new("ball", [0.4; 3]).with_mirror([0.5; 3]);
    let mut scene = base("smooth normals", ball);
    // Of the first ball; of the second none; a floor that is not what it looks like.
    let balls = scene.triangles.iter().zip(&scene.material_of);
    scene.normals = balls
        .flat_map(|(corners, material)| {
            corners.map(|p| match (*material, p[0] < 0.2) {
                (BALL, true) => [p[0] + 0.7, p[1] - 0.6, p[2] + 0.4],
                (BALL, false) => [0.0; 3],
                _ => [0.3 * p[0], 1.0, 0.2],
            })
        })
        .collect();
    scene.point_light([-1.5, 2.5, 2.0]);
    scene
}

pub(crate) fn area_lights() -> Scene {
    let ball = Material::new("ball", [0.5; 3]).with_emission([3.0, 1.0, 0.5]);
    let mut scene = base("area lights", ball);
    scene.materials.push(Material::new("lamp", [0.0; 3]).with_emission([8.0; 3]));
    scene.quad([-0.5, 2.6, 0.5], [-0.5, 2.6, -0.5], [0.5, 2.6, -0.5], 2);
    scene.point_light([1.5, 2.5, 2.0]);
    scene.settings.area_samples = 3;
    scene
}

/// Every kind of surface and light at once.
pub(crate) fn all() -> Scene {
    let mut scene = textures();
    scene.name = "all kinds";
    let normals: Vec<[f32; 3]> = smooth().normals;
    scene.normals = normals;
    scene.materials[0] = scene.materials[0].clone().with_mirror([0.2; 3]);
    scene.materials.push(Material::new("glass", [0.0; 3]).with_dielectric(1.5, [0.9; 3]));
    scene.materials.push(Material::new("lamp", [0.0; 3]).with_emission([6.0; 3]));
    scene.point_light([1.5, 2.5, 2.0]);
    let first = scene.triangles.len();
    scene.ball([0.1, 0.9, 1.2], 0.4, 4, 2);
    scene.quad([-0.5, 2.6, 0.5], [-0.5, 2.6, -0.5], [0.5, 2.6, -0.5], 3);
    for corner in scene.triangles[first..].as_flattened().to_vec() {
        scene.normals.push([corner[0] - 0.1, corner[1] - 0.9, corner[2] - 1.2]);
        scene.texcoords.push([0.0; 2]);
    }
    scene.settings.area_samples = 2;
    scene
}

/// No triangles at all: the backdrop.
pub(crate) fn empty() -> Scene {
    let mut scene = Scene::new("empty");
    scene.materials = vec![Material::clay()];
    scene.sun();
    scene
}

/// Triangles without area: points, needles, and the seams of T-junctions.
pub(crate) fn degenerate() -> Scene {
    let mut scene = base("degenerate", Material::new("ball", [0.4; 3]).with_mirror([0.5; 3]));
    for i in 0..40 {
        let x = i as f32 * 0.05 - 1.0;
        scene.triangle([[x, 0.2, 0.8]; 3], FLOOR);
        scene.triangle([[x, 0.1, 0.8], [x, 0.4, 0.8], [x, 1.3, 0.8]], BALL);
        scene.triangle([[x, 0.1, 0.9], [x, 0.4, 0.9], [x + 1e-6, 1.3, 0.9]], BALL);
        scene.triangle([[f32::NAN, 0.1, 0.9], [x, 0.4, 0.9], [x, 1.3, 0.9]], BALL);
    }
    scene.sun();
    scene
}

/// Every triangle twice, and one that rays ignore.
pub(crate) fn doubled() -> Scene {
    let mut scene = base("doubled", Material::new("ball", [0.4; 3]));
    scene.triangles.extend_from_within(..);
    scene.material_of.extend_from_within(..);
    // A lid under the light, which casts a shadow where it is not ignored.
    scene.query.ignore = Some(scene.triangles.len() as u32);
    scene.triangle([[-3.0, 1.9, 3.0], [3.0, 1.9, 3.0], [0.0, 1.9, -6.0]], BALL);
    scene.point_light([0.5, 2.5, 1.0]);
    scene
}

/// A block of glass plates: a path becomes far more than two.
pub(crate) fn overflowing() -> Scene {
    let mut scene = Scene::new("glass plates");
    scene.materials =
        vec![Material::new("glass", [0.0; 3]).with_dielectric(1.8, [1.0; 3]), Material::clay()];
    for plate in 0..4 {
        let z = -0.5 * plate as f32;
        scene.quad([-6.0, -6.0, z], [6.0, -6.0, z], [6.0, 6.0, z], 0);
    }
    scene.quad([-6.0, -6.0, -3.0], [6.0, -6.0, -3.0], [6.0, 6.0, -3.0], 1);
    scene.point_light([1.0, 2.0, 3.0]);
    scene.settings.minimum_weight = 0.0;
    scene.settings.depth = 3;
    scene.size = [12, 4];
    scene
}
