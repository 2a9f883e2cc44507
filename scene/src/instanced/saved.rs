//! Files of built scenes, to be looked at: all of it is clay, since such files say nothing of materials.

use super::file::{SceneFileError, SceneFileProblem};
use super::{Geometry, InstancedScene, Placed, SolidKind, Solids};
use crate::from_file::{self, ReadError};
use crate::{Material, Scene, SceneOptions};
use splitplane_core::mesh::MAX_TRIANGLES;
use splitplane_core::scene::IDENTITY;
use splitplane_core::scene::file::{ContentInFile, SceneFile};
use splitplane_float_state::Standard;
use std::path::Path;

/// Reads a file of a built scene. Geometries and instances have the names that they have in the file: where one is free there, something that descriptions lack has its
/// place ([`InstancedScene::baked`]). Its trees are not read: who looks at a scene builds them as asked.
///
/// # Errors
/// A file that cannot be read or is not a scene.
pub fn read_saved(path: &Path, options: &SceneOptions) -> Result<InstancedScene, SceneFileError> {
    let _state = Standard::set();
    let fail = |problem| SceneFileError {
        file: path.to_owned(),
        place: None,
        field: String::new(),
        problem: Box::new(problem),
    };
    let limit = options.file_limit.unwrap_or_else(from_file::usual_limit);
    let bytes = from_file::read(path, limit).map_err(|error| {
        fail(match &error {
            limit if limit.is_limit() => SceneFileProblem::Limit(limit.to_string()),
            ReadError::System(system) if system.kind() == std::io::ErrorKind::NotFound => {
                SceneFileProblem::Unreadable("there is no such file; check the path".to_owned())
            }
            error => SceneFileProblem::Unreadable(error.to_string()),
        })
    })?;
    let file = SceneFile::parse(&bytes).map_err(|error| fail(SceneFileProblem::Saved(error)))?;
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let (frames, seconds_per_frame) = (1, 1.0 / 24.0);
    let mut scene = InstancedScene { name, frames, seconds_per_frame, ..InstancedScene::default() };
    scene.parts.materials.push(Material::clay());
    for (name, geometry) in file.geometries() {
        while scene.geometries.len() < name.0 as usize {
            let free = nothing(&mut scene);
            scene.baked.geometries.push(free);
        }
        let called = format!("geometry {}", name.0);
        let own = match geometry.content {
            ContentInFile::Mesh(mesh, _) => {
                if scene.parts.indices.len() + mesh.len() > MAX_TRIANGLES {
                    let what = "triangles in all geometries together";
                    return Err(fail(SceneFileProblem::TooMany { what, most: MAX_TRIANGLES }));
                }
                let (positions, indices) = mesh.arrays();
                let soup = || (0..mesh.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
                let from = Scene {
                    positions: positions.to_vec(),
                    indices: indices.map_or_else(|| soup().collect(), <[_]>::to_vec),
                    material_of: vec![0; mesh.len()],
                    ..Scene::default()
                };
                let all = 0..mesh.len() as u32;
                scene.add_geometry(&called, &from, &[all], 0)
            }
            ContentInFile::Spheres(all) => {
                let kind = SolidKind::Spheres(all.to_vec());
                scene.add_solids(&called, Solids { kind, material: 0 })
            }
            ContentInFile::Capsules(all) => {
                let kind = SolidKind::Capsules(all.to_vec());
                scene.add_solids(&called, Solids { kind, material: 0 })
            }
        };
        let opacity = geometry.opacity().map_err(|error| {
            fail(SceneFileProblem::Scene(super::InstancedError::Objects(error)))
        })?;
        scene.geometries[own as usize].opacity = opacity;
    }
    scene.finish_parts();
    for (name, instance) in file.instances() {
        while scene.instances.len() < name.0 as usize {
            let of = match scene.baked.geometries.first() {
                Some(free) => *free,
                None => {
                    let free = nothing(&mut scene);
                    scene.baked.geometries.push(free);
                    free
                }
            };
            scene.baked.instances.push(scene.instances.len() as u32);
            scene.instances.push(Placed::new(of, IDENTITY));
        }
        let (mask, id, culling) = (instance.mask, instance.id, instance.culling);
        let placed = Placed::new(instance.geometry.0, instance.transform);
        scene.instances.push(Placed { mask, id, culling, ..placed });
    }
    Ok(scene)
}

/// Adds a geometry of no triangles, for a name that is free.
fn nothing(scene: &mut InstancedScene) -> u32 {
    let vertex = scene.parts.positions.len() as u32;
    let triangle = scene.parts.indices.len() as u32;
    let (vertices, triangles) = (vertex..vertex, triangle..triangle);
    scene.geometries.push(Geometry { vertices, triangles, ..Geometry::default() });
    scene.geometries.len() as u32 - 1
}
