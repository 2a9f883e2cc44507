//! Lists that two bindings of one buffer hold, where one binding is too small.

use std::num::NonZeroU64;

use wgpu::BufferBinding;

/// What every offset of a storage binding is a multiple of, on any device.
pub(crate) const ALIGNMENT: u64 = 256;

/// Bytes by which the first half may be bound beyond its end, for readers of a few elements in a row: a chunk of
/// references.
pub(crate) const OVERLAP: u64 = 256 * 32;

/// The greatest size of a storage buffer, and the limit that says so.
pub(crate) fn binding_limit(limits: &wgpu::Limits) -> (u64, &'static str) {
    let binding = limits.max_storage_buffer_binding_size;
    if binding <= limits.max_buffer_size {
        (binding, "max_storage_buffer_binding_size")
    } else {
        (limits.max_buffer_size, "max_buffer_size")
    }
}

/// The greatest size of a buffer that two bindings hold, and the limit that says so.
pub(crate) fn halves_limit(limits: &wgpu::Limits) -> (u64, &'static str) {
    let (binding, name) = binding_limit(limits);
    let half = binding.saturating_sub(OVERLAP) / ALIGNMENT * ALIGNMENT;
    if 2 * half <= limits.max_buffer_size {
        (2 * half, name)
    } else {
        (limits.max_buffer_size / ALIGNMENT * ALIGNMENT, "max_buffer_size")
    }
}

/// Bytes of the first half of a list.
pub(crate) fn first_half(bytes: u64) -> u64 {
    (bytes / 2).next_multiple_of(ALIGNMENT).max(ALIGNMENT)
}

/// Bytes that a list takes in two halves: neither is empty.
pub(crate) fn bytes_in_halves(bytes: u64) -> u64 {
    bytes.next_multiple_of(4).max(first_half(bytes) + ALIGNMENT)
}

/// A half of a list of this many bytes: the first one with `beyond` bytes of the second.
pub(crate) fn half(
    buffer: &wgpu::Buffer,
    bytes: u64,
    second: bool,
    beyond: u64,
) -> BufferBinding<'_> {
    let (middle, end) = (first_half(bytes), bytes_in_halves(bytes));
    let (offset, size) =
        if second { (middle, end - middle) } else { (0, (middle + beyond).min(end)) };
    BufferBinding { buffer, offset, size: NonZeroU64::new(size) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What two bindings may hold they do hold, whatever the limits are.
    #[test]
    fn halves_fit_their_bindings() {
        for binding in [1 << 15, 100_000, 1 << 20, (128 << 20) - 4, 128 << 20] {
            let limits = wgpu::Limits {
                max_storage_buffer_binding_size: binding,
                ..wgpu::Limits::default()
            };
            let (most, _) = halves_limit(&limits);
            assert!(most > binding && most <= limits.max_buffer_size, "{binding}");
            for bytes in [0, 36, 512, 1000, 36_000, most / 2 + 4, most - 4, most] {
                if bytes > most {
                    continue;
                }
                let (middle, end) = (first_half(bytes), bytes_in_halves(bytes));
                assert!(
                    middle + OVERLAP <= binding && end - middle <= binding,
                    "{binding} {bytes}"
                );
                assert!(middle % ALIGNMENT == 0 && end > middle && end >= bytes && end % 4 == 0);
            }
        }
        let limits = wgpu::Limits { max_buffer_size: 150 << 20, ..wgpu::Limits::default() };
        assert_eq!(halves_limit(&limits), (150 << 20, "max_buffer_size"));
    }
}
