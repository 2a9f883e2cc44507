//! Scenes made here: the same triangles on every machine, from whole numbers and `+ - * /` only.

mod builder;
pub(super) mod carousel;
mod city;
mod cornell;
mod flock;
mod forest;
mod gallery;
mod hills;
mod paint;
mod shape;
mod spheres;
mod stadium;

use super::{InstancedScene, Scene};
use splitplane_float_state::Standard;
use thiserror::Error;

/// The names of the built-in scenes with what they show, in the order a help text lists them.
pub const ALL: [(&str, &str); 6] = [
    ("cornell", "a box with two blocks, open to the front"),
    ("spheres", "a field of spheres, glass and metal among them"),
    ("gallery", "a room of mirrors, glass, water and textures under a shining panel"),
    ("stadium", "a small, finely tessellated knot in a huge, sparse arena"),
    ("carousel", "a merry-go-round, which moves; carousel:N has about N triangles, from 4000"),
    ("city", "streets and towers; city:N has about N triangles, 1000 to 10000000"),
];

/// The names of the built-in scenes of many objects, which [`InstancedScene`] opens.
pub const INSTANCED: [(&str, &str); 2] = [
    ("forest", "trees and rocks on hills; forest:N has N objects, 10 to 1000000"),
    ("flock", "birds that circle over a lake, which move; flock:N has N birds, 10 to 20000"),
];

/// Why there is no such built-in scene.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BuiltinError {
    /// No scene has this name.
    #[error("there is no built-in scene `{0}`; there are {names}", names = names())]
    Unknown(String),
    /// The scene is one of many objects, and one mesh was asked for.
    #[error(
        "the built-in scene `{0}` has many objects, and one mesh is asked for; render, animate, view, build, query and verify \
         take such scenes"
    )]
    ManyObjects(String),
    /// The scene comes in one size only.
    #[error("the built-in scene `{0}` comes in one size; leave the size out")]
    OneSize(String),
    /// The size is not a number in range.
    #[error(
        "`{size}` is not a size of builtin:{scene}; give a number of {unit} from {least} to {most}",
        unit = if is_instanced(scene) { "objects" } else { "triangles" }
    )]
    BadSize {
        /// The scene's name.
        scene: &'static str,
        /// The size as written.
        size: String,
        /// Fewest triangles, or objects, it can have.
        least: u64,
        /// Most triangles, or objects, it can have.
        most: u64,
    },
}

/// The names of the built-in scenes, for messages.
pub(super) fn names() -> String {
    let all = ALL.iter().chain(&INSTANCED);
    all.map(|(name, _)| format!("builtin:{name}")).collect::<Vec<_>>().join(", ")
}

/// The number of triangles that a user asks for.
fn size(
    scene: &'static str,
    text: Option<&str>,
    default: u64,
    [least, most]: [u64; 2],
) -> Result<u64, BuiltinError> {
    let Some(text) = text else { return Ok(default) };
    let size = text.parse().ok().filter(|size| (least..=most).contains(size));
    size.ok_or_else(|| BuiltinError::BadSize { scene, size: text.to_owned(), least, most })
}

/// The scene of this name in its first frame and how it moves; `None` for one that does not move.
#[cfg(feature = "animation")]
pub(super) fn moving(name: &str) -> Result<Option<(Scene, carousel::Motion)>, BuiltinError> {
    let (known, size) = parts(name);
    match known {
        "carousel" => carousel::open(size).map(Some),
        _ if ALL.iter().any(|(other, _)| *other == known) => Ok(None),
        _ => Err(BuiltinError::Unknown(known.to_owned())),
    }
}

/// Whether this is the name of a scene of many objects.
pub(super) fn is_instanced(name: &str) -> bool {
    let (name, _) = parts(name);
    INSTANCED.iter().any(|(known, _)| *known == name)
}

/// Makes the scene of many objects called `NAME` or `NAME:SIZE`.
pub(super) fn open_instanced(name: &str) -> Result<InstancedScene, BuiltinError> {
    let (name, size) = parts(name);
    match name {
        "forest" => forest::open(size),
        "flock" => flock::open(size),
        _ => Err(BuiltinError::Unknown(name.to_owned())),
    }
}

/// Name and size.
fn parts(name: &str) -> (&str, Option<&str>) {
    match name.split_once(':') {
        Some((name, size)) => (name, Some(size)),
        None => (name, None),
    }
}

/// Makes the scene called `NAME` or `NAME:SIZE`.
///
/// # Errors
/// No scene has this name, or it cannot have this size.
pub fn open(name: &str) -> Result<Scene, BuiltinError> {
    let _state = Standard::set();
    let (name, size) = parts(name);
    let one_size: fn() -> Scene = match name {
        "carousel" => return carousel::open(size).map(|(scene, _)| scene),
        "city" => return city::open(size),
        "cornell" => cornell::make,
        "gallery" => gallery::make,
        "spheres" => spheres::make,
        "stadium" => stadium::make,
        _ if is_instanced(name) => return Err(BuiltinError::ManyObjects(name.to_owned())),
        _ => return Err(BuiltinError::Unknown(name.to_owned())),
    };
    match size {
        None => Ok(one_size()),
        Some(_) => Err(BuiltinError::OneSize(name.to_owned())),
    }
}
