//! Colours from .mtl files.

use crate::scene::{Material, Scene};
use std::collections::HashMap;
use std::fs;
use std::io::Cursor;
use std::path::Path;

/// Greatest .mtl file that is read, in bytes; more than a hundred thousand materials.
const MOST: u64 = 64 << 20;

/// Gives the scene's materials the colours of the libraries, which are what follows each `mtllib`,
/// relative to `folder`. Whatever is missing becomes a warning.
pub(super) fn paint(scene: &mut Scene, libraries: &[String], folder: &Path) {
    let mut colours: HashMap<String, [f32; 3]> = HashMap::new();
    for library in libraries {
        // One name with blanks in it, or several names.
        let whole = folder.join(library).is_file();
        let names = if whole { vec![library.as_str()] } else { library.split(' ').collect() };
        for name in names.into_iter().filter(|name| !name.is_empty()) {
            match colours_of(&folder.join(name)) {
                Ok(found) => colours.extend(found),
                Err(why) => scene
                    .notes
                    .warnings
                    .push(format!("the material file `{name}` is left out: {why}")),
            }
        }
    }
    let mut missing = Vec::new();
    for material in &mut scene.materials {
        match colours.get(&material.name) {
            Some(&colour) => *material = Material::new(material.name.as_str(), colour),
            None if *material == Material::clay() => {}
            None => missing.push(material.name.clone()),
        }
    }
    if let (false, Some(first)) = (libraries.is_empty(), missing.first()) {
        let count = missing.len();
        let warning = format!("{count} materials have no colour, the first is `{first}`");
        scene.notes.warnings.push(warning);
    }
}

fn colours_of(file: &Path) -> Result<HashMap<String, [f32; 3]>, String> {
    let about = fs::metadata(file).map_err(|_| "there is no such file".to_owned())?;
    if !about.is_file() {
        return Err("it is not a regular file".to_owned());
    }
    if about.len() > MOST {
        return Err(format!("it is larger than {MOST} bytes"));
    }
    let bytes = fs::read(file).map_err(|error| error.to_string())?;
    let (materials, _) =
        tobj::load_mtl_buf(&mut Cursor::new(bytes)).map_err(|error| error.to_string())?;
    let colour = |m: &tobj::Material| match (m.diffuse?, m.specular) {
        // Mirrors and metals, whose colour is all in Ks, would be black without reflections.
        ([0.0, 0.0, 0.0], Some(specular)) => Some(specular.map(|part| 0.5 * part)),
        (diffuse, _) => Some(diffuse),
    };
    Ok(materials
        .into_iter()
        .filter_map(|m| Some((colour(&m)?, m.name)))
        .map(|(c, n)| (n, c))
        .collect())
}
