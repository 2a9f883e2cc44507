//! How a scene looks, as its owner has it.

use crate::environment_map::EnvironmentMap;
use crate::light::Light;
use crate::material::Material;
use crate::texture::Texture;
use std::sync::Arc;
use thiserror::Error;

/// The appearance of a scene, borrowed. Lists of things that a scene does not have are empty; lists
/// by triangle may be shorter than the mesh.
#[derive(Clone, Copy, Debug, Default)]
pub struct Appearance<'a> {
    /// The materials; triangles without one are clay.
    pub materials: &'a [Material],
    /// For every triangle the index of its material.
    pub material_of: &'a [u32],
    /// Lights without a size.
    pub lights: &'a [Light],
    /// Textures that materials name.
    pub textures: &'a [Texture],
    /// Normals, of any length; zero for none.
    pub normals: &'a [[f32; 3]],
    /// For every triangle the normals of its corners; [`NONE`](super::NONE) for none.
    pub normal_indices: &'a [[u32; 3]],
    /// Texture coordinates.
    pub texcoords: &'a [[f32; 2]],
    /// For every triangle the texture coordinates of its corners; [`NONE`](super::NONE) for (0, 0).
    pub texcoord_indices: &'a [[u32; 3]],
    /// Light from everywhere, in place of that of [`RenderSettings::environment`](crate::RenderSettings::environment).
    pub environment: Option<&'a Arc<EnvironmentMap>>,
}

/// Why a scene's appearance cannot be described.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum AppearanceError {
    /// More words than 32 bits can address.
    #[error(
        "materials, normals and textures would need {words} words of 4 bytes, more than {}",
        u32::MAX
    )]
    TooLarge {
        /// Words needed.
        words: u64,
    },
    /// A geometry of a scene of instances whose triangles are not among those that are described.
    #[error(
        "the triangles of geometry {geometry} are not among those that the appearance describes"
    )]
    MissingGeometry {
        /// The geometry.
        geometry: u32,
    },
}
