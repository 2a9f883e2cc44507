//! Scene files in JSON: see `docs/scene-file.md` for the format.
//!
//! What a file says is checked as it is read, and an error names file, line, column and field.

mod bake;
mod counted;
mod error;
mod format;
mod geometries;
mod instances;
mod locate;
mod size;
mod words;

pub use error::{SceneFileError, SceneFileProblem};

use super::InstancedScene;
use crate::budget::{Budget, Full};
use crate::from_file::{self, ReadError, quoted, quoted_reason};
use crate::{Camera, Light, Material, SceneOptions};
use counted::Counted;
use geometries::Geometries;
use locate::Step;
use splitplane_float_state::Standard;
use std::collections::HashMap;
use std::path::Path;

/// The version of the format that is read.
pub const VERSION: u32 = 1;
/// Most frames of a scene.
pub const MAX_FRAMES: u32 = 1 << 20;
/// Most instances of a scene, and most geometries.
pub const MAX_INSTANCES: usize = 1 << 24;

/// A problem and the field that has it.
type At = (Vec<Step>, SceneFileProblem);

/// Reads a scene file and the .obj files that it names, whose paths are relative to its folder.
///
/// # Errors
/// A file that cannot be read or is not a scene.
pub fn read(path: &Path, options: &SceneOptions) -> Result<InstancedScene, SceneFileError> {
    let _state = Standard::set();
    let fail = |problem| SceneFileError {
        file: path.to_owned(),
        place: None,
        field: String::new(),
        problem: Box::new(problem),
    };
    let limit = options.file_limit.unwrap_or_else(from_file::usual_limit);
    let (budget, mut bytes) = (budget_of(options), Vec::new());
    from_file::read_within(path, limit, &mut bytes, &budget).map_err(|error| {
        fail(match (&error, budget.refused()) {
            (ReadError::Memory, Some(full)) => full.into(),
            (limit, _) if limit.is_limit() => SceneFileProblem::Limit(limit.to_string()),
            (ReadError::System(system), _) if system.kind() == std::io::ErrorKind::NotFound => {
                SceneFileProblem::Unreadable("there is no such file; check the path".to_owned())
            }
            (error, _) => SceneFileProblem::Unreadable(error.to_string()),
        })
    })?;
    let text = std::str::from_utf8(&bytes).map_err(|_| fail(SceneFileProblem::NotUtf8))?;
    parse_within(text, path, options, &budget)
}

fn budget_of(options: &SceneOptions) -> Budget {
    Budget::new(options.memory_limit.unwrap_or_else(from_file::usual_limit))
}

/// Reads the text of a scene file. `path` names it in errors, and files it names are looked for beside it. The text counts for the limit of memory, as it does
/// where it is read from a file.
///
/// # Errors
/// As for [`read`].
pub fn parse(
    text: &str,
    path: &Path,
    options: &SceneOptions,
) -> Result<InstancedScene, SceneFileError> {
    let _state = Standard::set();
    let budget = budget_of(options);
    budget.take(text.len() as u64).map_err(|full| SceneFileError {
        file: path.to_owned(),
        place: None,
        field: String::new(),
        problem: Box::new(full.into()),
    })?;
    parse_within(text, path, options, &budget)
}

fn parse_within(
    text: &str,
    path: &Path,
    options: &SceneOptions,
    budget: &Budget,
) -> Result<InstancedScene, SceneFileError> {
    let file = from_json(text, path, budget)?;
    scene(&file, path, options, budget).map_err(|(field, problem)| SceneFileError {
        file: path.to_owned(),
        place: Some(locate::place(text, &field)),
        field: locate::shown(&field),
        problem: Box::new(problem),
    })
}

