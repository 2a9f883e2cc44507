//! From the .mtl files that an OBJ file names to the scene's materials.

use super::mtl::{self, Entry};
use super::reader::told;
use super::rule::{self, Odd};
use crate::scene::{Material, Scene, SceneOptions};
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Greatest .mtl file that is read, in bytes; more than a hundred thousand materials.
const MOST: u64 = 64 << 20;

/// Gives the scene's materials what the libraries say of them. `libraries` are what follows each
/// `mtllib`, relative to `folder`. Whatever is missing becomes a warning.
pub(super) fn paint(
    scene: &mut Scene,
    libraries: &[String],
    folder: &Path,
    options: &SceneOptions,
) {
    // Every entry with the folder of its file, from which it names textures.
    let mut entries: HashMap<String, (Entry, PathBuf)> = HashMap::new();
    for library in libraries {
        // One name with blanks in it, or several names.
        let whole = find(folder, library).is_some();
        let names = if whole { vec![library.as_str()] } else { library.split(' ').collect() };
        for name in names.into_iter().filter(|name| !name.is_empty()) {
            let found = find(folder, name).ok_or_else(|| "there is no such file".to_owned());
            match found.and_then(|path| Ok((entries_of(&path)?, path))) {
                Ok(((found, warnings), path)) => {
                    let home = path.parent().unwrap_or(folder);
                    for entry in found {
                        entries.insert(entry.name.clone(), (entry, home.to_owned()));
                    }
                    let name = told(name);
                    let said = warnings.iter().map(|why| format!("material file `{name}`: {why}"));
                    scene.notes.warnings.extend(said);
                }
                Err(why) => scene
                    .notes
                    .warnings
                    .push(format!("the material file `{}` is left out: {why}", told(name))),
            }
        }
    }
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
            None => missing.push(material.name.clone()),
        }
    }
    if let (false, Some(first)) = (libraries.is_empty(), missing.first()) {
        let (count, first) = (missing.len(), told(first));
        let warning = format!("{count} materials have no colour, the first is `{first}`");
        scene.notes.warnings.push(warning);
    }
    for kind in Odd::ALL {
        let mut named = odd.iter().filter(|(odd, _)| *odd == kind);
        if let Some((_, first)) = named.next() {
            let (count, sentence, first) = (1 + named.count(), kind.sentence(), told(first));
            scene
                .notes
                .warnings
                .push(format!("{count} materials {sentence}, the first is `{first}`"));
        }
    }
}

/// For every material of the scene the index of its texture.
#[cfg(feature = "textures")]
fn textures(
    scene: &mut Scene,
    entries: &HashMap<String, (Entry, PathBuf)>,
    options: &SceneOptions,
) -> Vec<Option<u32>> {
    let mut album = super::textures::Album::new(options.texture_limit);
    let mut of = |material: &Material| {
        let (entry, folder) = entries.get(&material.name)?;
        let name = entry.map.as_ref().filter(|_| options.textures)?;
        album.add(&entry.name, folder, name)
    };
    let indices = scene.materials.iter().map(&mut of).collect();
    let (textures, warnings) = album.finish();
    scene.textures = textures;
    scene.notes.warnings.extend(warnings);
    indices
}

#[cfg(not(feature = "textures"))]
fn textures(
    scene: &mut Scene,
    entries: &HashMap<String, (Entry, PathBuf)>,
    options: &SceneOptions,
) -> Vec<Option<u32>> {
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

/// The regular file that a name of a file means, seen from a folder: as written, or with the
/// slashes of another system.
pub(super) fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let written = folder.join(name);
    if written.is_file() {
        return Some(written);
    }
    let turned = folder.join(name.replace('\\', "/"));
    turned.is_file().then_some(turned)
}

fn entries_of(file: &Path) -> Result<(Vec<Entry>, Vec<String>), String> {
    let about = fs::metadata(file).map_err(|error| error.to_string())?;
    if about.len() > MOST {
        return Err(format!("it is larger than {MOST} bytes"));
    }
    let bytes = fs::read(file).map_err(|error| error.to_string())?;
    let text = String::from_utf8_lossy(&bytes);
    let (entries, mut warnings) = mtl::parse(&text);
    if let std::borrow::Cow::Owned(_) = text {
        warnings.push("it is not all UTF-8; other letters are replaced".to_owned());
    }
    Ok((entries, warnings))
}
