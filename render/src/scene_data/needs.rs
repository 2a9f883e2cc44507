//! What a scene asks of a renderer.

/// What the materials and lights of a scene need.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Needs {
    /// Surfaces that scatter light evenly.
    pub diffuse: bool,
    /// Mirrors.
    pub mirrors: bool,
    /// Clear bodies.
    pub dielectrics: bool,
    /// Rough mirrors or clear bodies.
    pub rough: bool,
    /// Textures.
    pub textures: bool,
    /// Normals at the corners of triangles.
    pub smooth_normals: bool,
    /// Lights without a size.
    pub lights: u32,
    /// Triangles that shine.
    pub emitters: u32,
    /// An environment map: on the CPU alone.
    pub environment_map: bool,
}
