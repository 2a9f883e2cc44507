//! The geometries of a scene file: arrays in it, and .obj files beside it.

use super::budget::{Budget, bytes_of_copy, bytes_of_file};
use super::format::{self, File};
use super::locate::Step;
use super::{At, MAX_INSTANCES, SceneFileProblem, material};
use crate::from_file::quoted;
use crate::instanced::{InstancedError, InstancedScene, SolidKind, Solids, cutout};
use crate::{Material, Scene, SceneOptions, obj};
use splitplane_core::mesh::{MAX_TRIANGLES, Mesh};
use splitplane_core::scene::shape::{Capsule, Sphere};
use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Their numbers by name. Those that are the same part of the same file in the same material are one.
pub(super) struct Geometries<'a> {
    by_name: HashMap<&'a str, u32>,
}

/// An .obj file that was read, the number of its first material, and the runs of triangles of its groups and objects by name.
struct Loaded {
    scene: Scene,
    first_material: u32,
    runs: HashMap<(bool, String), Vec<Range<u32>>>,
    /// What says where its surfaces have holes.
    channels: Vec<usize>,
    /// Triangles that geometries took of it; those that several took, each time.
    taken: usize,
}

/// The .obj files that were read.
#[derive(Default)]
struct Files<'a> {
    loaded: Vec<Loaded>,
    /// Their numbers by the places where they are: one file may be named by many paths.
    places: HashMap<PathBuf, usize>,
    /// And by the paths as written.
    paths: HashMap<&'a str, usize>,
}

impl<'a> Files<'a> {
    /// The number of a file, which `read` reads where no path has led to it yet.
    fn number<E>(
        &mut self,
        folder: &Path,
        path: &'a str,
        read: impl FnOnce(&Path) -> Result<Loaded, E>,
    ) -> Result<usize, E> {
        if let Some(&number) = self.paths.get(path) {
            return Ok(number);
        }
        let written = folder.join(path);
        // Where there is no such file, reading it says so.
        let place = written.canonicalize().unwrap_or_else(|_| written.clone());
        let number = match self.places.get(&place) {
            Some(&number) => number,
            None => {
                self.loaded.push(read(&written)?);
                self.places.insert(place, self.loaded.len() - 1);
                self.loaded.len() - 1
            }
        };
        self.paths.insert(path, number);
        Ok(number)
    }
}

/// What a geometry takes of an .obj file: the file as written, a group, an object.
type Source<'a> = (&'a str, Option<&'a str>, Option<&'a str>);

/// The same with the number of the file, and the material of all.
type Part<'a> = (usize, Option<&'a str>, Option<&'a str>, Option<u32>);

impl<'a> Geometries<'a> {
    pub(super) fn get(&self, name: &str) -> Option<u32> {
        self.by_name.get(name).copied()
    }

