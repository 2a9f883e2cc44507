//! Files of hits: 16-byte records `t triangle u v`, or one byte a ray; .npy by the file's ending.

use super::failure::Failure;
use super::{npy, output};
use splitplane::Hit;
use std::path::Path;

const HIT_TYPE: &str = "[('t', '<f4'), ('triangle', '<u4'), ('u', '<f4'), ('v', '<f4')]";

/// The answer of any hit for a ray that was left undecided.
const NO_ANSWER: u8 = 255;

/// Writes closest hits; a miss is `inf 4294967295 0 0`.
pub(super) fn write_closest(path: &Path, hits: &[Hit]) -> Result<(), Failure> {
    let mut bytes = start(path, HIT_TYPE, hits.len());
    for hit in hits {
        let words = [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()];
        bytes.extend(words.into_iter().flat_map(u32::to_le_bytes));
    }
    output::file(path, &bytes)
}

/// Writes 1 for every ray that hits anything, 0 for the others; [`NO_ANSWER`] at the places in
/// `flagged`.
pub(super) fn write_any(path: &Path, hits: &[bool], flagged: &[usize]) -> Result<(), Failure> {
    let mut bytes = start(path, "'|u1'", hits.len());
    let first = bytes.len();
    bytes.extend(hits.iter().map(|&hit| u8::from(hit)));
    for &place in flagged {
        bytes[first + place] = NO_ANSWER;
    }
    output::file(path, &bytes)
}

fn start(path: &Path, kind: &str, count: usize) -> Vec<u8> {
    match path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npy")) {
        true => npy::header(kind, count),
        false => Vec::new(),
    }
}
