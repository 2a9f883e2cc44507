//! Scenes: triangles with materials, a camera and lights, from files or made here.

#![forbid(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]

mod angle;
#[cfg(feature = "animation")]
pub mod animation;
#[cfg(feature = "obj")]
mod budget;
pub mod builtin;
mod camera;
#[cfg(feature = "environment")]
pub mod environment;
#[cfg(feature = "obj")]
#[doc(hidden)]
pub mod from_file;
#[cfg(feature = "gltf")]
pub mod gltf;
pub mod instanced;
#[cfg(any(feature = "gltf", feature = "ply", feature = "stl"))]
mod mesh_file;
mod normals;
#[cfg(feature = "obj")]
#[doc(hidden)]
pub mod npy;
#[cfg(feature = "obj")]
pub mod obj;
mod open;
mod options;
mod placement;
#[cfg(feature = "ply")]
pub mod ply;
#[cfg(feature = "stl")]
pub mod stl;
#[doc(hidden)]
pub mod surface;

#[cfg(feature = "animation")]
pub use animation::{Animation, AnimationError, Change};
pub use camera::{Camera, CameraError};
pub use instanced::InstancedScene;
#[cfg(any(feature = "gltf", feature = "ply", feature = "stl"))]
pub use mesh_file::{MeshFileError, MeshFileProblem, Place};
pub use options::{MaterialRule, SceneOptions};
pub use placement::{Placement, View};
pub use splitplane_render::{Dielectric, EnvironmentMap, Light, Material, Texture};

use splitplane_core::aabb::Aabb;
use splitplane_core::mesh::{Mesh, MeshError};
use splitplane_float_state::Standard;
#[cfg(feature = "json")]
use std::collections::HashMap;
use std::ffi::OsStr;
#[cfg(feature = "obj")]
use std::path::Path;
use std::sync::Arc;
use thiserror::Error;

/// Triangles with materials, and from where to look at them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The file's name without its folder, or `builtin:NAME`.
    pub name: String,
    /// Vertex positions, in the order of the file.
    pub positions: Vec<[f32; 3]>,
    /// Corners of every triangle, as indices of `positions`, in the order of the file.
    pub indices: Vec<[u32; 3]>,
    /// Unit normals; those of a scene from a file are in the order of the file, and one that the
    /// file gives without a direction is as it stands there, and used by no corner.
    pub normals: Vec<[f32; 3]>,
    /// The normals at the corners of every triangle, as indices of `normals`, [`Scene::NONE`] for a
    /// corner without one. Empty when no corner has one, else in step with `indices`.
    pub normal_indices: Vec<[u32; 3]>,
    /// Texture coordinates, (0, 0) being the lower left corner of a texture.
    pub texcoords: Vec<[f32; 2]>,
    /// The texture coordinates at the corners of every triangle, as indices of `texcoords`, by the
    /// rules of `normal_indices`.
    pub texcoord_indices: Vec<[u32; 3]>,
    /// For every triangle, the index of its material.
    pub material_of: Vec<u32>,
    /// The materials; never empty when there are triangles.
    pub materials: Vec<Material>,
    /// The pictures that materials name by index.
    pub textures: Vec<Texture>,
    /// For every material, by its place, the picture that says where its surfaces have holes, as an index of `textures`. Empty where none has, and
    /// where it was not read. A mesh shows no holes; scenes of many objects make [opacity masks](splitplane_core::scene::OpacityMask)
    /// of them: [`InstancedScene::cut_out`](instanced::InstancedScene::cut_out).
    pub cutouts: Vec<Option<u32>>,
    /// Where the groups and objects of a file begin, in the order of its triangles.
    pub groups: Vec<Group>,
    /// The view the scene was made for; files have none, see [`Placement::of`].
    pub camera: Option<Camera>,
    /// Its lights, in addition to surfaces that shine; files have none, see [`Placement::of`].
    pub lights: Vec<Light>,
    /// Light from everywhere as a picture, in place of the one that [`RenderSettings`](splitplane_render::RenderSettings) have; only scene files of many
    /// objects have one.
    pub environment: Option<Arc<EnvironmentMap>>,
    /// What was left out or looked odd while reading.
    pub notes: Notes,
}

/// The triangles of an .obj file from here on are in these groups, or of this object, until the next of the kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// Whether this begins an object (`o`), of which a triangle has one; else groups (`g`), of which it may have many.
    pub is_object: bool,
    /// The name of the object, or the names of the groups with space between.
    pub name: String,
    /// The first of these triangles.
    pub first_triangle: u32,
}

/// What a reader left out or found odd. Nothing is dropped without being counted here.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Notes {
    /// Points, lines and faces of fewer than three corners, which have no area to hit.
    pub skipped_elements: u64,
    /// Free-form curves and surfaces, which are not supported.
    pub skipped_freeform: u64,
    /// Vertices with a coordinate that is NaN or infinite; triangles that use one cannot be hit.
    pub non_finite_vertices: u64,
    /// Normals that are zero or not finite; corners that name one have no normal.
    pub unusable_normals: u64,
    /// Texture coordinates that are not finite; corners that name one have none.
    pub unusable_texcoords: u64,
    /// Textures left out because decoding them takes more than [`SceneOptions::decode_limit`]; a warning
    /// names each.
    pub textures_over_limit: u64,
    /// Whatever else a reader should know, a sentence each.
    pub warnings: Vec<String>,
}

