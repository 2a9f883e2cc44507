//! Files of rays: raw `ox oy oz dx dy dz tmin tmax` as little-endian f32, or .npy of shape (n, 8). Files of
//! points likewise: raw `x y z`, or .npy of shape (n, 3).

use super::failure::Failure;
use super::npy;
use splitplane::Ray;
use std::fs;
use std::path::Path;

const RAYS: [&str; 2] = ["rays", "a ray is eight little-endian f32: ox oy oz dx dy dz tmin tmax"];
const POINTS: [&str; 2] = ["points", "a point is three little-endian f32: x y z"];

pub(super) fn read(path: &Path) -> Result<Vec<Ray>, Failure> {
    parse(path, &read_bytes(path, RAYS)?)
}

/// The rays in the bytes of a file, whose name may say what they are.
///
/// # Errors
/// The bytes are not rays; the message names the file.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Ray>, Failure> {
    Ok(rows(path, bytes, RAYS)?.into_iter().map(ray).collect())
}

pub(super) fn read_points(path: &Path) -> Result<Vec<[f32; 3]>, Failure> {
    rows(path, &read_bytes(path, POINTS)?, POINTS)
}

fn failed(path: &Path, what: &str, error: &dyn std::fmt::Display) -> Failure {
    Failure::file(format!("cannot read the {what} in `{}`: {error}", path.display()))
}

fn read_bytes(path: &Path, [what, _]: [&str; 2]) -> Result<Vec<u8>, Failure> {
    fs::read(path).map_err(|error| failed(path, what, &error))
}

/// Rows of N numbers; `what` they are, and what one is.
fn rows<const N: usize>(
    path: &Path,
    bytes: &[u8],
    [what, one]: [&str; 2],
) -> Result<Vec<[f32; N]>, Failure> {
    let named_npy = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npy"));
    if named_npy || npy::is_npy(bytes) {
        return npy::read_rows(bytes).map_err(|error| failed(path, what, &error));
    }
    let (numbers, rest) = bytes.as_chunks::<4>();
    let rows = numbers.chunks_exact(N);
    if !rest.is_empty() || !rows.remainder().is_empty() {
        return Err(Failure::file(format!(
            "`{}` has {} bytes, which is not a multiple of {}; {one}",
            path.display(),
            bytes.len(),
            4 * N
        )));
    }
    Ok(rows.map(|row| std::array::from_fn(|i| f32::from_le_bytes(row[i]))).collect())
}

/// The order of the file is that of users; a [`Ray`] in memory has another one.
fn ray([ox, oy, oz, dx, dy, dz, t_min, t_max]: [f32; 8]) -> Ray {
    Ray { origin: [ox, oy, oz], t_min, direction: [dx, dy, dz], t_max }
}
