//! Small scenes, and the frames that they give on the CPU.

#![allow(dead_code, reason = "each test uses a part")]

use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::QueryOptions;
use splitplane_core::tree::digest::Xxh64;
use splitplane_cpu::CpuBackend;
use splitplane_render::cpu::CpuRenderer;
use splitplane_render::{
    Appearance, Environment, EnvironmentMap, FrameInput, FrameStats, Light, Material, Outputs,
    Pinhole, RenderError, RenderSettings, Room, SceneData, Size, Texture,
};
use std::sync::Arc;

pub(crate) type Point = [f32; 3];

/// A scene made in code.
#[derive(Clone, Debug, Default)]
pub(crate) struct World {
    pub triangles: Vec<[Point; 3]>,
    pub material_of: Vec<u32>,
    pub materials: Vec<Material>,
    pub lights: Vec<Light>,
    pub textures: Vec<Texture>,
    pub normals: Vec<Point>,
    pub normal_indices: Vec<[u32; 3]>,
    pub texcoords: Vec<[f32; 2]>,
    pub texcoord_indices: Vec<[u32; 3]>,
    pub environment: Option<Arc<EnvironmentMap>>,
}

impl World {
    /// A quadrilateral whose corners run counter-clockwise seen from its front.
    pub(crate) fn quad(&mut self, material: u32, [a, b, c, d]: [Point; 4]) {
        self.triangles.extend([[a, b, c], [a, c, d]]);
        self.material_of.extend([material; 2]);
    }

    /// A box, seen from outside at its fronts.
    pub(crate) fn block(&mut self, material: u32, lo: Point, hi: Point) {
        let p = |x: usize, y: usize, z: usize| -> Point {
            [[lo[0], hi[0]][x], [lo[1], hi[1]][y], [lo[2], hi[2]][z]]
        };
        self.quad(material, [p(0, 0, 1), p(1, 0, 1), p(1, 1, 1), p(0, 1, 1)]);
        self.quad(material, [p(1, 0, 0), p(0, 0, 0), p(0, 1, 0), p(1, 1, 0)]);
        self.quad(material, [p(1, 0, 1), p(1, 0, 0), p(1, 1, 0), p(1, 1, 1)]);
        self.quad(material, [p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0)]);
        self.quad(material, [p(0, 1, 1), p(1, 1, 1), p(1, 1, 0), p(0, 1, 0)]);
        self.quad(material, [p(0, 0, 0), p(1, 0, 0), p(1, 0, 1), p(0, 0, 1)]);
    }

    /// The plane y = `height`, seen from above, from -`half` to `half`.
    pub(crate) fn floor(&mut self, material: u32, height: f32, half: f32) {
        let (h, y) = (half, height);
        self.quad(material, [[-h, y, h], [h, y, h], [h, y, -h], [-h, y, -h]]);
    }

    pub(crate) fn data(&self) -> SceneData {
        SceneData::new(&Mesh::soup(&self.triangles).unwrap(), &self.appearance()).unwrap()
    }

    pub(crate) fn appearance(&self) -> Appearance<'_> {
        Appearance {
            materials: &self.materials,
            material_of: &self.material_of,
            lights: &self.lights,
            textures: &self.textures,
            normals: &self.normals,
            normal_indices: &self.normal_indices,
            texcoords: &self.texcoords,
            texcoord_indices: &self.texcoord_indices,
            environment: self.environment.as_ref(),
        }
    }
}

/// Light that leaves nothing to the surroundings.
pub(crate) fn dark() -> RenderSettings {
    RenderSettings { environment: Environment::BLACK, ambient: 0.0, ..RenderSettings::default() }
}

/// A camera that looks along -z, `tan` being half the height of the picture at distance 1.
pub(crate) fn along_z(eye: Point, size: Size, tan: f32) -> Pinhole {
    let (w, h) = (size.width() as f32, size.height() as f32);
    let step = 2.0 * tan / h;
    Pinhole {
        eye,
        corner: [-0.5 * w * step, tan, -1.0],
        step_x: [step, 0.0, 0.0],
        step_y: [0.0, -step, 0.0],
    }
}

/// A camera that looks straight down; the picture's right is +x, its top -z.
pub(crate) fn downwards(eye: Point, size: Size, tan: f32) -> Pinhole {
    let (w, h) = (size.width() as f32, size.height() as f32);
    let step = 2.0 * tan / h;
    Pinhole {
        eye,
        corner: [-0.5 * w * step, -1.0, -tan],
        step_x: [step, 0.0, 0.0],
        step_y: [0.0, 0.0, step],
    }
}

/// A frame with all that it gives.
pub(crate) struct Shot {
    pub stats: FrameStats,
    pub renderer: CpuRenderer,
    pub size: Size,
}

impl Shot {
    /// Linear radiance of a pixel.
    pub(crate) fn at(&self, x: u32, y: u32) -> Point {
        let [r, g, b, unfinished] = self.renderer.radiance()[(y * self.size.width() + x) as usize];
        assert_eq!(unfinished, 0.0);
        [r, g, b]
    }
}

pub(crate) const ALL: Outputs =
    Outputs { pixels: true, radiance: true, first_hits: true, first_costs: true };

pub(crate) fn shoot(world: &World, camera: Pinhole, size: Size, settings: &RenderSettings) -> Shot {
    try_shoot(world, camera, size, settings, Room::CPU).unwrap()
}

