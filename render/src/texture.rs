//! Pictures on surfaces.

use core::fmt;

/// A picture: sRGB texels of 8 bits per channel, row by row from the top left.
///
/// The texture coordinate (0, 0) is its lower left corner, (1, 1) its upper right one; beyond, the
/// picture repeats.
#[derive(Clone, PartialEq, Eq)]
pub struct Texture {
    name: String,
    width: u32,
    height: u32,
    texels: Vec<[u8; 4]>,
}

impl Texture {
    /// A texture from `width * height` texels of red, green, blue and alpha, which is not used.
    /// `None` when a side is zero or the number of texels is another.
    pub fn new(
        name: impl Into<String>,
        width: u32,
        height: u32,
        texels: Vec<[u8; 4]>,
    ) -> Option<Texture> {
        let count = u64::from(width) * u64::from(height);
        (count > 0 && count == texels.len() as u64).then(|| Texture {
            name: name.into(),
            width,
            height,
            texels,
        })
    }

    /// The file's name, or a name of ours.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Texels from left to right.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Texels from top to bottom.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The texels, row by row from the top left.
    pub fn texels(&self) -> &[[u8; 4]] {
        &self.texels
    }
}

impl fmt::Debug for Texture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Texture({}, {}x{})", self.name, self.width, self.height)
    }
}
