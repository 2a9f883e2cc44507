//! Environment maps from files: Radiance (.hdr) and OpenEXR (.exr).

use crate::from_file::{self, ReadError, quoted_path, quoted_reason};
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;
use image::codecs::openexr::OpenExrDecoder;
use splitplane_float_state::Standard;
use splitplane_render::{EnvironmentMap, EnvironmentMapError};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use thiserror::Error;

#[cfg(test)]
mod tests;

/// How a file becomes an environment map.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentOptions {
    /// Turns the map about `y`, counter-clockwise seen from above.
    pub rotation_degrees: f32,
    /// A factor of its radiance.
    pub strength: f32,
    /// Most bytes that decoding it may take.
    pub decode_limit: u64,
    /// Most bytes of the file; `None` is half of the machine's memory.
    pub file_limit: Option<u64>,
}

impl Default for EnvironmentOptions {
    fn default() -> EnvironmentOptions {
        EnvironmentOptions {
            rotation_degrees: 0.0,
            strength: 1.0,
            decode_limit: crate::SceneOptions::DECODE_LIMIT,
            file_limit: None,
        }
    }
}

/// A file that is no environment map, and why.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("cannot read the environment in `{path}`: {problem}", path = quoted_path(.file))]
pub struct EnvironmentError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong.
    pub problem: EnvironmentProblem,
}

#[cfg(feature = "json")]
impl EnvironmentError {
    /// Whether the file is well, but too bright with the strength that was asked for.
    pub(crate) fn is_of_strength(&self) -> bool {
        matches!(self.problem, EnvironmentProblem::Map(EnvironmentMapError::Strength { .. }))
    }
}

/// What is wrong with the file of an environment map.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum EnvironmentProblem {
    /// The system refuses, or it is no file.
    #[error("{0}")]
    Unreadable(String),
    /// The file has more bytes than are read.
    #[error("{0}")]
    TooLong(String),
    /// It begins as neither format does.
    #[error("it is neither a Radiance picture (.hdr) nor an OpenEXR picture (.exr)")]
    Format,
    /// Decoding it takes more than is allowed.
    #[error("decoding its {width}x{height} texels takes {needed} bytes, and {limit} are allowed")]
    TooLarge {
        /// Texels from left to right.
        width: u32,
        /// Texels from top to bottom.
        height: u32,
        /// Bytes that decoding takes.
        needed: u64,
        /// The limit.
        limit: u64,
    },
    /// The picture is damaged, or of a kind that is not read.
    #[error("{0}")]
    Picture(String),
    /// The picture is no environment.
    #[error(transparent)]
    Map(#[from] EnvironmentMapError),
}

impl EnvironmentProblem {
    /// Whether a limit binds, not the file.
    pub fn is_limit(&self) -> bool {
        use EnvironmentProblem::{Map, TooLarge, TooLong};
        matches!(self, TooLong(_) | TooLarge { .. } | Map(EnvironmentMapError::Memory { .. }))
    }
}

/// A map, and what was changed in it.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadEnvironment {
    /// The map.
    pub map: EnvironmentMap,
    /// Texels of which a channel is negative, as filters make them; it counts as 0.
    pub negative: u64,
}

impl ReadEnvironment {
    /// A sentence on what was changed, where something was.
    pub fn note(&self, path: &Path) -> Option<String> {
        let path = quoted_path(path);
        let negative = self.negative;
        (negative > 0)
            .then(|| format!("{negative} texels of `{path}` are negative; that counts as 0"))
    }
}

/// Reads a Radiance or OpenEXR picture, which one is told by how it begins: a picture of all directions as [`EnvironmentMap`] describes it.
///
/// Of a Radiance picture the values are divided by its exposure and colour correction. Of an OpenEXR picture the first layer with red, green and blue is taken.
///
/// # Errors
/// See [`EnvironmentProblem`].
pub fn read(
    path: &Path,
    options: &EnvironmentOptions,
) -> Result<ReadEnvironment, EnvironmentError> {
    let _state = Standard::set();
    let fail = |problem| EnvironmentError { file: path.to_owned(), problem };
    let limit = options.file_limit.unwrap_or_else(from_file::usual_limit);
    let bytes = from_file::read(path, limit).map_err(|error| {
        fail(match &error {
            limit if limit.is_limit() => EnvironmentProblem::TooLong(limit.to_string()),
            ReadError::System(system) if system.kind() == std::io::ErrorKind::NotFound => {
                EnvironmentProblem::Unreadable("there is no such file".to_owned())
            }
            error => EnvironmentProblem::Unreadable(error.to_string()),
        })
    })?;
    parse(&bytes, options).map_err(fail)
}

