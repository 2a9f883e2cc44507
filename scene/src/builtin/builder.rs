//! Puts triangles together. Sides are counter-clockwise seen from outside.

use crate::angle::sin_cos;
use crate::{Camera, Light, Material, Scene, Texture, normals};

/// A point; rounded to f32 once, when it becomes a vertex.
pub(super) type Point = [f64; 3];

/// A scene under construction.
#[derive(Default)]
pub(super) struct Builder {
    scene: Scene,
}

/// Where a part of a scene begins.
#[derive(Clone, Copy)]
pub(super) struct Mark {
    pub(super) vertex: usize,
    pub(super) triangle: usize,
}

/// A box by its lower and upper corner.
#[derive(Clone, Copy)]
pub(super) struct Block {
    pub(super) lo: Point,
    pub(super) hi: Point,
}

impl Builder {
    pub(super) fn new(name: &str) -> Builder {
        Builder { scene: Scene { name: format!("builtin:{name}"), ..Scene::default() } }
    }

    pub(super) fn finish(mut self) -> Scene {
        let triangles = self.scene.indices.len();
        let Scene { normal_indices, texcoord_indices, .. } = &mut self.scene;
        for corners in [normal_indices, texcoord_indices] {
            if !corners.is_empty() {
                corners.resize(triangles, [Scene::NONE; 3]);
            }
        }
        self.scene
    }

    pub(super) fn triangles(&self) -> usize {
        self.scene.indices.len()
    }

    pub(super) fn material(&mut self, name: &str, diffuse: [f32; 3]) -> u32 {
        self.add_material(Material::new(name, diffuse))
    }

    pub(super) fn add_material(&mut self, material: Material) -> u32 {
        self.scene.materials.push(material);
        self.scene.materials.len() as u32 - 1
    }

    /// A diffuse material under a texture.
    pub(super) fn textured(&mut self, name: &str, texture: Option<Texture>) -> u32 {
        let index = self.scene.textures.len() as u32;
        let texture = texture.map(|texture| {
            self.scene.textures.push(texture);
            index
        });
        self.add_material(Material { texture, ..Material::new(name, [1.0; 3]) })
    }

    /// Places reached so far, for what is done to a part afterwards.
    pub(super) fn mark(&self) -> Mark {
        Mark { vertex: self.scene.positions.len(), triangle: self.scene.indices.len() }
    }

    pub(super) fn vertex(&mut self, point: Point) -> u32 {
        self.scene.positions.push(point.map(|x| x as f32));
        self.scene.positions.len() as u32 - 1
    }

    pub(super) fn triangle(&mut self, material: u32, corners: [u32; 3]) {
        self.scene.indices.push(corners);
        self.scene.material_of.push(material);
    }

    /// Two triangles over four vertices that run around.
    pub(super) fn join(&mut self, material: u32, [a, b, c, d]: [u32; 4]) {
        self.triangle(material, [a, b, c]);
        self.triangle(material, [a, c, d]);
    }

    /// Two triangles over four points that run around.
    pub(super) fn quad(&mut self, material: u32, corners: [Point; 4]) {
        let corners = corners.map(|point| self.vertex(point));
        self.join(material, corners);
    }

    /// The sides of a box around, and its top; the bottom too if asked for.
    pub(super) fn block(&mut self, sides: u32, top: u32, Block { lo, hi }: Block, bottom: bool) {
        let corner = |i: usize| -> Point {
            [[lo[0], hi[0]][i & 1], [lo[1], hi[1]][i >> 1 & 1], [lo[2], hi[2]][i >> 2 & 1]]
        };
        let v: [u32; 8] = std::array::from_fn(|i| self.vertex(corner(i)));
        for around in [[4, 5, 7, 6], [1, 0, 2, 3], [5, 1, 3, 7], [0, 4, 6, 2]] {
            self.join(sides, around.map(|i: usize| v[i]));
        }
        self.join(top, [6, 7, 3, 2].map(|i: usize| v[i]));
        if bottom {
            self.join(sides, [0, 1, 5, 4].map(|i: usize| v[i]));
        }
    }

