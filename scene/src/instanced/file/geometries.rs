//! The geometries of a scene file: arrays in it, and .obj files beside it.

mod files;

use super::format::{self, File};
use super::locate::Step;
use super::size::{
    bytes_of_copy, bytes_while_copied, room_for_copy, room_for_geometry, room_to_finish,
};
use super::{At, MAX_INSTANCES, SceneFileProblem, material};
use crate::budget::{Budget, bytes_of};
use crate::from_file::quoted;
use crate::instanced::{InstancedError, InstancedScene, SolidKind, Solids, cutout};
use crate::{Material, Scene, SceneOptions};
use files::{Files, Loaded};
use splitplane_core::mesh::{MAX_TRIANGLES, Mesh};
use splitplane_core::scene::shape::{Capsule, Sphere};
use std::collections::HashMap;
use std::path::Path;
use std::slice;

/// Their numbers by name. Those that are the same part of the same file in the same material are one.
pub(super) struct Geometries<'a> {
    by_name: HashMap<&'a str, u32>,
}

/// What a geometry takes of an .obj file: the file as written, a group, an object.
type Source<'a> = (&'a str, Option<&'a str>, Option<&'a str>);

/// The same with the number of the file, and the material of all.
type Part<'a> = (usize, Option<&'a str>, Option<&'a str>, Option<u32>);

/// A problem and the field of the geometry that has it; no field where all of it is meant.
type Wrong = (Option<&'static str>, SceneFileProblem);

impl<'a> Geometries<'a> {
    pub(super) fn get(&self, name: &str) -> Option<u32> {
        self.by_name.get(name).copied()
    }

    pub(super) fn read(
        file: &'a File<'_>,
        scene: &mut InstancedScene,
        materials: &HashMap<&str, u32>,
        source: (&Path, &SceneOptions),
        budget: &Budget,
    ) -> Result<Geometries<'a>, At> {
        let all = || vec![Step::Field("geometries")];
        let whole = |index| vec![Step::Field("geometries"), Step::Element(index)];
        let at = |index, name| [whole(index), vec![Step::Field(name)]].concat();
        if file.geometries.len() > MAX_INSTANCES {
            let problem = SceneFileProblem::TooMany { what: "geometries", most: MAX_INSTANCES };
            return Err((all(), problem));
        }
        let mut by_name = budget.map(file.geometries.len()).map_err(|full| (all(), full.into()))?;
        let solids = scene.solids();
        let mut reader = Reader {
            scene,
            source,
            budget,
            files: Files::default(),
            known: HashMap::new(),
            solids,
            clay: None,
        };
        for (index, own) in file.geometries.iter().enumerate() {
            let named = material(materials, own.material.as_deref(), || at(index, "material"))?;
            let number = reader.read(own, named).map_err(|(field, problem)| {
                (field.map_or_else(|| whole(index), |field| at(index, field)), problem)
            })?;
            if by_name.insert(&*own.name, number).is_some() {
                let name = quoted(&own.name);
                let problem = SceneFileProblem::Twice { what: "geometry", name };
                return Err((at(index, "name"), problem));
            }
        }
        room_to_finish(reader.scene, budget).map_err(|problem| (all(), problem))?;
        reader.scene.finish_parts();
        Ok(Geometries { by_name })
    }
}

/// Puts geometries into a scene, one after the other.
struct Reader<'a, 's> {
    scene: &'s mut InstancedScene,
    /// The folder of the scene file, and how files are read.
    source: (&'s Path, &'s SceneOptions),
    budget: &'s Budget,
    files: Files<'a>,
    known: HashMap<Part<'a>, u32>,
    /// Spheres and capsules up to here.
    solids: usize,
    /// The material of what has none, once it is needed.
    clay: Option<u32>,
}

