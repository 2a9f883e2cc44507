//! Frames as .obj files of a folder.

use super::{AnimationError, Change};
use crate::budget::Budget;
use crate::{Scene, SceneOptions, obj};
use std::cmp::Ordering;
use std::fs;
use std::mem;
use std::path::{Path, PathBuf};

/// The files, and memory that is used again from frame to frame.
#[derive(Debug)]
pub(super) struct ObjFolder {
    files: Vec<PathBuf>,
    options: SceneOptions,
    bytes: Vec<u8>,
    spare: Scene,
    /// The libraries that the materials of the scene came from; `None` before the first frame.
    libraries: Option<Vec<String>>,
}

impl ObjFolder {
    pub(super) fn open(folder: &Path, options: &SceneOptions) -> Result<ObjFolder, AnimationError> {
        let fail = |error| AnimationError::unreadable(folder, &error);
        let mut files = Vec::new();
        for entry in fs::read_dir(folder).map_err(fail)? {
            let path = entry.map_err(fail)?.path();
            let is_obj = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("obj"));
            if is_obj && path.is_file() {
                files.push(path);
            }
        }
        if files.is_empty() {
            return Err(AnimationError::EmptyFolder(folder.to_owned()));
        }
        let name =
            |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        files.sort_by_cached_key(|path| Natural(name(path)));
        let options = options.clone();
        let (bytes, spare) = (Vec::new(), Scene::default());
        Ok(ObjFolder { files, options, bytes, spare, libraries: None })
    }

    pub(super) fn frames(&self) -> usize {
        self.files.len()
    }

    pub(super) fn set(
        &mut self,
        frame: usize,
        scene: &mut Scene,
    ) -> Result<Change, AnimationError> {
        let file = &self.files[frame];
        let memory = mem::take(&mut self.spare);
        let (mut next, libraries) =
            obj::geometry(file, &mut self.bytes, memory, &self.options, &Budget::unlimited())
                .map_err(|error| AnimationError::Frame { frame, error })?;
        let names =
            |scene: &Scene| scene.materials.iter().map(|m| m.name.clone()).collect::<Vec<_>>();
        let same_materials =
            self.libraries.as_ref() == Some(&libraries) && names(&next) == names(scene);
        if same_materials {
            // Textures are not decoded once a frame.
            mem::swap(&mut next.materials, &mut scene.materials);
            mem::swap(&mut next.textures, &mut scene.textures);
        } else {
            obj::paint(&mut next, &libraries, file, &self.options);
            self.libraries = Some(libraries);
        }
        mem::swap(&mut next.name, &mut scene.name);
        mem::swap(&mut next.lights, &mut scene.lights);
        next.camera = scene.camera;
        let same = same_materials
            && next.positions.len() == scene.positions.len()
            && next.normals.len() == scene.normals.len()
            && next.indices == scene.indices
            && next.material_of == scene.material_of
            && next.normal_indices == scene.normal_indices
            && next.texcoord_indices == scene.texcoord_indices
            && next.texcoords == scene.texcoords;
        mem::swap(scene, &mut next);
        self.spare = next;
        Ok(if same { Change::Positions } else { Change::Everything })
    }
}

/// A name ordered as people count: runs of digits by their value.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Natural(String);

impl Natural {
    /// The name in runs: digits without leading zeros, or other letters.
    fn runs(&self) -> impl Iterator<Item = (bool, &str)> {
        let digit = |c: char| c.is_ascii_digit();
        self.0
            .as_bytes()
            .chunk_by(move |a, b| digit(char::from(*a)) == digit(char::from(*b)))
            .scan(0, |start, run| {
                let from = *start;
                *start += run.len();
                Some(&self.0[from..*start])
            })
            .map(move |run| match run.starts_with(digit) {
                true => (true, run.trim_start_matches('0')),
                false => (false, run),
            })
    }
}

impl Ord for Natural {
    fn cmp(&self, other: &Natural) -> Ordering {
        let (mut left, mut right) = (self.runs(), other.runs());
        loop {
            let order = match (left.next(), right.next()) {
                // Equal except for leading zeros.
                (None, None) => return self.0.cmp(&other.0),
                // Of two numbers without leading zeros the longer one is greater.
                (Some((true, a)), Some((true, b))) => a.len().cmp(&b.len()).then(a.cmp(b)),
                (a, b) => a.map(|run| run.1).cmp(&b.map(|run| run.1)),
            };
            if order != Ordering::Equal {
                return order;
            }
        }
    }
}

impl PartialOrd for Natural {
    fn partial_cmp(&self, other: &Natural) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_ordered_as_people_count() {
        let want = [
            "a.obj",
            "f1.obj",
            "f01.obj",
            "f2.obj",
            "f9b.obj",
            "f10.obj",
            "f10a.obj",
            "f99999999999999999999999.obj",
            "g0.obj",
            "\u{e9}1",
            "\u{e9}12",
        ];
        let mut names: Vec<Natural> =
            want.iter().rev().map(|name| Natural((*name).to_owned())).collect();
        names.sort();
        let names: Vec<&str> = names.iter().map(|name| name.0.as_str()).collect();
        let mut want = want.to_vec();
        want.swap(1, 2);
        assert_eq!(names, want);
    }
}
