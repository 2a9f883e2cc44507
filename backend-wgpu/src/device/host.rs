//! Lists in host memory that grow with what is read back: where the system has no memory, that is
//! an error.

use bytemuck::Pod;

use crate::error::GpuError;

/// An empty list with capacity for this many items.
///
/// # Errors
/// [`GpuError::HostMemory`].
pub(crate) fn room<T>(items: usize, what: &str) -> Result<Vec<T>, GpuError> {
    let mut list = Vec::new();
    list.try_reserve_exact(items).map_err(|_| GpuError::HostMemory {
        what: what.to_owned(),
        needed: items as u64 * size_of::<T>() as u64,
    })?;
    Ok(list)
}

/// The items in some bytes, which need not be aligned; an incomplete item at the end is left out.
///
/// # Errors
/// As for [`room`].
pub(crate) fn copied<T: Pod>(bytes: &[u8]) -> Result<Vec<T>, GpuError> {
    let count = bytes.len() / size_of::<T>();
    let mut list = room(count, "what was read back")?;
    list.resize(count, T::zeroed());
    let length = count * size_of::<T>();
    bytemuck::cast_slice_mut(&mut list).copy_from_slice(&bytes[..length]);
    Ok(list)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_copied_wherever_they_begin() {
        let bytes: Vec<u8> = (0..19).collect();
        for start in 0..8 {
            let words: Vec<u32> = copied(&bytes[start..]).expect("memory");
            let expected = bytes[start..].chunks_exact(4);
            let expected: Vec<u32> =
                expected.map(|b| u32::from_ne_bytes([b[0], b[1], b[2], b[3]])).collect();
            assert_eq!(words, expected);
        }
        assert_eq!(copied::<u64>(&[]), Ok(Vec::new()));
        let error = room::<u64>(usize::MAX / 16, "a list").expect_err("no machine has that");
        assert!(error.to_string().starts_with("the system has no memory for a list: "), "{error}");
    }
}
