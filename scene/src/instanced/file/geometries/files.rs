//! The .obj files that a scene file names.

use crate::Scene;
use crate::budget::{Budget, Full};
use crate::instanced::file::SceneFileProblem;
use crate::instanced::file::size::{bytes_of_groups, bytes_of_path};
use crate::instanced::{InstancedScene, cutout};
use crate::{Material, SceneOptions, budget, obj};
use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// An .obj file that was read, the number of its first material, and the runs of triangles of its groups and objects by name.
pub(super) struct Loaded {
    pub(super) scene: Scene,
    pub(super) first_material: u32,
    pub(super) runs: HashMap<(bool, String), Vec<Range<u32>>>,
    /// What says where its surfaces have holes.
    pub(super) channels: Vec<usize>,
    /// Triangles that geometries took of it; those that several took, each time.
    pub(super) taken: usize,
}

/// The .obj files that were read. All stay until the last is.
#[derive(Default)]
pub(super) struct Files<'a> {
    pub(super) loaded: Vec<Loaded>,
    /// Their numbers by the places where they are: one file may be named by many paths.
    places: HashMap<PathBuf, usize>,
    /// And by the paths as written.
    paths: HashMap<&'a str, usize>,
    /// Bytes of the texels of all.
    texels: u64,
}

impl<'a> Files<'a> {
    /// The number of a file, which is read where no path has led to it yet.
    pub(super) fn number(
        &mut self,
        path: &'a str,
        (folder, options): (&Path, &SceneOptions),
        scene: &mut InstancedScene,
        budget: &Budget,
    ) -> Result<usize, SceneFileProblem> {
        if let Some(&number) = self.paths.get(path) {
            return Ok(number);
        }
        budget.grow_map(&mut self.paths)?;
        let bytes = bytes_of_path(folder, path);
        budget.take(bytes)?;
        let written = folder.join(path);
        // Where there is no such file, reading it says so.
        let place = written.canonicalize().unwrap_or_else(|_| written.clone());
        let number = match self.places.get(&place) {
            Some(&number) => number,
            None => {
                budget.grow_map(&mut self.places)?;
                budget.take(place.capacity() as u64)?;
                budget.grow(&mut self.loaded, 1)?;
                let loaded = self.read(&written, options, scene, budget)?;
                self.loaded.push(loaded);
                self.places.insert(place, self.loaded.len() - 1);
                self.loaded.len() - 1
            }
        };
        budget.give(bytes);
        self.paths.insert(path, number);
        Ok(number)
    }

    fn read(
        &mut self,
        path: &Path,
        options: &SceneOptions,
        scene: &mut InstancedScene,
        budget: &Budget,
    ) -> Result<Loaded, SceneFileProblem> {
        let left = options.texture_limit.saturating_sub(self.texels);
        let options = SceneOptions { texture_limit: left, cutouts: true, ..options.clone() };
        // The first file is what the user asks for. Links and copies of it are further files.
        let is_first = self.loaded.is_empty();
        let unlimited = Budget::unlimited();
        let own = if is_first { &unlimited } else { budget };
        let mut read =
            obj::read_within(path, &options, own).map_err(|error| match own.refused() {
                Some(limit @ Full::Limit { .. }) => limit.into(),
                _ => SceneFileProblem::from(error),
            })?;
        self.texels += texels(&read);
        note(scene, &mut read, own)?;
        if is_first {
            budget.allow(3 * bytes_of_materials(&read.materials));
        }
        budget.grow(&mut scene.parts.materials, read.materials.len())?;
        budget.take(letters(&read.materials))?;
        let first_material = scene.add_materials(&read);
        let channels = cutout::channels(&read);
        let (kept, meanwhile) = bytes_of_groups(&read);
        own.take(kept.saturating_add(meanwhile))?;
        let runs = read.triangles_by_group().into_iter();
        let runs =
            runs.map(|((is_object, name), runs)| ((is_object, name.to_owned()), runs)).collect();
        own.give(meanwhile);
        Ok(Loaded { scene: read, first_material, runs, channels, taken: 0 })
    }
}

fn texels(scene: &Scene) -> u64 {
    scene.textures.iter().map(|texture| 4 * texture.texels().len() as u64).sum()
}

fn letters(materials: &[Material]) -> u64 {
    materials.iter().map(|own| own.name.len() as u64).sum()
}

fn bytes_of_materials(materials: &[Material]) -> u64 {
    budget::bytes_of::<Material>(materials.len() + 1) + letters(materials)
}

/// Keeps what a file's reader has to say.
fn note(
    scene: &mut InstancedScene,
    read: &mut Scene,
    budget: &Budget,
) -> Result<(), SceneFileProblem> {
    let (notes, more) = (&mut scene.parts.notes, &mut read.notes);
    notes.skipped_elements += more.skipped_elements;
    notes.skipped_freeform += more.skipped_freeform;
    notes.non_finite_vertices += more.non_finite_vertices;
    notes.unusable_normals += more.unusable_normals;
    notes.unusable_texcoords += more.unusable_texcoords;
    notes.textures_over_limit += more.textures_over_limit;
    // The list goes, what is in it stays.
    let warnings = std::mem::take(&mut more.warnings);
    budget.take(warnings.iter().map(|said| said.capacity() as u64).sum())?;
    budget.grow(&mut notes.warnings, warnings.len())?;
    notes.warnings.extend(warnings);
    Ok(())
}