    /// A closed sphere of `rings` by `2 * rings` patches: `4 * rings * (rings - 1)` triangles.
    pub(super) fn sphere(&mut self, material: u32, centre: Point, radius: f64, rings: u32) {
        let around = 2 * rings;
        let north = self.vertex([centre[0], centre[1] + radius, centre[2]]);
        let mut above = vec![north; around as usize];
        for ring in 1..rings {
            let (sin, cos) = sin_cos(0.5 * f64::from(ring) / f64::from(rings));
            let row: Vec<u32> = (0..around)
                .map(|i| {
                    let (z, x) = sin_cos(f64::from(i) / f64::from(around));
                    let offset = [x * sin, cos, z * sin];
                    self.vertex(std::array::from_fn(|k| centre[k] + radius * offset[k]))
                })
                .collect();
            self.band(material, &above, &row);
            above = row;
        }
        let south = self.vertex([centre[0], centre[1] - radius, centre[2]]);
        self.band(material, &above, &vec![south; around as usize]);
    }

    /// A sphere as [`Builder::sphere`] makes it, with the normals of a true one.
    pub(super) fn round_sphere(&mut self, material: u32, centre: Point, radius: f64, rings: u32) {
        let start = self.mark();
        self.sphere(material, centre, radius, rings);
        self.give_normals(start, |point| {
            let offset: Point = std::array::from_fn(|k| f64::from(point[k]) - centre[k]);
            unit(offset).map(|x| x as f32)
        });
    }

    /// Sets the normals of the part since `start` from its triangles, one per vertex.
    pub(super) fn smooth(&mut self, start: Mark) {
        self.give_normals(start, |_| [0.0, 1.0, 0.0]);
        normals::smooth(&mut self.scene, start.triangle, &mut Vec::new());
    }

    /// Moves every vertex since `start`.
    pub(super) fn reshape(&mut self, start: Mark, to: impl Fn(Point) -> Point) {
        for point in &mut self.scene.positions[start.vertex..] {
            *point = to(point.map(f64::from)).map(|x| x as f32);
        }
    }

    /// Adds a light.
    pub(super) fn shine(&mut self, light: Light) {
        self.scene.lights.push(light);
    }

    /// Gives every vertex since `start` a normal, and the triangles since use them.
    fn give_normals(&mut self, start: Mark, normal: impl Fn([f32; 3]) -> [f32; 3]) {
        let scene = &mut self.scene;
        let shift = |vertex: u32| vertex - start.vertex as u32 + scene.normals.len() as u32;
        scene.normal_indices.resize(start.triangle, [Scene::NONE; 3]);
        let corners = scene.indices[start.triangle..].iter().map(|corners| corners.map(shift));
        scene.normal_indices.extend(corners);
        scene.normals.extend(scene.positions[start.vertex..].iter().map(|&point| normal(point)));
    }

    /// Sets the texture coordinates of the corners since `start` by their positions.
    pub(super) fn give_texcoords(&mut self, start: Mark, of: impl Fn([f32; 3]) -> [f32; 2]) {
        let scene = &mut self.scene;
        let shift = |vertex: u32| vertex - start.vertex as u32 + scene.texcoords.len() as u32;
        scene.texcoord_indices.resize(start.triangle, [Scene::NONE; 3]);
        let corners = scene.indices[start.triangle..].iter().map(|corners| corners.map(shift));
        scene.texcoord_indices.extend(corners);
        scene.texcoords.extend(scene.positions[start.vertex..].iter().map(|&point| of(point)));
    }

    /// Triangles between two rings of equal length, the first above the second; where a ring is one
    /// and the same vertex, only the triangle that is not flat.
    pub(super) fn band(&mut self, material: u32, above: &[u32], below: &[u32]) {
        let next = |i: usize| (i + 1) % above.len();
        for i in 0..above.len() {
            let [a, b, c, d] = [above[i], above[next(i)], below[next(i)], below[i]];
            if a != b {
                self.triangle(material, [a, b, c]);
            }
            if c != d {
                self.triangle(material, [a, c, d]);
            }
        }
    }

    /// The view the scene is made for.
    pub(super) fn look(&mut self, eye: [f32; 3], at: [f32; 3], fov: f32) {
        self.scene.camera = Camera::new(eye, at, [0.0, 1.0, 0.0], fov).ok();
    }

    /// A point light that lights `at` as the daylight of scenes without lights does.
    pub(super) fn light(&mut self, position: [f32; 3], at: [f32; 3]) {
        self.scene.lights.push(Light::point_for(position, at, Light::DAYLIGHT));
    }
}

pub(super) fn unit(a: Point) -> Point {
    let length = (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt();
    a.map(|x| x / length)
}
