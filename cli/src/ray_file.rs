//! Files of rays: raw `ox oy oz dx dy dz tmin tmax` as little-endian f32, or .npy of shape (n, 8). Files of
//! points likewise: raw `x y z`, or .npy of shape (n, 3).

use super::failure::Failure;
use super::npy::{self, NpyError};
use splitplane::Ray;
use splitplane_scene::from_file::{self, ReadError, quoted_path};
use std::path::Path;

const RAYS: [&str; 2] = ["rays", "a ray is eight little-endian f32: ox oy oz dx dy dz tmin tmax"];
const POINTS: [&str; 2] = ["points", "a point is three little-endian f32: x y z"];

/// Reads a file, a pipe or a device of at most so many bytes.
pub(super) fn read(path: &Path, limit: Option<u64>) -> Result<Vec<Ray>, Failure> {
    parse(path, &read_bytes(path, limit, RAYS)?)
}

/// The rays in the bytes of a file, whose name may say what they are.
///
/// # Errors
/// The bytes are not rays; the message names the file.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Ray>, Failure> {
    rows(path, bytes, RAYS, ray)
}

pub(super) fn read_points(path: &Path, limit: Option<u64>) -> Result<Vec<[f32; 3]>, Failure> {
    rows(path, &read_bytes(path, limit, POINTS)?, POINTS, |point| point)
}

fn failed(path: &Path, what: &str, error: &dyn std::fmt::Display) -> String {
    format!("cannot read the {what} in `{}`: {error}", quoted_path(path))
}

fn read_bytes(path: &Path, limit: Option<u64>, [what, _]: [&str; 2]) -> Result<Vec<u8>, Failure> {
    from_file::read_any(path, limit).map_err(|error| {
        let mut message = failed(path, what, &error);
        if let ReadError::TooLong { .. } = error {
            message += "; --max-file allows more";
        }
        if error.is_limit() { Failure::limit(message) } else { Failure::file(message) }
    })
}

/// What `make` makes of rows of N numbers; `what` they are, and what one is.
fn rows<const N: usize, T>(
    path: &Path,
    bytes: &[u8],
    [what, one]: [&str; 2],
    make: impl Fn([f32; N]) -> T,
) -> Result<Vec<T>, Failure> {
    let named_npy = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npy"));
    let memory = |error: NpyError| Failure::limit(failed(path, what, &error));
    if named_npy || npy::is_npy(bytes) {
        return npy::read_rows(bytes, make).map_err(|error| match error {
            NpyError::Memory => memory(error),
            error => Failure::file(failed(path, what, &error)),
        });
    }
    let (numbers, rest) = bytes.as_chunks::<4>();
    let (found, left) = numbers.as_chunks::<N>();
    if !rest.is_empty() || !left.is_empty() {
        return Err(Failure::file(format!(
            "`{}` has {} bytes, which is not a multiple of {}; {one}",
            quoted_path(path),
            bytes.len(),
            4 * N
        )));
    }
    let mut rows = Vec::new();
    rows.try_reserve_exact(found.len()).map_err(|_| memory(NpyError::Memory))?;
    rows.extend(found.iter().map(|row| make(row.map(f32::from_le_bytes))));
    Ok(rows)
}

/// The order of the file is that of users; a [`Ray`] in memory has another one.
fn ray([ox, oy, oz, dx, dy, dz, t_min, t_max]: [f32; 8]) -> Ray {
    Ray { origin: [ox, oy, oz], t_min, direction: [dx, dy, dz], t_max }
}