/// The map in the bytes of a file.
///
/// # Errors
/// As for [`read`].
pub fn parse(
    bytes: &[u8],
    options: &EnvironmentOptions,
) -> Result<ReadEnvironment, EnvironmentProblem> {
    let _state = Standard::set();
    let (size, mut texels) = if bytes.starts_with(b"#?") {
        hdr(bytes, options.decode_limit)?
    } else if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        let decoder = OpenExrDecoder::with_alpha_preference(Cursor::new(bytes), Some(false));
        decode(decoder.map_err(picture)?, options.decode_limit)?
    } else {
        return Err(EnvironmentProblem::Format);
    };
    let mut negative = 0;
    for texel in &mut texels {
        let is_negative = texel.iter().any(|part| *part < 0.0);
        negative += u64::from(is_negative);
        if is_negative {
            *texel = texel.map(|part| if part < 0.0 { 0.0 } else { part });
        }
    }
    let map = EnvironmentMap::new(size[0], size[1], texels)?
        .with_strength(options.strength)?
        .with_rotation(options.rotation_degrees)?;
    Ok(ReadEnvironment { map, negative })
}

/// A Radiance picture, with what its head says of exposures undone.
fn hdr(bytes: &[u8], limit: u64) -> Result<([u32; 2], Vec<[f32; 3]>), EnvironmentProblem> {
    let decoder = HdrDecoder::new(Cursor::new(bytes)).map_err(picture)?;
    let about = decoder.metadata();
    let (r, g, b) = about.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let divisor = [r, g, b].map(|part| part * about.exposure.unwrap_or(1.0));
    if !divisor.iter().all(|part| part.is_finite() && *part > 0.0) {
        let shown = divisor.map(|part| part.to_string()).join(", ");
        let message =
            format!("its exposure or colour correction, together {shown}, is not positive");
        return Err(EnvironmentProblem::Picture(message));
    }
    let (size, mut texels) = decode(decoder, limit)?;
    if divisor != [1.0; 3] {
        for texel in &mut texels {
            *texel = core::array::from_fn(|channel| texel[channel] / divisor[channel]);
        }
    }
    Ok((size, texels))
}

fn picture(error: image::ImageError) -> EnvironmentProblem {
    EnvironmentProblem::Picture(quoted_reason(&error.to_string()))
}

/// The texels of a picture of three floats each.
fn decode(
    decoder: impl ImageDecoder,
    limit: u64,
) -> Result<([u32; 2], Vec<[f32; 3]>), EnvironmentProblem> {
    let (width, height) = decoder.dimensions();
    let count = u64::from(width) * u64::from(height);
    // The picture, the decoder's own copy of it, and the map's tables.
    let needed = count.saturating_mul(12 + 12 + 4);
    if needed > limit {
        return Err(EnvironmentProblem::TooLarge { width, height, needed, limit });
    }
    let memory = || EnvironmentMapError::Memory { width, height };
    let count = usize::try_from(count).map_err(|_| memory())?;
    // The decoder ends the program where there is none for its copy.
    let room = Vec::<[f32; 3]>::new().try_reserve_exact(2 * count);
    room.map_err(|_| memory())?;
    let mut texels = vec![[0.0f32; 3]; count];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(texels.as_flattened_mut());
    if decoder.total_bytes() != bytes.len() as u64 {
        return Err(EnvironmentProblem::Picture("it is not of three channels".to_owned()));
    }
    decoder.read_image(bytes).map_err(picture)?;
    Ok(([width, height], texels))
}
