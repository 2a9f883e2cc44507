//! glTF 2.0: `.gltf` with its buffers and pictures beside it or inside, and `.glb`.
//!
//! Nodes of the file's scene become instances, one for each that has a mesh, with the node's number as [`id`](crate::instanced::Placed::id); a
//! mesh is one geometry. Cameras, punctual lights and materials become ours; what is lost on the way is said in the notes:
//!
//! - **Materials.** Where the metallic factor is 1/2 and more, the roughness factor below 1/2 and no texture says more, the base colour is
//!   mirrored by the metallic part, and scattered by the rest; everything else scatters the base colour times its texture. Transmission
//!   of 1/2 and more is the boundary of a clear body of the material's refractive index, if it has a volume; else light goes straight
//!   through, as it does where alpha is blended and less than 1/2. Emission is factor times strength; one with a texture is left out.
//!   Other textures, alpha masks, vertex colours and all other extensions of materials are left out.
//! - **Light.** Numbers are kept: lux as irradiance, candela as irradiance at distance 1. Spot lights shine all around.
//! - **Cameras.** The first perspective one, in the order of the nodes.
//! - **Animation.** The first one of the file, at 24 frames a second, of nodes whose place is a move, a turn and scales along their own axes
//!   in every frame. Between two keys rotations go the shorter way by the sum of quaternions. Skins and morph targets stay as they are
//!   without one.
//!
//! JSON is read by the crate `gltf-json`, which checks most indices (for those of positions it panics, so
//! they are checked before); the crate `gltf` above it panics for files that it lets through, such as an embedded picture without a
//! type, and trusts the lengths of a `.glb`, so buffers, accessors and nodes are read here. Memory is bounded by the bytes of the
//! files: what accessors are decoded to may be [`EXPANSION`] times as large. Buffers and pictures must lie in the file's folder or
//! below. Extensions that a file requires and that change where triangles are, such as compression, are refused.

mod accessor;
mod buffers;
mod container;
mod materials;
mod meshes;
mod motion;
mod nodes;
mod uri;
mod write;

pub use write::to_glb;

use crate::from_file::{self, quoted, quoted_reason};
use crate::instanced::InstancedScene;
use crate::mesh_file::{self, Located, MeshFileError, MeshFileProblem, Place, in_file};
use crate::{Scene, SceneOptions};
use gltf_json::validation::{Error, Validate};
use gltf_json::{Path as JsonPath, Root};
use splitplane_float_state::Standard;
use std::collections::BTreeSet;
use std::path::Path;

/// How many times the bytes of its files a scene's decoded numbers may take: meshes may share what a file holds once.
pub const EXPANSION: u64 = 64;
/// Most objects in the JSON: each takes up to a hundred times the bytes of its text.
const MOST_OBJECTS: usize = 1 << 22;
/// Extensions that may be required: what they add is read, or is lost without moving a triangle.
const READABLE: [&str; 14] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "EXT_texture_webp",
    "MSFT_texture_dds",
];
/// Extensions of which nothing is lost.
const WHOLE: [&str; 7] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];
/// Most extensions that are named in notes.
const MOST_NOTES: usize = 16;

/// Whether a path ends in `.gltf` or `.glb`.
pub(crate) fn is_named_by(path: &Path) -> bool {
    let is = |ending: &str| path.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending));
    is("gltf") || is("glb")
}

/// Reads a file, and the buffers and pictures that it names.
///
/// # Errors
/// A file that cannot be read, is no glTF 2.0, or has no triangles.
pub fn read(path: &Path, options: &SceneOptions) -> Result<InstancedScene, MeshFileError> {
    let _state = Standard::set();
    parse(&mesh_file::bytes_of(path, options)?, path, options)
}

/// As [`read`], of the bytes of a file. `path` names it in errors, and what it names is looked for beside it.
///
/// # Errors
/// As for [`read`].
pub fn parse(
    bytes: &[u8],
    path: &Path,
    options: &SceneOptions,
) -> Result<InstancedScene, MeshFileError> {
    let _state = Standard::set();
    scene(bytes, path, options).map_err(in_file(path))
}

/// As [`read`], all instances as one mesh in the world, in the first frame.
///
/// # Errors
/// As for [`read`]; and where all instances together have too many triangles.
pub fn read_flat(path: &Path, options: &SceneOptions) -> Result<Scene, MeshFileError> {
    let _state = Standard::set();
    let limit = options.file_limit.unwrap_or_else(from_file::usual_limit);
    read(path, options)?.flatten(limit).map_err(|problem| in_file(path)((None, problem)))
}

/// What is said of an index past the end.
const MISSING: &str = "it names something that is not there";

/// A field and its problem.
fn at(field: impl Into<String>, problem: MeshFileProblem) -> Located {
    (Some(Place::Field(field.into())), problem)
}

/// A field and a sentence.
fn wrong(field: impl Into<String>, sentence: impl Into<String>) -> Located {
    at(field, MeshFileProblem::Wrong(sentence.into()))
}