impl Notes {
    /// Everything as sentences; empty when there is nothing to say.
    pub fn sentences(&self) -> Vec<String> {
        let counted = [
            (self.skipped_elements, "points, lines or faces of fewer than three corners skipped"),
            (self.skipped_freeform, "lines of free-form curves or surfaces skipped"),
            (self.non_finite_vertices, "vertices are not finite; their triangles cannot be hit"),
            (self.unusable_normals, "normals are zero or not finite; their corners have none"),
            (
                self.unusable_texcoords,
                "texture coordinates are not finite; their corners have none",
            ),
        ];
        let counts = counted.iter().filter(|(count, _)| *count > 0);
        counts.map(|(count, what)| format!("{count} {what}")).chain(self.warnings.clone()).collect()
    }
}

/// Endings of other files that this build reads.
const FORMATS: &str = match (cfg!(feature = "gltf"), cfg!(feature = "ply"), cfg!(feature = "stl")) {
    (true, true, true) => ".ply, .stl, .gltf, .glb",
    (true, true, false) => ".ply, .gltf, .glb",
    (true, false, true) => ".stl, .gltf, .glb",
    (true, false, false) => ".gltf, .glb",
    (false, true, true) => ".ply, .stl",
    (false, true, false) => ".ply",
    (false, false, true) => ".stl",
    (false, false, false) => "none in this build",
};

/// Why there is no scene.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// An OBJ file that cannot be read.
    #[cfg(feature = "obj")]
    #[error(transparent)]
    Obj(#[from] obj::ObjError),
    /// A file of a mesh in another format that cannot be read.
    #[cfg(any(feature = "gltf", feature = "ply", feature = "stl"))]
    #[error(transparent)]
    MeshFile(#[from] MeshFileError),
    /// A built-in scene that does not exist, or a size it cannot have.
    #[error(transparent)]
    Builtin(#[from] builtin::BuiltinError),
    /// A scene file that cannot be read.
    #[cfg(feature = "json")]
    #[error(transparent)]
    File(#[from] instanced::SceneFileError),
    /// A file of many objects, where one mesh was asked for.
    #[error(
        "`{0}` is a scene of many objects, and one mesh is asked for; render, animate, view, build, query and verify take such \
         scenes"
    )]
    ManyObjects(String),
    /// A file that is not of a known format.
    #[error(
        "`{0}` is neither a .obj file nor of another format that is read ({formats}), nor a built-in scene; the built-in ones are {names}",
        formats = FORMATS,
        names = builtin::names()
    )]
    UnknownFormat(String),
}

/// Enough of a name for a message.
fn quoted_name(name: &str) -> String {
    #[cfg(feature = "obj")]
    return from_file::quoted(name);
    #[cfg(not(feature = "obj"))]
    name.to_owned()
}

/// A scene as a user names it, for a message.
fn quoted_spec(spec: &OsStr) -> String {
    #[cfg(feature = "obj")]
    return from_file::quoted_path(spec);
    #[cfg(not(feature = "obj"))]
    spec.to_string_lossy().into_owned()
}

impl Scene {
    /// The index of a normal or a texture coordinate at a corner that has none.
    pub const NONE: u32 = u32::MAX;

    /// Opens a scene by what a user writes: the path of an .obj file, of a .ply, .stl, .gltf or .glb file where the features of
    /// those names are on, or `builtin:NAME[:SIZE]`. The instances of a glTF file are one mesh in the world, in the first frame. A path
    /// need not be UTF-8.
    ///
    /// # Errors
    /// There is no such scene, or its file is broken.
    pub fn open(spec: impl AsRef<OsStr>) -> Result<Scene, SceneError> {
        Scene::open_with(spec, &SceneOptions::default())
    }

    /// As [`Scene::open`], with a say in how files are read; built-in scenes are as they are.
    ///
    /// # Errors
    /// There is no such scene, or its file is broken.
    pub fn open_with(spec: impl AsRef<OsStr>, options: &SceneOptions) -> Result<Scene, SceneError> {
        let _state = Standard::set();
        Scene::open_os(spec.as_ref(), options)
    }

