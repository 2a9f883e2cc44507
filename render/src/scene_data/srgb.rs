//! The curve of sRGB.

/// sRGB to linear light (IEC 61966-2-1).
pub(super) fn linear(shown: f64) -> f32 {
    let value = if shown <= 0.04045 { shown / 12.92 } else { ((shown + 0.055) / 1.055).powf(2.4) };
    value as f32
}

/// The least linear value that is shown as this byte: halfway, as sRGB, from the byte below.
pub(super) fn least_shown(byte: u32) -> f32 {
    if byte == 0 { 0.0 } else { linear((f64::from(byte) - 0.5) / 255.0) }
}