fn scene(bytes: &[u8], path: &Path, options: &SceneOptions) -> Result<InstancedScene, Located> {
    let (json, bin) = container::split(bytes)?;
    let root = root(json)?;
    let mut scene = InstancedScene {
        name: mesh_file::name_of(path),
        frames: 1,
        seconds_per_frame: 1.0 / motion::RATE,
        ..InstancedScene::default()
    };
    note_extensions(&root, &mut scene);
    let folder = path.parent().unwrap_or(Path::new(""));
    let limit = options.file_limit.unwrap_or_else(from_file::usual_limit);
    let mut buffers = buffers::Buffers::load(&root, bin, bytes.len() as u64, folder, limit)?;
    let looks = materials::read(&root, &buffers, &mut scene, folder, options);
    let nodes = nodes::walk(&root)?;
    let places = nodes::place(&root, &nodes, &mut buffers, &looks, &mut scene)?;
    nodes::cameras_and_lights(&root, &nodes, &mut scene);
    motion::read(&root, &nodes, &places, &mut buffers, &mut scene)?;
    if scene.instances.is_empty() {
        return Err((None, MeshFileProblem::NoTriangles));
    }
    scene.finish_parts();
    Ok(scene)
}

/// The JSON, its indices checked.
fn root(json: &[u8]) -> Result<Root, Located> {
    if json.iter().filter(|byte| **byte == b'{').count() > MOST_OBJECTS {
        let problem = MeshFileProblem::TooMany { what: "JSON objects", most: MOST_OBJECTS as u64 };
        return Err((None, problem));
    }
    let fail = |field: String, error: &serde_json::Error| {
        // Its message ends in the place, which is said once.
        let message = error.to_string();
        let end = message.rfind(" at line ").unwrap_or(message.len());
        let reason = quoted_reason(&message[..end]);
        let (line, column) = (error.line(), error.column());
        let place = if field.is_empty() || field == "." { None } else { Some(Place::Field(field)) };
        let place = place.or((line > 0).then_some(Place::Line(line as u64)));
        (place, MeshFileProblem::Wrong(format!("{reason} (line {line}, column {column})")))
    };
    let mut reader = serde_json::Deserializer::from_slice(json);
    let mut root: Root = serde_path_to_error::deserialize(&mut reader)
        .map_err(|error| fail(error.path().to_string(), error.inner()))?;
    reader.end().map_err(|error| fail(String::new(), &error))?;
    if !root.asset.version.starts_with("2.") {
        let version = quoted(&root.asset.version);
        return Err(wrong("asset.version", format!("version {version} is not read; 2.0 is")));
    }
    let required = std::mem::take(&mut root.extensions_required);
    let unread = required.iter().position(|name| !READABLE.contains(&name.as_str()));
    if let Some(index) = unread {
        let name = quoted(&required[index]);
        let sentence = format!("the extension `{name}` is required, and is not read");
        return Err(wrong(format!("extensionsRequired[{index}]"), sentence));
    }
    // The crate's check looks up positions before it has looked at their index.
    for (mesh, own) in root.meshes.iter().enumerate() {
        for (number, own) in own.primitives.iter().enumerate() {
            if own.attributes.values().any(|index| index.value() >= root.accessors.len()) {
                let field = format!("meshes[{mesh}].primitives[{number}].attributes");
                return Err(wrong(field, MISSING));
            }
        }
    }
    let mut first: Option<(JsonPath, Error)> = None;
    root.validate(&root, JsonPath::new, &mut |path, error| {
        if first.is_none() && !is_forgiven(&path().0, error) {
            first = Some((path(), error));
        }
    });
    match first {
        None => Ok(root),
        Some((path, Error::IndexOutOfBounds)) => Err(wrong(path.0, MISSING)),
        Some((path, error)) => Err(wrong(path.0, error.to_string())),
    }
}

/// What the format forbids and no reader needs: bounds that nobody looks at, attributes of a program's own.
fn is_forgiven(path: &str, error: Error) -> bool {
    let is_bound = path.ends_with(".min") || path.ends_with(".max");
    let is_attribute = path.ends_with("[\"<invalid semantic name>\"]");
    let is_empty = path.starts_with("accessors") && path.ends_with(".bufferView");
    (error == Error::Missing && (is_bound || is_empty)) || (error == Error::Invalid && is_attribute)
}

fn note_extensions(root: &Root, scene: &mut InstancedScene) {
    let used: BTreeSet<&String> = root.extensions_used.iter().collect();
    let lost: Vec<&&String> = used.iter().filter(|name| !WHOLE.contains(&name.as_str())).collect();
    let warnings = &mut scene.parts.notes.warnings;
    for name in lost.iter().take(MOST_NOTES) {
        warnings.push(format!("the extension `{}` is not read", quoted(name)));
    }
    if lost.len() > MOST_NOTES {
        warnings.push(format!("{} more extensions are not read", lost.len() - MOST_NOTES));
    }
}

#[cfg(test)]
mod tests;