/// The fields of a file. What stops it is the first entry that is wrong, or for which there is no memory left.
fn from_json<'t>(
    text: &'t str,
    path: &Path,
    budget: &Budget,
) -> Result<format::File<'t>, SceneFileError> {
    let fail = |field: String, error: &serde_json::Error| {
        // Its message ends in the place, which is said once.
        let message = error.to_string();
        let end = message.rfind(" at line ").unwrap_or(message.len());
        let (mut column, mut problem) =
            (error.column().max(1), SceneFileProblem::Json(quoted_reason(&message[..end])));
        if let Some(full) = budget.refused() {
            // The last byte that was read stands before the entry.
            (column, problem) = (error.column() + 1, full.into());
        }
        SceneFileError {
            file: path.to_owned(),
            place: (error.line() > 0).then_some((error.line(), column)),
            field,
            problem: Box::new(problem),
        }
    };
    let words = words::bytes_of_quotes(text);
    budget.take(words).map_err(|full| SceneFileError {
        file: path.to_owned(),
        place: None,
        field: String::new(),
        problem: Box::new(full.into()),
    })?;
    let (mut reader, mut track) =
        (serde_json::Deserializer::from_str(text), serde_path_to_error::Track::new());
    let from = serde_path_to_error::Deserializer::new(&mut reader, &mut track);
    let file = format::File::read(from, budget).map_err(|error| {
        let field = track.path().to_string();
        let field = if field == "." { String::new() } else { field };
        fail(field, &error)
    })?;
    reader.end().map_err(|error| fail(String::new(), &error))?;
    budget.give(words);
    Ok(file)
}

fn scene(
    file: &format::File<'_>,
    path: &Path,
    options: &SceneOptions,
    budget: &Budget,
) -> Result<InstancedScene, At> {
    if file.format != "splitplane-scene" || file.version != VERSION {
        let field = if file.version == VERSION { "format" } else { "version" };
        let (format, version) = (quoted(&file.format), file.version);
        return Err((vec![Step::Field(field)], SceneFileProblem::Version { format, version }));
    }
    if !(1..=MAX_FRAMES).contains(&file.frames) {
        let problem = SceneFileProblem::Wrong("a scene has from 1 to 1048576 frames");
        return Err((vec![Step::Field("frames")], problem));
    }
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let mut scene = InstancedScene {
        name,
        frames: file.frames,
        seconds_per_frame: file.seconds_per_frame.unwrap_or(1.0 / 24.0),
        ..InstancedScene::default()
    };
    let materials = materials(file, &mut scene, budget)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let source = (folder, options);
    let geometries = Geometries::read(file, &mut scene, &materials, source, budget)?;
    instances::read(file, &mut scene, &materials, &geometries, budget)?;
    if options.bake {
        bake::read(file, &mut scene, budget)?;
    }
    if let Some(environment) = &file.environment {
        let field = || vec![Step::Field("environment"), Step::Field("file")];
        let bytes = size::bytes_of_path(folder, &environment.file);
        budget.take(bytes).map_err(|full| (field(), full.into()))?;
        read_environment(environment, &mut scene, folder, options)?;
        budget.give(bytes);
    }
    for (index, camera) in file.cameras.iter().enumerate() {
        let fail = |error| (vec![Step::Field("cameras"), Step::Element(index)], error);
        let up = camera.up.unwrap_or([0.0, 1.0, 0.0]);
        let fov = camera.fov_degrees.unwrap_or(40.0);
        let own =
            Camera::new(camera.eye, camera.at, up, fov).map_err(|error| fail(error.into()))?;
        scene.parts.camera.get_or_insert(own);
    }
    let lights = &mut scene.parts.lights;
    budget
        .grow_exact(lights, file.lights.len())
        .map_err(|full| (vec![Step::Field("lights")], full.into()))?;
    for (index, light) in file.lights.iter().enumerate() {
        scene.parts.lights.push(match light {
            format::Light::Point(format::PointLight { position, irradiance, distance }) => {
                let (position, irradiance, distance) = (*position, *irradiance, *distance);
                Light::Point { position, irradiance, distance }
            }
            format::Light::Sun(format::Sun { towards, irradiance }) => {
                if *towards == [0.0; 3] {
                    let field = [Step::Field("lights"), Step::Element(index)];
                    let inner = [Step::Field("sun"), Step::Field("towards")];
                    let problem = SceneFileProblem::Wrong("the direction is zero");
                    return Err(([field, inner].concat(), problem));
                }
                Light::Directional { towards: *towards, irradiance: *irradiance }
            }
        });
    }
    Ok(scene)
}