impl<'a> Reader<'a, '_> {
    /// The number of a geometry, in a material where one is named.
    fn read(&mut self, own: &'a format::Geometry<'_>, named: Option<u32>) -> Result<u32, Wrong> {
        let kind = Kind::of(own)
            .map_err(|(field, wrong)| (Some(field), SceneFileProblem::Wrong(wrong)))?;
        match kind {
            Kind::Obj(source) => self.part(&own.name, source, named),
            Kind::Spheres(all) => {
                let of = |own: &format::Sphere| Sphere { centre: own.centre, radius: own.radius };
                self.solids(&own.name, named, (all, of), SolidKind::Spheres)
            }
            Kind::Capsules(all) => {
                let of = |own: &format::Capsule| Capsule { ends: own.ends, radius: own.radius };
                self.solids(&own.name, named, (all, of), SolidKind::Capsules)
            }
            Kind::Arrays(positions, triangles) => self
                .arrays(&own.name, (positions, triangles), named)
                .map_err(|problem| (Some("triangles"), problem)),
        }
    }

    /// A part of an .obj file.
    fn part(
        &mut self,
        called: &str,
        (path, group, object): Source<'a>,
        named: Option<u32>,
    ) -> Result<u32, Wrong> {
        let budget = self.budget;
        let fail = |problem| (Some("obj"), problem);
        let file = self.files.number(path, self.source, self.scene, budget).map_err(fail)?;
        let part = (file, group, object, named);
        if let Some(number) = self.known.get(&part) {
            return Ok(*number);
        }
        let Loaded { scene: from, first_material, runs: by_name, channels, taken } =
            &mut self.files.loaded[file];
        let all = 0..from.indices.len() as u32;
        let (runs, what, name) = match (group, object) {
            (Some(name), _) => (by_name.get(&(false, name.to_owned())), "group", name),
            (_, Some(name)) => (by_name.get(&(true, name.to_owned())), "object", name),
            (None, None) => (None, "obj", path),
        };
        let whole = group.is_none() && object.is_none();
        let runs =
            if whole { slice::from_ref(&all) } else { runs.map(Vec::as_slice).unwrap_or_default() };
        if runs.is_empty() {
            let problem = SceneFileProblem::Unknown { what, name: quoted(name) };
            return Err((Some(what), problem));
        }
        let more: usize = runs.iter().map(|run| run.len()).sum();
        room(self.scene, more).map_err(fail)?;
        *taken += more;
        let meanwhile = bytes_while_copied(from, more);
        // Every triangle of the first file once is what it holds.
        if file == 0 && *taken <= from.indices.len() {
            // A list that grows is there twice, and has room for twice as much.
            budget.allow(3 * bytes_of_copy(from, more) + meanwhile);
        }
        room_for_copy(self.scene, from, more, budget).map_err(fail)?;
        room_for_geometry(self.scene, called, budget).map_err(fail)?;
        budget.take(meanwhile).map_err(|full| fail(full.into()))?;
        let number = self.scene.add_geometry(called, from, runs, *first_material);
        budget.give(meanwhile);
        if let Some(material) = named {
            self.scene.paint_geometry(number, material);
        } else if let Some(level) = cutout::level(from, runs) {
            // The description of the scene has one of its own. Triangles are listed while it is made.
            let (bytes, list) =
                (2 * cutout::bits(more, level).div_ceil(8), 3 * bytes_of::<usize>(more));
            budget.take(bytes.saturating_add(list)).map_err(|full| fail(full.into()))?;
            let mask = cutout::mask(from, channels, runs, level)
                .map_err(|error| fail(SceneFileProblem::Scene(InstancedError::Objects(error))))?;
            budget.give(list);
            self.scene.geometries[number as usize].opacity = Some(mask);
        }
        budget.grow_map(&mut self.known).map_err(|full| fail(full.into()))?;
        self.known.insert(part, number);
        Ok(number)
    }

    /// Spheres or capsules.
    fn solids<F, T>(
        &mut self,
        called: &str,
        named: Option<u32>,
        (all, of): (&[F], impl Fn(&F) -> T),
        kind: impl FnOnce(Vec<T>) -> SolidKind,
    ) -> Result<u32, Wrong> {
        let fail = |problem| (None, problem);
        self.solids += all.len();
        if self.solids > MAX_SOLIDS {
            let what = "spheres and capsules in all geometries together";
            return Err(fail(SceneFileProblem::TooMany { what, most: MAX_SOLIDS }));
        }
        let mut list = Vec::new();
        self.budget.grow_exact(&mut list, all.len()).map_err(|full| fail(full.into()))?;
        list.extend(all.iter().map(of));
        let material = self.material(named).map_err(fail)?;
        room_for_geometry(self.scene, called, self.budget).map_err(fail)?;
        Ok(self.scene.add_solids(called, Solids { kind: kind(list), material }))
    }

    /// Triangles of the file itself.
    fn arrays(
        &mut self,
        called: &str,
        (positions, triangles): (&[[f32; 3]], &[[u32; 3]]),
        named: Option<u32>,
    ) -> Result<u32, SceneFileProblem> {
        Mesh::indexed(positions, triangles)?;
        room(self.scene, triangles.len())?;
        let number = self.material(named)?;
        // As another scene, of which a part is copied.
        let bytes = bytes_of::<[f32; 3]>(positions.len() + triangles.len())
            + bytes_of::<u32>(triangles.len());
        self.budget.take(bytes)?;
        let from = Scene {
            positions: positions.to_vec(),
            indices: triangles.to_vec(),
            material_of: vec![number; triangles.len()],
            ..Scene::default()
        };
        room_for_copy(self.scene, &from, triangles.len(), self.budget)?;
        room_for_geometry(self.scene, called, self.budget)?;
        let meanwhile = bytes_while_copied(&from, triangles.len());
        self.budget.take(meanwhile)?;
        let all = 0..triangles.len() as u32;
        let number = self.scene.add_geometry(called, &from, &[all], 0);
        self.budget.give(bytes + meanwhile);
        Ok(number)
    }

    /// The material of what the file itself has.
    fn material(&mut self, named: Option<u32>) -> Result<u32, SceneFileProblem> {
        if let Some(number) = named.or(self.clay) {
            return Ok(number);
        }
        self.budget.grow(&mut self.scene.parts.materials, 1)?;
        Ok(*self.clay.insert(clay_of(self.scene)))
    }
}

/// Most spheres and capsules.
const MAX_SOLIDS: usize = 1 << 27;

/// Where the triangles of a geometry are, or what it has in place of them.
enum Kind<'a> {
    Spheres(&'a [format::Sphere]),
    Capsules(&'a [format::Capsule]),
    Obj(Source<'a>),
    Arrays(&'a [[f32; 3]], &'a [[u32; 3]]),
}

impl<'a> Kind<'a> {
    /// A field and what is wrong with it, where it is neither.
    fn of(own: &'a format::Geometry<'_>) -> Result<Kind<'a>, (&'static str, &'static str)> {
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
                (Some(all), _) => Ok(Kind::Spheres(all)),
                (_, all) => Ok(Kind::Capsules(all.as_deref().unwrap_or_default())),
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
