//! Scenes of many objects: geometries, instances of them, and how they move.

mod baked;
mod boxes;
mod cutout;
#[cfg(feature = "json")]
mod file;
#[cfg(feature = "gltf")]
mod flat;
#[cfg(any(feature = "gltf", feature = "json"))]
mod part;
mod pose;
#[cfg(feature = "json")]
mod saved;

pub use baked::Baked;
#[cfg(feature = "json")]
pub use file::{MAX_FRAMES, MAX_INSTANCES, SceneFileError, SceneFileProblem, VERSION, parse, read};
pub use pose::{Key, Pose};
#[cfg(feature = "json")]
pub use saved::read_saved;

use super::{Placement, Scene, placement};
use splitplane_core::mesh::{Mesh, MeshError};
use splitplane_core::ray::Culling;
use splitplane_core::scene::shape::{Capsule, Shapes, Sphere};
use splitplane_core::scene::{self as objects, GeometryId, InstanceId, OpacityMask, Transform};
use splitplane_float_state::{Standard, standard};
use splitplane_render::instances::Geometries;
use splitplane_render::scene_data::NONE;
use std::ffi::OsStr;
use std::ops::Range;
use std::path::Path;
use thiserror::Error;

/// A geometry: some of the triangles of [`InstancedScene::parts`], by which it is seen in its own space, or shapes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Geometry {
    /// Its name.
    pub name: String,
    /// Its vertices among all.
    pub vertices: Range<u32>,
    /// Its triangles among all; they name none but its vertices.
    pub triangles: Range<u32>,
    /// What it consists of in place of triangles.
    pub solids: Option<Solids>,
    /// Which parts of its triangles are there for rays; all where there is none.
    pub opacity: Option<OpacityMask>,
}

/// Spheres or capsules, and their material.
#[derive(Clone, Debug, PartialEq)]
pub struct Solids {
    /// What they are.
    pub kind: SolidKind,
    /// The material of all of them, by its place in the list of [`InstancedScene::parts`].
    pub material: u32,
}

/// What [`Solids`] are, in their own space.
#[derive(Clone, Debug, PartialEq)]
pub enum SolidKind {
    /// Spheres.
    Spheres(Vec<Sphere>),
    /// Capsules.
    Capsules(Vec<Capsule>),
}