    pub(super) fn read(
        file: &'a File,
        scene: &mut InstancedScene,
        materials: &HashMap<&str, u32>,
        (folder, options): (&Path, &SceneOptions),
        budget: &mut Budget,
    ) -> Result<Geometries<'a>, At> {
        let at =
            |index, name| vec![Step::Field("geometries"), Step::Element(index), Step::Field(name)];
        let whole = |index| vec![Step::Field("geometries"), Step::Element(index)];
        if file.geometries.len() > MAX_INSTANCES {
            let problem = SceneFileProblem::TooMany { what: "geometries", most: MAX_INSTANCES };
            return Err((vec![Step::Field("geometries")], problem));
        }
        let mut by_name = HashMap::new();
        let mut known: HashMap<Part<'a>, u32> = HashMap::new();
        let mut files = Files::default();
        let mut texture_bytes = 0;
        let (mut solids, mut clay) = (scene.solids(), None);
        for (index, own) in file.geometries.iter().enumerate() {
            let named = material(materials, own.material.as_deref(), || at(index, "material"))?;
            let number = match Kind::of(own)
                .map_err(|(field, wrong)| (at(index, field), SceneFileProblem::Wrong(wrong)))?
            {
                Kind::Obj((path, group, object)) => {
                    let read = |place: &Path| {
                        let left = options.texture_limit.saturating_sub(texture_bytes);
                        let options =
                            SceneOptions { texture_limit: left, cutouts: true, ..options.clone() };
                        let read = obj::read_with(place, &options);
                        let mut read = read.map_err(|error| (at(index, "obj"), error.into()))?;
                        texture_bytes += texels(&read);
                        note(scene, &mut read);
                        let first_material = scene.add_materials(&read);
                        let channels = cutout::channels(&read);
                        let runs = read.triangles_by_group().into_iter();
                        let runs = runs
                            .map(|((is_object, name), runs)| ((is_object, name.to_owned()), runs))
                            .collect();
                        Ok::<_, At>(Loaded {
                            scene: read,
                            first_material,
                            runs,
                            channels,
                            taken: 0,
                        })
                    };
                    let before = files.loaded.len();
                    let file = files.number(folder, path, read)?;
                    // All stay until the last is read. Links and copies of one file are further files too.
                    if before > 0 && files.loaded.len() > before {
                        let held = bytes_of_file(&files.loaded[file].scene);
                        budget.take(held).map_err(|problem| (at(index, "obj"), problem))?;
                    }
                    let part = (file, group, object, named);
                    if let Some(number) = known.get(&part) {
                        *number
                    } else {
                        let Loaded { scene: from, first_material, runs: by_name, channels, taken } =
                            &mut files.loaded[file];
                        let all = 0..from.indices.len() as u32;
                        let of = |is_object: bool, name: &str| {
                            let runs = by_name.get(&(is_object, name.to_owned()));
                            runs.cloned().unwrap_or_default()
                        };
                        let (runs, what, name) = match (group, object) {
                            (Some(name), _) => (of(false, name), "group", name),
                            (_, Some(name)) => (of(true, name), "object", name),
                            (None, None) => (vec![all], "obj", path),
                        };
                        if runs.is_empty() {
                            let name = quoted(name);
                            let problem = SceneFileProblem::Unknown { what, name };
                            return Err((at(index, what), problem));
                        }
                        let more: usize = runs.iter().map(|run| run.len()).sum();
                        let fail = |problem| (at(index, "obj"), problem);
                        room(scene, more).map_err(fail)?;
                        // Every triangle once is what the file holds.
                        *taken += more;
                        if *taken > from.indices.len() {
                            budget.take(bytes_of_copy(from, &runs)).map_err(fail)?;
                        }
                        let number = scene.add_geometry(&own.name, from, &runs, *first_material);
                        if let Some(material) = named {
                            scene.paint_geometry(number, material);
                        } else if let Some(level) = cutout::level(from, &runs) {
                            // The description of the scene has one of its own.
                            let bytes = 2 * cutout::bits(more, level).div_ceil(8);
                            budget.take(bytes).map_err(fail)?;
                            let mask = cutout::mask(from, channels, &runs, level);
                            let mask = mask.map_err(|error| {
                                fail(SceneFileProblem::Scene(InstancedError::Objects(error)))
                            })?;
                            scene.geometries[number as usize].opacity = Some(mask);
                        }
                        known.insert(part, number);
                        number
                    }
                }
                Kind::Solids(kind) => {
                    solids += kind.len();
                    if solids > MAX_SOLIDS {
                        let what = "spheres and capsules in all geometries together";
                        let problem = SceneFileProblem::TooMany { what, most: MAX_SOLIDS };
                        return Err((whole(index), problem));
                    }
                    let mut usual = || *clay.get_or_insert_with(|| clay_of(scene));
                    let material = named.unwrap_or_else(&mut usual);
                    scene.add_solids(&own.name, Solids { kind, material })
                }
                Kind::Arrays(positions, triangles) => {
                    Mesh::indexed(positions, triangles)
                        .map_err(|error| (at(index, "triangles"), error.into()))?;
                    room(scene, triangles.len())
                        .map_err(|problem| (at(index, "triangles"), problem))?;
                    let mut usual = || *clay.get_or_insert_with(|| clay_of(scene));
                    let number = named.unwrap_or_else(&mut usual);
                    let from = Scene {
                        positions: positions.to_vec(),
                        indices: triangles.to_vec(),
                        material_of: vec![number; triangles.len()],
                        ..Scene::default()
                    };
                    let all = 0..triangles.len() as u32;
                    scene.add_geometry(&own.name, &from, &[all], 0)
                }
            };
            if by_name.insert(own.name.as_str(), number).is_some() {
                let name = quoted(&own.name);
                let problem = SceneFileProblem::Twice { what: "geometry", name };
                return Err((at(index, "name"), problem));
            }
        }
        scene.finish_parts();
        Ok(Geometries { by_name })
    }
}

