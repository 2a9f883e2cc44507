//! Files of parts of pictures, `.picpart`.
//!
//! | bytes | meaning |
//! |---|---|
//! | 0..8 | `PICPART` and a zero |
//! | 8..12 | version of the format, [`VERSION`] |
//! | 12..16 | bytes of the description, at most [`MOST_DESCRIPTION`] |
//! | 16.. | the description: JSON in UTF-8, see [`Description`] |
//! | then | arrays of the part's pixels, in this order, those that the description asks for |
//! | last 8 | XXH64 with the version as seed of all bytes before |
//!
//! Arrays: radiance, three f32 a pixel; colours for a screen, one word a pixel, red in the lowest byte, then green, blue and 255;
//! first hits, eight words a pixel; costs, two words a pixel. All numbers are little-endian.

use super::made::{Made, Wanted};
use super::part_settings::Settings;
use serde::{Deserialize, Serialize};
use splitplane::core::tree::digest::Xxh64;
use splitplane::picture::{FirstCost, FirstHit};
use splitplane::render::{Part, PartError, Size, SizeError};
use splitplane_scene::from_file::{quoted, quoted_reason};
use thiserror::Error;

const MAGIC: &[u8; 8] = b"PICPART\0";
/// The version of the format.
const VERSION: u32 = 1;
/// Bytes before the description.
const HEAD: usize = 16;
/// Bytes behind the arrays.
const TAIL: usize = 8;
/// Most bytes of a description.
const MOST_DESCRIPTION: usize = 1 << 16;

/// What a part is part of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Description {
    /// Which part it is, from 1.
    index: u32,
    count: u32,
    width: u32,
    height: u32,
    wanted: Wanted,
    settings: Settings,
}

/// A part as a file has it.
#[derive(Debug)]
pub(super) struct PartFile {
    pub(super) part: Part,
    pub(super) size: Size,
    pub(super) wanted: Wanted,
    pub(super) settings: Settings,
    pub(super) radiance: Vec<[f32; 4]>,
    pub(super) pixels: Vec<u32>,
    pub(super) hits: Vec<FirstHit>,
    pub(super) costs: Vec<FirstCost>,
}

