//! Scenes made here: the same triangles on every machine, from whole numbers and `+ - * /` only.

mod angle;
mod builder;
mod city;
mod cornell;
mod gallery;
mod paint;
mod shape;
mod spheres;
mod stadium;

use super::Scene;
use thiserror::Error;

/// The names of the built-in scenes with what they show, in the order a help text lists them.
pub const ALL: [(&str, &str); 5] = [
    ("cornell", "a box with two blocks, open to the front"),
    ("spheres", "a field of spheres, glass and metal among them"),
    ("gallery", "a room of mirrors, glass, water and textures under a shining panel"),
    ("stadium", "a small, finely tessellated knot in a huge, sparse arena"),
    ("city", "streets and towers; city:N has about N triangles, 1000 to 10000000"),
];

/// Why there is no such built-in scene.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BuiltinError {
    /// No scene has this name.
    #[error("there is no built-in scene `{0}`; there are {names}", names = names())]
    Unknown(String),
    /// The scene comes in one size only.
    #[error("the built-in scene `{0}` comes in one size; leave the size out")]
    OneSize(String),
    /// The size is not a number in range.
    #[error("`{0}` is not a size of a city; give a number of triangles from {least} to {most}",
        least = city::LEAST, most = city::MOST)]
    BadSize(String),
}

/// The names of the built-in scenes, for messages.
pub(super) fn names() -> String {
    ALL.map(|(name, _)| format!("builtin:{name}")).join(", ")
}

/// Makes the scene called `NAME` or `NAME:SIZE`.
///
/// # Errors
/// No scene has this name, or it cannot have this size.
pub fn open(name: &str) -> Result<Scene, BuiltinError> {
    let (name, size) = match name.split_once(':') {
        Some((name, size)) => (name, Some(size)),
        None => (name, None),
    };
    let one_size: fn() -> Scene = match name {
        "city" => return city::open(size),
        "cornell" => cornell::make,
        "gallery" => gallery::make,
        "spheres" => spheres::make,
        "stadium" => stadium::make,
        _ => return Err(BuiltinError::Unknown(name.to_owned())),
    };
    match size {
        None => Ok(one_size()),
        Some(_) => Err(BuiltinError::OneSize(name.to_owned())),
    }
}
