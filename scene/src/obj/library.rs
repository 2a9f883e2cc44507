//! From the .mtl files that an OBJ file names to the scene's materials.

use super::mtl::{self, Entry};
use super::named_file::find;
use super::rule::{self, Odd};
use super::said::Said;
use crate::budget::{bytes_of, bytes_of_map};
use crate::from_file::{self, Identity, ReadError, quoted};
use crate::{Material, Scene, SceneOptions};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

/// Greatest .mtl file that is read, in bytes; more than a hundred thousand materials.
const MOST: u64 = 64 << 20;
/// Most bytes of all .mtl files of a scene.
const MOST_OF_ALL: u64 = 256 << 20;

/// Every entry with the folder of its file, from which it names textures.
type Entries = HashMap<String, (Entry, PathBuf)>;

/// Sets the scene's materials as the libraries say. `libraries` are what follows each
/// `mtllib`, relative to `folder`. Whatever is missing becomes a warning.
pub(super) fn paint(
    scene: &mut Scene,
    libraries: &[String],
    folder: &Path,
    options: &SceneOptions,
) {
    let mut said = Said::default();
    let entries = entries(scene, libraries, folder, &mut said);
    scene.notes.warnings.extend(said.sentences());
    let textures = textures(scene, &entries, options);
    let mut missing = Vec::new();
    let mut odd: Vec<(Odd, String)> = Vec::new();
    for (material, texture) in scene.materials.iter_mut().zip(textures) {
        let entry = entries.get(&material.name);
        let made = entry.and_then(|(entry, _)| {
            let (made, found) = rule::material(entry, options.materials, texture.is_some());
            odd.extend(found.into_iter().map(|odd| (odd, entry.name.clone())));
            made
        });
        match made {
            Some(made) => *material = Material { texture, ..made },
            None if *material == Material::clay() => {}
            // It has a texture, which was not asked for.
            None if !options.textures && entry.is_some_and(|(entry, _)| entry.map.is_some()) => {}
            None => missing.push(material.name.clone()),
        }
    }
    if let (false, Some(first)) = (libraries.is_empty(), missing.first()) {
        let (count, first) = (missing.len(), quoted(first));
        let warning = format!("{count} materials have no colour, the first is `{first}`");
        scene.notes.warnings.push(warning);
    }
    for kind in Odd::ALL {
        let mut named = odd.iter().filter(|(odd, _)| *odd == kind);
        if let Some((_, first)) = named.next() {
            let (count, sentence, first) = (1 + named.count(), kind.sentence(), quoted(first));
            scene
                .notes
                .warnings
                .push(format!("{count} materials {sentence}, the first is `{first}`"));
        }
    }
}

/// Most bytes that are taken while a scene gets its colours, beside texts of .mtl files and pictures, which have limits of their own: entries, with the folder of each, and lists of names.
pub(super) fn bytes_to_paint(scene: &Scene, libraries: &[String], folder: &Path) -> u64 {
    if libraries.is_empty() {
        return 0;
    }
    let letters = |names: u64, name: &String| names.saturating_add(name.len() as u64);
    let names = scene.materials.iter().map(|own| &own.name).fold(0, letters);
    let paths = libraries.iter().fold(0, letters);
    let count = scene.materials.len();
    // A table that grows is there with its former one, of half the size, and a list with one of as many entries.
    let table = bytes_of_map::<String, (Entry, PathBuf)>(count);
    let used = bytes_of_map::<&str, ()>(count);
    let seen = bytes_of_map::<&str, ()>(libraries.len());
    let lists = bytes_of::<(Odd, String, Option<u32>)>(count.saturating_mul(3));
    let folders = (count as u64).saturating_mul(3 * folder.as_os_str().len() as u64 + 64);
    [table, table / 2, used, used / 2, seen, seen / 2, lists, folders, 4 * names, 8 * paths]
        .into_iter()
        .fold(0, u64::saturating_add)
}

