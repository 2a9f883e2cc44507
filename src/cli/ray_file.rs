//! Files of rays: raw `ox oy oz dx dy dz tmin tmax` as little-endian f32, or .npy of shape (n, 8).

use super::failure::Failure;
use super::npy;
use splitplane::Ray;
use std::fs;
use std::path::Path;

/// Bytes of a ray in a raw file.
const RAY: usize = 32;

pub(super) fn read(path: &Path) -> Result<Vec<Ray>, Failure> {
    let shown = path.display();
    let bytes = fs::read(path)
        .map_err(|error| Failure::file(format!("cannot read the rays in `{shown}`: {error}")))?;
    parse(path, &bytes)
}

/// The rays in the bytes of a file, whose name may say what they are.
///
/// # Errors
/// The bytes are not rays; the message names the file.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Ray>, Failure> {
    let shown = path.display();
    let named_npy = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npy"));
    let rows = if named_npy || npy::is_npy(bytes) {
        npy::read_rows_of_8(bytes)
            .map_err(|error| Failure::file(format!("cannot read the rays in `{shown}`: {error}")))?
    } else {
        let (rays, rest) = bytes.as_chunks::<RAY>();
        if !rest.is_empty() {
            return Err(Failure::file(format!(
                "`{shown}` has {} bytes, which is not a multiple of {RAY}; a ray is eight \
                 little-endian f32: ox oy oz dx dy dz tmin tmax",
                bytes.len()
            )));
        }
        let number = |word: &[u8; 4]| f32::from_le_bytes(*word);
        rays.iter().map(|ray| std::array::from_fn(|i| number(&ray.as_chunks::<4>().0[i]))).collect()
    };
    Ok(rows.into_iter().map(ray).collect())
}

/// The order of the file is that of users; a [`Ray`] in memory has another one.
fn ray([ox, oy, oz, dx, dy, dz, t_min, t_max]: [f32; 8]) -> Ray {
    Ray { origin: [ox, oy, oz], t_min, direction: [dx, dy, dz], t_max }
}