/// Most spheres and capsules.
const MAX_SOLIDS: usize = 1 << 27;

/// Where the triangles of a geometry are, or what it has in place of them.
enum Kind<'a> {
    Solids(SolidKind),
    Obj(Source<'a>),
    Arrays(&'a [[f32; 3]], &'a [[u32; 3]]),
}

impl<'a> Kind<'a> {
    /// A field and what is wrong with it, where it is neither.
    fn of(own: &'a format::Geometry) -> Result<Kind<'a>, (&'static str, &'static str)> {
        if own.spheres.is_some() || own.capsules.is_some() {
            let others = own.obj.is_some() || own.positions.is_some() || own.triangles.is_some();
            if others || own.group.is_some() || own.object.is_some() {
                return Err((
                    "name",
                    "a geometry consists of triangles, of spheres, or of capsules",
                ));
            }
            return match (&own.spheres, &own.capsules) {
                (Some(_), Some(_)) => Err(("capsules", "give spheres or capsules, not both")),
                (Some(all), _) => Ok(Kind::Solids(SolidKind::Spheres(
                    all.iter()
                        .map(|&format::Sphere { centre, radius }| Sphere { centre, radius })
                        .collect(),
                ))),
                (_, all) => Ok(Kind::Solids(SolidKind::Capsules(
                    all.iter()
                        .flatten()
                        .map(|&format::Capsule { ends, radius }| Capsule { ends, radius })
                        .collect(),
                ))),
            };
        }
        match (&own.obj, &own.positions, &own.triangles) {
            (Some(path), None, None) => match (&own.group, &own.object) {
                (Some(_), Some(_)) => Err(("group", "give a group or an object, not both")),
                (group, object) => Ok(Kind::Obj((path, group.as_deref(), object.as_deref()))),
            },
            (None, Some(positions), Some(triangles)) => {
                if own.group.is_some() || own.object.is_some() {
                    return Err(("name", "groups and objects are those of an .obj file"));
                }
                Ok(Kind::Arrays(positions, triangles))
            }
            _ => Err((
                "name",
                "a geometry has `obj`, or `positions` and `triangles`, or `spheres`, or `capsules`",
            )),
        }
    }
}

/// Whether so many triangles more can be numbered.
fn room(scene: &InstancedScene, more: usize) -> Result<(), SceneFileProblem> {
    if scene.parts.indices.len() + more > MAX_TRIANGLES {
        return Err(SceneFileProblem::TooMany {
            what: "triangles in all geometries together",
            most: MAX_TRIANGLES,
        });
    }
    Ok(())
}

/// The number of the material of triangles without one, which looks at all materials.
fn clay_of(scene: &mut InstancedScene) -> u32 {
    let materials = &mut scene.parts.materials;
    let clay = Material::clay();
    if let Some(there) = materials.iter().position(|material| *material == clay) {
        return there as u32;
    }
    materials.push(clay);
    materials.len() as u32 - 1
}

fn texels(scene: &Scene) -> u64 {
    scene.textures.iter().map(|texture| 4 * texture.texels().len() as u64).sum()
}

/// Keeps what a file's reader has to say.
fn note(scene: &mut InstancedScene, read: &mut Scene) {
    let (notes, more) = (&mut scene.parts.notes, &mut read.notes);
    notes.skipped_elements += more.skipped_elements;
    notes.skipped_freeform += more.skipped_freeform;
    notes.non_finite_vertices += more.non_finite_vertices;
    notes.unusable_normals += more.unusable_normals;
    notes.unusable_texcoords += more.unusable_texcoords;
    notes.textures_over_limit += more.textures_over_limit;
    notes.warnings.append(&mut more.warnings);
}