/// What the libraries say of the scene's materials. Each file is read once, by whatever names it goes, in
/// the place of the last of them: what stands later counts.
fn entries(scene: &Scene, libraries: &[String], folder: &Path, said: &mut Said) -> Entries {
    let mut seen = HashSet::new();
    let mut files = Vec::new();
    for library in libraries.iter().rev().filter(|library| seen.insert(library.as_str())) {
        // One name with blanks in it, or several names.
        let whole = find(folder, library).is_some();
        let names = if whole { vec![library.as_str()] } else { library.split(' ').collect() };
        files.extend(names.into_iter().rev().filter(|name| !name.is_empty()));
    }
    let mut read = HashSet::new();
    let found = |name: &&str| {
        let path = find(folder, name);
        // One that cannot be found is said once a name.
        match path.as_deref().and_then(|path| Identity::of(path).ok()) {
            Some(file) => read.insert(Ok(file)).then_some((name.to_string(), path)),
            None => read.insert(Err(name.to_string())).then_some((name.to_string(), None)),
        }
    };
    let mut files: Vec<(String, Option<PathBuf>)> = files.iter().filter_map(found).collect();
    files.reverse();
    let used: HashSet<&str> =
        scene.materials.iter().map(|material| material.name.as_str()).collect();
    let mut entries = Entries::new();
    let mut left = MOST_OF_ALL;
    for (name, path) in files {
        let home = path.as_deref().and_then(Path::parent).unwrap_or(folder);
        let keep = |entry: Entry| {
            if used.contains(entry.name.as_str()) {
                entries.insert(entry.name.clone(), (entry, home.to_owned()));
            }
        };
        let missing = || "there is no such file".to_owned();
        let name = quoted(&name);
        match path.as_deref().ok_or_else(missing).and_then(|path| entries_of(path, &mut left, keep))
        {
            Ok(warnings) => {
                for why in warnings {
                    said.say(|| format!("material file `{name}`: {why}"));
                }
            }
            Err(why) => said.say(|| format!("the material file `{name}` is left out: {why}")),
        }
    }
    entries
}

/// For every material of the scene the index of its texture.
#[cfg(feature = "textures")]
fn textures(scene: &mut Scene, entries: &Entries, options: &SceneOptions) -> Vec<Option<u32>> {
    let mut album = super::textures::Album::new(options.texture_limit, options.decode_limit);
    let mut of = |material: &Material| {
        let (entry, folder) = entries.get(&material.name)?;
        let name = entry.map.as_ref().filter(|_| options.textures)?;
        album.add(&entry.name, folder, name)
    };
    let indices = scene.materials.iter().map(&mut of).collect();
    if options.cutouts {
        let mut of = |material: &Material| {
            let (entry, folder) = entries.get(&material.name)?;
            album.add(&entry.name, folder, entry.cutout.as_ref()?)
        };
        let cutouts: Vec<Option<u32>> = scene.materials.iter().map(&mut of).collect();
        if cutouts.iter().any(Option::is_some) {
            scene.cutouts = cutouts;
        }
    }
    scene.notes.textures_over_limit = album.over_limit();
    let (textures, warnings) = album.finish();
    scene.textures = textures;
    scene.notes.warnings.extend(warnings);
    indices
}

#[cfg(not(feature = "textures"))]
fn textures(scene: &mut Scene, entries: &Entries, options: &SceneOptions) -> Vec<Option<u32>> {
    let named = |material: &&Material| {
        entries.get(&material.name).is_some_and(|(entry, _)| entry.map.is_some())
    };
    let count = scene.materials.iter().filter(named).count();
    if options.textures && count > 0 {
        scene.notes.warnings.push(format!(
            "{count} materials have textures, which this build leaves out; enable the feature `textures`"
        ));
    }
    vec![None; scene.materials.len()]
}

/// Returns the contents of a file, and the notes on it; `left` are the bytes that may still be
/// read.
fn entries_of(file: &Path, left: &mut u64, keep: impl FnMut(Entry)) -> Result<Vec<String>, String> {
    let bytes = from_file::read(file, MOST.min(*left)).map_err(|error| match error {
        ReadError::TooLong { limit: MOST } => format!("it is larger than {MOST} bytes"),
        ReadError::TooLong { .. } => {
            format!("with those before it, it is larger than {MOST_OF_ALL} bytes")
        }
        error => error.to_string(),
    })?;
    *left -= bytes.len() as u64;
    let text = String::from_utf8_lossy(&bytes);
    let mut warnings = mtl::parse(&text, keep);
    if let std::borrow::Cow::Owned(_) = text {
        warnings.push("it is not all UTF-8; other letters are replaced".to_owned());
    }
    Ok(warnings)
}