/// What is wrong with the file of a part.
#[derive(Debug, PartialEq, Eq, Error)]
pub(super) enum PartFileError {
    #[error("it does not start as the file of a part does")]
    Magic,
    #[error("bytes 8 to 11: its version is {0}; {VERSION} is the one that is known")]
    Version(u32),
    #[error("it ends after {found} bytes, within the first {needed}")]
    Head { found: usize, needed: usize },
    #[error("bytes 12 to 15: its description has {0} bytes; at most {MOST_DESCRIPTION} are read")]
    LongDescription(u32),
    #[error("its description, from byte {HEAD} on, is damaged: {0}")]
    Description(String),
    #[error("its description: {0}")]
    Part(#[from] PartError),
    #[error("its description: {0}")]
    Size(#[from] SizeError),
    #[error("its description promises {promised} bytes in all, but it has {found}")]
    Length { promised: u64, found: u64 },
    #[error("its last 8 bytes are not the checksum of the others; it is damaged")]
    Checksum,
    #[error("there is not memory enough for its pixels")]
    Memory,
}

/// The bytes that arrays of so many pixels have.
fn array_bytes(wanted: &Wanted, pixels: u64) -> u64 {
    let outputs = wanted.outputs(true, true);
    let words = 3 * u64::from(outputs.radiance)
        + u64::from(outputs.pixels)
        + 8 * u64::from(outputs.first_hits)
        + 2 * u64::from(outputs.first_costs);
    4 * words * pixels
}

/// The bytes of a file. `made` has the arrays of the whole picture, of which the part's pixels are right.
///
/// # Errors
/// No memory.
pub(super) fn to_bytes(
    part: Part,
    wanted: &Wanted,
    settings: &Settings,
    made: &Made<'_>,
) -> Result<Vec<u8>, PartFileError> {
    let Made { size, hits, costs, radiance, pixels } = *made;
    let own = part.share(size.pixels());
    let description = Description {
        index: part.index(),
        count: part.count(),
        width: size.width(),
        height: size.height(),
        wanted: wanted.clone(),
        settings: settings.clone(),
    };
    let description = serde_json::to_vec(&description)
        .map_err(|error| PartFileError::Description(error.to_string()))?;
    let arrays = array_bytes(wanted, own.len() as u64) as usize;
    let mut bytes = Vec::new();
    bytes
        .try_reserve_exact(HEAD + description.len() + arrays + TAIL)
        .map_err(|_| PartFileError::Memory)?;
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend((description.len() as u32).to_le_bytes());
    bytes.extend(description);
    let own = own.start as usize..own.end as usize;
    // What was not asked for is empty.
    for light in radiance.get(own.clone()).unwrap_or_default() {
        bytes.extend(light[..3].iter().flat_map(|part| part.to_le_bytes()));
    }
    for pixel in pixels.get(own.clone()).unwrap_or_default() {
        bytes.extend(pixel.to_le_bytes());
    }
    for hit in hits.get(own.clone()).unwrap_or_default() {
        let FirstHit { normal: [x, y, z], depth, triangle, u, v, instance } = *hit;
        let [x, y, z, depth, u, v] = [x, y, z, depth, u, v].map(f32::to_bits);
        let words = [x, y, z, depth, triangle, u, v, instance];
        bytes.extend(words.into_iter().flat_map(u32::to_le_bytes));
    }
    for cost in costs.get(own).unwrap_or_default() {
        bytes.extend([cost.nodes, cost.triangles].into_iter().flat_map(u32::to_le_bytes));
    }
    bytes.extend(checksum(&bytes).to_le_bytes());
    Ok(bytes)
}

fn checksum(bytes: &[u8]) -> u64 {
    let mut state = Xxh64::new(u64::from(VERSION));
    state.write(bytes);
    state.finish()
}

/// The part in the bytes of a file. No memory is made that the bytes do not fill.
///
/// # Errors
/// Bytes that are no such file, or no memory.
pub(super) fn parse(bytes: &[u8]) -> Result<PartFile, PartFileError> {
    let found = bytes.len();
    if !bytes.starts_with(&MAGIC[..found.min(8)]) {
        return Err(PartFileError::Magic);
    }
    let (Some(version), Some(length)) = (word(bytes, 8), word(bytes, 12)) else {
        return Err(PartFileError::Head { found, needed: HEAD });
    };
    if version != VERSION {
        return Err(PartFileError::Version(version));
    }
    if length as usize > MOST_DESCRIPTION {
        return Err(PartFileError::LongDescription(length));
    }
    let end = HEAD + length as usize;
    let text = bytes.get(HEAD..end).ok_or(PartFileError::Head { found, needed: end })?;
    let description: Description = serde_json::from_slice(text)
        .map_err(|error| PartFileError::Description(quoted_reason(&error.to_string())))?;
    let Description { index, count, width, height, wanted, settings } = description;
    let (part, size) = (Part::new(index, count)?, Size::new(width, height)?);
    let pixels = part.share(size.pixels()).len();
    let promised = (end + TAIL) as u64 + array_bytes(&wanted, pixels as u64);
    if promised != found as u64 {
        return Err(PartFileError::Length { promised, found: found as u64 });
    }
    let (all, sum) = bytes.split_at(found - TAIL);
    if sum != checksum(all).to_le_bytes() {
        return Err(PartFileError::Checksum);
    }
    let outputs = wanted.outputs(true, true);
    let mut rest = all[end..].as_chunks::<4>().0;
    let mut take = |needed: bool, words: usize| {
        let (own, others) = rest.split_at(if needed { words * pixels } else { 0 });
        rest = others;
        own
    };
    let radiance = rows(take(outputs.radiance, 3), |[r, g, b]: [u32; 3]| {
        let [r, g, b] = [r, g, b].map(f32::from_bits);
        [r, g, b, 0.0]
    })?;
    let colours = rows(take(outputs.pixels, 1), |[word]: [u32; 1]| word)?;
    let hits = rows(take(outputs.first_hits, 8), |[x, y, z, depth, triangle, u, v, instance]| {
        let [x, y, z, depth, u, v] = [x, y, z, depth, u, v].map(f32::from_bits);
        FirstHit { normal: [x, y, z], depth, triangle, u, v, instance }
    })?;
    let costs = rows(take(outputs.first_costs, 2), |[nodes, triangles]: [u32; 2]| FirstCost {
        nodes,
        triangles,
    })?;
    Ok(PartFile { part, size, wanted, settings, radiance, pixels: colours, hits, costs })
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

/// What `make` makes of rows of N words.
fn rows<const N: usize, T>(
    words: &[[u8; 4]],
    make: impl Fn([u32; N]) -> T,
) -> Result<Vec<T>, PartFileError> {
    let (found, _) = words.as_chunks::<N>();
    let mut rows = Vec::new();
    rows.try_reserve_exact(found.len()).map_err(|_| PartFileError::Memory)?;
    rows.extend(found.iter().map(|row| make(row.map(u32::from_le_bytes))));
    Ok(rows)
}

impl PartFile {
    /// In what another part is not of the same picture: what, here, there. The first difference by name.
    pub(super) fn difference(&self, other: &PartFile) -> Option<[String; 3]> {
        let differ = |name: &str, here: String, there: String| {
            (here != there).then(|| [name, &here, &there].map(quoted))
        };
        let sizes =
            [self, other].map(|part| format!("{}x{}", part.size.width(), part.size.height()));
        let counts = [self, other].map(|part| part.part.count().to_string());
        let wanted =
            [self, other].map(|part| serde_json::to_string(&part.wanted).unwrap_or_default());
        let own = [("size", sizes), ("number of parts", counts), ("outputs", wanted)];
        own.into_iter().find_map(|(name, [here, there])| differ(name, here, there)).or_else(|| {
            let names = self.settings.keys().chain(other.settings.keys());
            let value = |settings: &Settings, name: &str| {
                settings.get(name).map_or("not said".to_owned(), String::clone)
            };
            // What is said of the picture comes before what follows from it.
            let mut names: Vec<&String> = names.collect();
            names.sort_by_key(|name| (DERIVED.contains(&name.as_str()), name.as_str()));
            names.into_iter().find_map(|name| {
                differ(name, value(&self.settings, name), value(&other.settings, name))
            })
        })
    }
}

/// Settings whose values are names of what they come from: less is learnt of them.
const DERIVED: [&str; 3] = ["materials and lights", "tree", "triangles"];

#[cfg(test)]
mod tests;