    fn open_os(spec: &OsStr, options: &SceneOptions) -> Result<Scene, SceneError> {
        #[cfg(not(feature = "obj"))]
        let _ = options;
        if let Some(name) = spec.to_str().and_then(|spec| spec.strip_prefix("builtin:")) {
            return Ok(builtin::open(name)?);
        }
        #[cfg(feature = "obj")]
        let path = Path::new(spec);
        #[cfg(feature = "obj")]
        if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("obj")) {
            return Ok(obj::read_with(path, options)?);
        }
        #[cfg(feature = "ply")]
        if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("ply")) {
            return Ok(ply::read(path, options)?);
        }
        #[cfg(feature = "stl")]
        if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("stl")) {
            return Ok(stl::read(path, options)?);
        }
        #[cfg(feature = "gltf")]
        if gltf::is_named_by(path) {
            return Ok(gltf::read_flat(path, options)?);
        }
        #[cfg(feature = "json")]
        if InstancedScene::is_named_by(spec) {
            return Err(SceneError::ManyObjects(quoted_spec(spec)));
        }
        Err(SceneError::UnknownFormat(quoted_spec(spec)))
    }

    /// The triangles, borrowed, as a tree is built over them.
    ///
    /// # Errors
    /// The arrays were changed to something that is not a mesh, or hold too many triangles.
    pub fn mesh(&self) -> Result<Mesh<'_>, MeshError> {
        Mesh::indexed(&self.positions, &self.indices)
    }

    /// What the scene looks like, borrowed.
    pub fn appearance(&self) -> splitplane_render::Appearance<'_> {
        splitplane_render::Appearance {
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

    /// The least box that holds every triangle with finite corners; empty when there is none.
    pub fn bounds(&self) -> Aabb {
        let _state = Standard::set();
        self.triangles().fold(Aabb::EMPTY, |bounds, corners| {
            if corners.as_flattened().iter().all(|x| x.is_finite()) {
                bounds.union(&Aabb::of_points(&corners))
            } else {
                bounds
            }
        })
    }

    /// The corners of every triangle whose indices exist.
    pub fn triangles(&self) -> impl Iterator<Item = [[f32; 3]; 3]> + '_ {
        let position = |vertex: u32| self.positions.get(vertex as usize).copied();
        self.indices.iter().filter_map(move |corners| {
            let [a, b, c] = corners.map(position);
            Some([a?, b?, c?])
        })
    }

    /// The corners of a triangle; `None` when there is no such triangle, or it names a vertex that
    /// does not exist.
    pub fn corners(&self, triangle: u32) -> Option<[[f32; 3]; 3]> {
        let position = |vertex: u32| self.positions.get(vertex as usize).copied();
        let [a, b, c] = self.indices.get(triangle as usize)?.map(position);
        Some([a?, b?, c?])
    }

    /// The triangles of a group, or of an object, in runs. Empty where no triangle is in it.
    pub fn triangles_of(&self, is_object: bool, name: &str) -> Vec<std::ops::Range<u32>> {
        let starts: Vec<&Group> =
            self.groups.iter().filter(|group| group.is_object == is_object).collect();
        let ends = starts.iter().skip(1).map(|group| group.first_triangle);
        let ends = ends.chain([self.indices.len() as u32]);
        let is_named = |group: &Group| {
            let words = || group.name.split_ascii_whitespace();
            group.name == name || (!is_object && words().any(|word| word == name))
        };
        let runs = starts.iter().zip(ends).filter(|(group, _)| is_named(group));
        let runs = runs.map(|(group, end)| group.first_triangle..end);
        runs.filter(|run| !run.is_empty()).collect()
    }

    /// The triangles of all groups and objects by whether it is an object and its name: what [`Scene::triangles_of`] gives of each, for who asks
    /// for many.
    #[cfg(feature = "json")]
    fn triangles_by_group(&self) -> HashMap<(bool, &str), Vec<std::ops::Range<u32>>> {
        let mut all: HashMap<(bool, &str), Vec<std::ops::Range<u32>>> = HashMap::new();
        for is_object in [false, true] {
            let starts: Vec<&Group> =
                self.groups.iter().filter(|group| group.is_object == is_object).collect();
            let ends = starts.iter().skip(1).map(|group| group.first_triangle);
            for (group, end) in starts.iter().zip(ends.chain([self.indices.len() as u32])) {
                let run = group.first_triangle..end;
                if run.is_empty() {
                    continue;
                }
                let words = group.name.split_ascii_whitespace().filter(|_| !is_object);
                for name in words.chain([group.name.as_str()]) {
                    let runs = all.entry((is_object, name)).or_default();
                    // A name that is given twice, or is the only word.
                    if runs.last() != Some(&run) {
                        runs.push(run.clone());
                    }
                }
            }
        }
        all
    }

    /// Whether its environment is a map that shines.
    fn has_sky(&self) -> bool {
        self.environment.as_ref().is_some_and(|map| map.shines())
    }

    /// Whether the scene brings light: lights of its own, triangles that shine, or an environment map that does.
    pub fn is_lit(&self) -> bool {
        let shines = |material: &u32| {
            self.materials.get(*material as usize).is_some_and(|material| material.shines())
        };
        !self.lights.is_empty() || self.has_sky() || self.material_of.iter().any(shines)
    }

    /// The material of a triangle; clay where there is none.
    pub fn material(&self, triangle: usize) -> Material {
        let index = self.material_of.get(triangle);
        index.and_then(|&m| self.materials.get(m as usize)).cloned().unwrap_or_else(Material::clay)
    }
}