/// The environment map, whose path is relative to the scene file's folder.
#[cfg(feature = "environment")]
fn read_environment(
    own: &format::Environment<'_>,
    scene: &mut InstancedScene,
    folder: &Path,
    options: &SceneOptions,
) -> Result<(), At> {
    use crate::environment::{self, EnvironmentOptions};
    let options = EnvironmentOptions {
        rotation_degrees: own.rotation_degrees.unwrap_or(0.0),
        strength: own.strength.unwrap_or(1.0),
        decode_limit: options.decode_limit,
        file_limit: options.file_limit,
    };
    let path = folder.join(&*own.file);
    let read = environment::read(&path, &options).map_err(|error| {
        let field =
            if own.strength.is_some() && error.is_of_strength() { "strength" } else { "file" };
        (vec![Step::Field("environment"), Step::Field(field)], error.into())
    })?;
    scene.parts.notes.warnings.extend(read.note(&path));
    scene.parts.environment = Some(std::sync::Arc::new(read.map));
    Ok(())
}

#[cfg(not(feature = "environment"))]
fn read_environment(
    _own: &format::Environment<'_>,
    _scene: &mut InstancedScene,
    _folder: &Path,
    _options: &SceneOptions,
) -> Result<(), At> {
    let problem = SceneFileProblem::Wrong("this build reads no environment maps");
    Err((vec![Step::Field("environment")], problem))
}

/// The materials, and their numbers by name.
fn materials<'a>(
    file: &'a format::File<'_>,
    scene: &mut InstancedScene,
    budget: &Budget,
) -> Result<HashMap<&'a str, u32>, At> {
    let full = |full: Full| (vec![Step::Field("materials")], full.into());
    let mut numbers = budget.map(file.materials.len()).map_err(full)?;
    budget.grow_exact(&mut scene.parts.materials, file.materials.len()).map_err(full)?;
    for (index, own) in file.materials.iter().enumerate() {
        let field = |name| vec![Step::Field("materials"), Step::Element(index), Step::Field(name)];
        let both = own.glass.is_some() && (own.diffuse.is_some() || own.mirror.is_some());
        if both {
            let problem =
                "a clear body neither scatters nor mirrors: leave `diffuse` and `mirror` out";
            return Err((field("glass"), SceneFileProblem::Wrong(problem)));
        }
        let name = budget.copied(&own.name).map_err(|full| (field("name"), full.into()))?;
        let usual = if own.mirror.is_some() { [0.0; 3] } else { Material::clay().diffuse };
        let mut material = Material::new(name, own.diffuse.unwrap_or(usual));
        if let Some(mirror) = own.mirror {
            material = material.with_mirror(mirror);
        }
        if let Some(glass) = &own.glass {
            material = material.with_dielectric(glass.index, glass.tint.unwrap_or([1.0; 3]));
        }
        if let Some(roughness) = own.roughness {
            if own.glass.is_none() && own.mirror.is_none() {
                let problem = "only mirrors and clear bodies are rough: give `mirror` or `glass`";
                return Err((field("roughness"), SceneFileProblem::Wrong(problem)));
            }
            material = material.with_roughness(roughness);
        }
        material = material.with_emission(own.emission.unwrap_or_default());
        if numbers.insert(&*own.name, index as u32).is_some() {
            let name = quoted(&own.name);
            return Err((field("name"), SceneFileProblem::Twice { what: "material", name }));
        }
        scene.parts.materials.push(material);
    }
    Ok(numbers)
}

/// The number of a material by its name.
fn material(
    materials: &HashMap<&str, u32>,
    name: Option<&str>,
    field: impl FnOnce() -> Vec<Step>,
) -> Result<Option<u32>, At> {
    let Some(name) = name else { return Ok(None) };
    match materials.get(name) {
        Some(number) => Ok(Some(*number)),
        None => {
            let name = quoted(name);
            Err((field(), SceneFileProblem::Unknown { what: "material", name }))
        }
    }
}

#[cfg(test)]
mod tests;