impl SolidKind {
    /// The same, as a geometry takes them.
    pub fn shapes(&self) -> Shapes {
        match self {
            SolidKind::Spheres(all) => Shapes::Spheres(all.clone()),
            SolidKind::Capsules(all) => Shapes::Capsules(all.clone()),
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            SolidKind::Spheres(all) => all.len(),
            SolidKind::Capsules(all) => all.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// An instance: a geometry in the world, perhaps moving.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The geometry, by its place in [`InstancedScene::geometries`].
    pub geometry: u32,
    /// Where it is now, from its own space to the world.
    pub transform: Transform,
    /// Rays enter it when a bit of theirs is in this mask. Pictures ask with all bits.
    pub mask: u32,
    /// A number of the user's.
    pub id: u32,
    /// The side of its triangles that is ignored.
    pub culling: Culling,
    /// The material of all of it, by its place in the list of `parts`; `None` for those of its triangles.
    pub material: Option<u32>,
    /// Where it is in frames, in ascending order; empty for one that stays. Before the first and after the last it stands still.
    pub keys: Vec<Key>,
}

/// Many objects, and from where to look at them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InstancedScene {
    /// The file's name without its folder, or `builtin:NAME`.
    pub name: String,
    /// The triangles of all geometries, one geometry after the other, each in its own space; their materials and textures; camera and
    /// lights, which are in the world.
    pub parts: Scene,
    /// The geometries.
    pub geometries: Vec<Geometry>,
    /// The instances.
    pub instances: Vec<Placed>,
    /// How many frames there are; 1 for a scene that stays.
    pub frames: u32,
    /// How long a frame is.
    pub seconds_per_frame: f64,
    /// What a scene file's groups of baked instances have become.
    pub baked: Baked,
}

/// Why an instanced scene is no description of objects.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum InstancedError {
    /// A geometry whose arrays do not fit together.
    #[error("geometry `{name}`: {error}", name = crate::quoted_name(name))]
    Mesh {
        /// The geometry's name.
        name: String,
        /// What is wrong.
        error: MeshError,
    },
    /// An instance that cannot be.
    #[error(transparent)]
    Objects(#[from] objects::SceneError),
}

/// The ending of files of built scenes.
pub const SAVED: &str = "scene";

/// Whether what a user writes names a file of a built scene: it ends in `.scene`.
pub fn is_saved(spec: impl AsRef<OsStr>) -> bool {
    let ending = Path::new(spec.as_ref()).extension();
    ending.is_some_and(|ending| ending.eq_ignore_ascii_case(SAVED))
}

impl Placed {
    /// A geometry at a place, in its own materials.
    pub fn new(geometry: u32, transform: Transform) -> Placed {
        let culling = Culling::None;
        let (mask, id, material, keys) = (u32::MAX, 0, None, Vec::new());
        Placed { geometry, transform, mask, id, culling, material, keys }
    }
}

impl InstancedScene {
    /// One geometry, and one instance of it in place, with the holes that materials cut into its surfaces ([`Scene::cutouts`]) as an opacity mask.
    ///
    /// # Errors
    /// No memory for the mask.
    pub fn cut_out(parts: Scene) -> Result<InstancedScene, InstancedError> {
        let _state = Standard::set();
        let all = 0..parts.indices.len() as u32;
        let runs = [all];
        let mask = match cutout::level(&parts, &runs) {
            Some(level) => Some(cutout::mask(&parts, &cutout::channels(&parts), &runs, level)?),
            None => None,
        };
        let mut scene = InstancedScene::from(parts);
        for own in &mut scene.geometries {
            own.opacity.clone_from(&mask);
        }
        Ok(scene)
    }

    /// The triangles of a geometry, by the numbers of its own vertices.
    fn indices_of(&self, geometry: &Geometry) -> Vec<[u32; 3]> {
        let Range { start, end } = geometry.triangles;
        let all = self.parts.indices.get(start as usize..end as usize).unwrap_or_default();
        let own = |corner: u32| corner.wrapping_sub(geometry.vertices.start);
        all.iter().map(|corners| corners.map(own)).collect()
    }

    /// The description that backends build: geometries and instances have the names of their places here. Those that are [baked](Baked) are not there.
    ///
    /// # Errors
    /// Arrays that were changed to something that is not a mesh, a transform without an inverse, or no memory.
    pub fn describe(&self) -> Result<objects::Scene, InstancedError> {
        let _state = Standard::set();
        let mut scene = objects::Scene::new();
        for geometry in &self.geometries {
            if let Some(solids) = &geometry.solids {
                scene.add_shapes(solids.kind.shapes())?;
                continue;
            }
            let named = |error| InstancedError::Mesh { name: geometry.name.clone(), error };
            let Range { start, end } = geometry.vertices;
            let own = self.parts.positions.get(start as usize..end as usize).unwrap_or_default();
            let indices = self.indices_of(geometry);
            let added = scene.add_mesh(&Mesh::indexed(own, &indices).map_err(named)?)?;
            if let Some(mask) = &geometry.opacity {
                scene.set_opacity(added, Some(mask.clone()))?;
            }
        }
        for placed in &self.instances {
            let Placed { transform, mask, id, culling, .. } = *placed;
            let geometry = GeometryId(placed.geometry);
            scene.add_instance(objects::Instance { geometry, transform, mask, id, culling })?;
        }
        self.baked.remove_from(&mut scene)?;
        Ok(scene)
    }

