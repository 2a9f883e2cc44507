//! Files of rays: raw `ox oy oz dx dy dz tmin tmax` as little-endian f32, or .npy of shape (n, 8). Files of
//! points likewise: raw `x y z`, or .npy of shape (n, 3).

use super::failure::Failure;
use super::npy;
use splitplane::Ray;
use std::fs;
use std::path::Path;

pub(super) fn read(path: &Path) -> Result<Vec<Ray>, Failure> {
    let rows = rows(path, "rays", "a ray is eight little-endian f32: ox oy oz dx dy dz tmin tmax")?;
    Ok(rows.into_iter().map(ray).collect())
}

pub(super) fn read_points(path: &Path) -> Result<Vec<[f32; 3]>, Failure> {
    rows(path, "points", "a point is three little-endian f32: x y z")
}

/// Rows of N numbers; `what` they are, and what one is.
fn rows<const N: usize>(path: &Path, what: &str, one: &str) -> Result<Vec<[f32; N]>, Failure> {
    let shown = path.display();
    let failed = |error: &dyn std::fmt::Display| {
        Failure::file(format!("cannot read the {what} in `{shown}`: {error}"))
    };
    let bytes = fs::read(path).map_err(|error| failed(&error))?;
    let named_npy = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npy"));
    if named_npy || npy::is_npy(&bytes) {
        return npy::read_rows(&bytes).map_err(|error| failed(&error));
    }
    let (numbers, rest) = bytes.as_chunks::<4>();
    let rows = numbers.chunks_exact(N);
    if !rest.is_empty() || !rows.remainder().is_empty() {
        return Err(Failure::file(format!(
            "`{shown}` has {} bytes, which is not a multiple of {}; {one}",
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