pub(crate) fn try_shoot(
    world: &World,
    camera: Pinhole,
    size: Size,
    settings: &RenderSettings,
    room: Room,
) -> Result<Shot, RenderError> {
    let mesh = Mesh::soup(&world.triangles).unwrap();
    let accelerator = CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).unwrap();
    let scene = world.data();
    let mut renderer = CpuRenderer::with_room(room);
    let input = FrameInput {
        mesh,
        scene: &scene,
        camera,
        size,
        settings,
        outputs: ALL,
        query: QueryOptions::default(),
    };
    let stats = renderer.render(&accelerator, &input)?;
    Ok(Shot { stats, renderer, size })
}

/// Whether two numbers agree to a part of the greater one.
#[track_caller]
pub(crate) fn near(got: f32, expected: f64, part: f64) {
    let error = (f64::from(got) - expected).abs();
    assert!(error <= part * expected.abs().max(1e-9), "{got} in place of {expected}");
}

/// A ball around a point, tessellated: `inwards`, its fronts are seen from within.
pub(crate) fn ball(world: &mut World, material: u32, centre: Point, radius: f32, inwards: bool) {
    let (rows, columns) = (24, 48);
    let at = |row: i32, column: i32| -> Point {
        let up = std::f64::consts::PI * f64::from(row) / f64::from(rows);
        let around = std::f64::consts::TAU * f64::from(column % columns) / f64::from(columns);
        let (sin, r) = (up.sin(), f64::from(radius));
        let unit = [sin * around.cos(), up.cos(), sin * around.sin()];
        std::array::from_fn(|k| (f64::from(centre[k]) + r * unit[k]) as f32)
    };
    for row in 0..rows {
        for column in 0..columns {
            let quad = [
                at(row, column),
                at(row, column + 1),
                at(row + 1, column + 1),
                at(row + 1, column),
            ];
            let [a, b, c, d] = if inwards { [quad[3], quad[2], quad[1], quad[0]] } else { quad };
            let mut put = |triangle: [Point; 3]| {
                if triangle[0] != triangle[1]
                    && triangle[1] != triangle[2]
                    && triangle[0] != triangle[2]
                {
                    world.triangles.push(triangle);
                    world.material_of.push(material);
                }
            };
            put([a, b, c]);
            put([a, c, d]);
        }
    }
}

/// The mean radiance of the picture.
pub(crate) fn mean(shot: &Shot) -> [f64; 3] {
    let pixels = shot.renderer.radiance();
    std::array::from_fn(|channel| {
        pixels.iter().map(|pixel| f64::from(pixel[channel])).sum::<f64>() / pixels.len() as f64
    })
}

/// A room of Cornell's kind, shone on by a square in its ceiling: white but for a red and a green wall, a block inside, open to
/// the front where the camera stands.
pub(crate) fn cornell() -> World {
    let mut world = World {
        materials: vec![
            Material::new("white", [0.73, 0.71, 0.68]),
            Material::new("red", [0.63, 0.065, 0.05]),
            Material::new("green", [0.14, 0.45, 0.091]),
            Material::new("lamp", [0.0; 3]).with_emission([12.0, 9.0, 6.0]),
        ],
        ..World::default()
    };
    let (l, h) = (-1.0, 1.0);
    world.quad(0, [[l, l, h], [h, l, h], [h, l, l], [l, l, l]]);
    world.quad(0, [[l, h, l], [h, h, l], [h, h, h], [l, h, h]]);
    world.quad(0, [[l, l, l], [h, l, l], [h, h, l], [l, h, l]]);
    world.quad(1, [[l, l, h], [l, l, l], [l, h, l], [l, h, h]]);
    world.quad(2, [[h, l, l], [h, l, h], [h, h, h], [h, h, l]]);
    let (s, y) = (0.3, 0.999);
    world.quad(3, [[-s, y, -s], [s, y, -s], [s, y, s], [-s, y, s]]);
    world.block(0, [-0.5, -0.999, -0.5], [0.1, -0.2, 0.1]);
    world
}

/// The camera of [`cornell`].
pub(crate) fn cornell_camera(size: Size) -> Pinhole {
    along_z([0.0, 0.0, 3.7], size, 0.36)
}

/// A room with all kinds of lights and surfaces, open to the front.
pub(crate) fn everything() -> World {
    let mut world = cornell();
    world.materials.extend([
        Material::new("glass", [0.0; 3]).with_dielectric(1.5, [0.9; 3]),
        Material::new("metal", [0.1; 3]).with_mirror([0.7, 0.6, 0.5]).with_roughness(0.3),
    ]);
    ball(&mut world, 4, [0.5, -0.4, 0.4], 0.3, false);
    world.block(5, [0.4, -0.999, -0.8], [0.8, -0.1, -0.4]);
    world.lights = vec![
        Light::Point { position: [0.7, 0.5, 0.7], irradiance: [1.0, 0.5, 2.0], distance: 1.0 },
        Light::Point { position: [0.0, 3.0, 9.0], irradiance: [2.0; 3], distance: 9.0 },
        Light::Directional { towards: [1.0, 2.0, 5.0], irradiance: [1.0, 2.0, 1.0] },
    ];
    world
}

/// XXH64 of the radiance.
pub(crate) fn digest(radiance: &[[f32; 4]]) -> u64 {
    let mut hash = Xxh64::new(0);
    for pixel in radiance {
        hash.write_words(&pixel.map(f32::to_bits));
    }
    hash.finish()
}