    /// Puts the instances where they are in a frame, here and in the description that [`InstancedScene::describe`] gave. Returns how
    /// many have keys.
    ///
    /// # Errors
    /// A transform without an inverse, as between a key and its reflection; instances that were set before are where they are in
    /// the frame.
    pub fn set(&mut self, frame: u32, scene: &mut objects::Scene) -> Result<u32, InstancedError> {
        standard(|| {
            let mut moved = 0;
            for (name, placed) in self.instances.iter_mut().enumerate() {
                if placed.keys.is_empty() {
                    continue;
                }
                let transform = pose::at(&placed.keys, frame);
                scene.move_instance(InstanceId(name as u32), transform)?;
                placed.transform = transform;
                moved += 1;
            }
            Ok(moved)
        })
    }

    /// The numbers of the geometries' first triangles among all, and of instances' materials, for
    /// [`Geometries`].
    pub fn numbers(&self) -> (Vec<u32>, Vec<u32>) {
        let first = self.geometries.iter().map(|geometry| geometry.triangles.start);
        let of_solids = |placed: &Placed| {
            let geometry = self.geometries.get(placed.geometry as usize)?;
            Some(geometry.solids.as_ref()?.material)
        };
        let material = |placed: &Placed| placed.material.or_else(|| of_solids(placed));
        let materials = self.instances.iter().map(|placed| material(placed).unwrap_or(NONE));
        (first.collect(), materials.collect())
    }

    /// Triangles of all geometries of which there are instances, or were in no group that is [baked](Baked).
    pub fn triangles(&self) -> usize {
        // In ascending order.
        let gone = |place: usize| self.baked.geometries.binary_search(&(place as u32)).is_ok();
        let there = self.geometries.iter().enumerate().filter(|(place, _)| !gone(*place));
        there.map(|(_, own)| own.triangles.len()).sum()
    }

    /// Spheres and capsules of all geometries.
    pub fn solids(&self) -> usize {
        let of = |geometry: &Geometry| geometry.solids.as_ref().map_or(0, |own| own.kind.len());
        self.geometries.iter().map(of).sum()
    }

    /// Triangles of all instances together, which may be far more than are held.
    pub fn instanced_triangles(&self) -> u64 {
        let of = |placed: &Placed| self.geometries.get(placed.geometry as usize);
        let own = |geometry: &Geometry| geometry.triangles.len() as u64;
        self.instances.iter().filter_map(of).map(own).sum()
    }

    /// A camera and lights for the scene, from outside: its own where it has some, else as for [`Placement::of_with`] around the boxes
    /// of its instances.
    pub fn placement(&self, aspect: f64, lights: usize) -> Placement {
        standard(|| placement::outside_of(&boxes::of(self), aspect, lights))
    }

    /// Whether the scene brings light: lights of its own, instances that shine, or an environment map that does.
    pub fn is_lit(&self) -> bool {
        !self.parts.lights.is_empty() || self.parts.has_sky() || boxes::shines(self)
    }
}

impl From<Scene> for InstancedScene {
    /// One geometry, and one instance of it in place.
    fn from(parts: Scene) -> InstancedScene {
        let name = parts.name.clone();
        let (vertices, triangles) =
            (0..parts.positions.len() as u32, 0..parts.indices.len() as u32);
        let own = Geometry { name: name.clone(), vertices, triangles, ..Geometry::default() };
        let geometries = vec![own];
        let instances = vec![Placed::new(0, Pose::IDENTITY.transform())];
        let (frames, seconds_per_frame) = (1, 1.0 / 24.0);
        let baked = Baked::default();
        InstancedScene { name, parts, geometries, instances, frames, seconds_per_frame, baked }
    }
}

/// The numbers of [`InstancedScene::numbers`], for frames.
pub fn geometries<'a>((first_triangles, materials): &'a (Vec<u32>, Vec<u32>)) -> Geometries<'a> {
    Geometries { first_triangles, materials }
}
