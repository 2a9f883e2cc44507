//! The .npy format of NumPy, as much of it as rays and hits need: versions 1 to 3, C order.

pub(super) use splitplane_scene::npy::NpyError;
use splitplane_scene::npy::{Header, MAGIC};
use std::fmt;

/// True for bytes that start as an .npy file does.
pub fn is_npy(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// An array of shape (n, N), row by row, as what `make` makes of f32; f64 is rounded.
pub(super) fn read_rows<const N: usize, T>(
    bytes: &[u8],
    make: impl Fn([f32; N]) -> T,
) -> Result<Vec<T>, NpyError> {
    let mut numbers = bytes;
    // What is in memory can be read.
    let header = Header::read(&mut numbers).map_err(|_| NpyError::Memory)??;
    if header.sides.len() != 2 || header.sides[1] != N as u64 {
        return Err(header.wrong_shape(if N == 3 { "(n, 3)" } else { "(n, 8)" }));
    }
    header.check_length(numbers.len() as u64)?;
    let count = numbers.len() / (N * header.width as usize);
    let mut rows = Vec::new();
    rows.try_reserve_exact(count).map_err(|_| NpyError::Memory)?;
    match header.width {
        4 => {
            let (numbers, _) = numbers.as_chunks::<4>();
            let (found, _) = numbers.as_chunks::<N>();
            rows.extend(found.iter().map(|row| make(row.map(f32::from_le_bytes))));
        }
        _ => {
            let (numbers, _) = numbers.as_chunks::<8>();
            let (found, _) = numbers.as_chunks::<N>();
            rows.extend(found.iter().map(|row| make(row.map(|b| f64::from_le_bytes(b) as f32))));
        }
    }
    Ok(rows)
}

/// The header of a one-dimensional array; the numbers follow it.
pub fn header(kind: impl fmt::Display, count: usize) -> Vec<u8> {
    header_of(kind, &[count])
}

/// The header of an array of any shape, in C order; the numbers follow it.
pub(super) fn header_of(kind: impl fmt::Display, shape: &[usize]) -> Vec<u8> {
    let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
    // One side alone has a comma behind it.
    let end = if sides.len() == 1 { "," } else { "" };
    let sides = sides.join(", ");
    let text = format!("{{'descr': {kind}, 'fortran_order': False, 'shape': ({sides}{end}), }}");
    // The numbers start at a multiple of 64, after the line feed that ends the header.
    let padding = (64 - (10 + text.len() + 1) % 64) % 64;
    let length = (text.len() + padding + 1) as u16;
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    bytes.extend(length.to_le_bytes());
    bytes.extend(text.bytes());
    bytes.extend(std::iter::repeat_n(b' ', padding));
    bytes.push(b'\n');
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_rows<const N: usize>(bytes: &[u8]) -> Result<Vec<[f32; N]>, NpyError> {
        super::read_rows(bytes, |row| row)
    }

    fn file(version: u8, dictionary: &str, numbers: &[u8]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend([version, 0]);
        match version {
            1 => bytes.extend((dictionary.len() as u16).to_le_bytes()),
            _ => bytes.extend((dictionary.len() as u32).to_le_bytes()),
        }
        bytes.extend(dictionary.bytes());
        bytes.extend(numbers);
        bytes
    }

    fn dictionary(kind: &str, order: &str, shape: &str) -> String {
        format!("{{'descr': {kind}, 'fortran_order': {order}, 'shape': {shape}, }}\n")
    }

    #[test]
    fn both_widths_and_all_versions() {
        let narrow: Vec<u8> = (0..8u8).flat_map(|i| f32::from(i).to_le_bytes()).collect();
        let wide: Vec<u8> = (0..8u8).flat_map(|i| f64::from(i).to_le_bytes()).collect();
        let want = vec![[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]];
        for version in 1..=3 {
            let bytes = file(version, &dictionary("'<f4'", "False", "(1, 8)"), &narrow);
            assert_eq!(read_rows::<8>(&bytes), Ok(want.clone()));
            let bytes = file(version, &dictionary("\"<f8\"", "False", "(1,8)"), &wide);
            assert_eq!(read_rows::<8>(&bytes), Ok(want.clone()));
        }
        let point = file(1, &dictionary("'<f4'", "False", "(1, 3)"), &narrow[4..16]);
        assert_eq!(read_rows::<3>(&point), Ok(vec![[1.0, 2.0, 3.0]]));
        assert_eq!(
            read_rows::<8>(&point),
            Err(NpyError::Shape { found: "(1, 3)".into(), expected: "(n, 8)" })
        );
        let none = file(1, &dictionary("'<f4'", "False", "(0, 8)"), &[]);
        assert_eq!(read_rows::<8>(&none), Ok(vec![]));
    }

    #[test]
    fn everything_else_is_a_typed_error() {
        let read =
            |kind, order, shape| read_rows::<8>(&file(1, &dictionary(kind, order, shape), &[]));
        assert_eq!(read("'>f4'", "False", "(1, 8)"), Err(NpyError::Type(">f4".into())));
        assert_eq!(
            read("[('a', '<f4')]", "False", "(1, 8)"),
            Err(NpyError::Type("several fields".into()))
        );
        assert_eq!(read("'<f4'", "True", "(1, 8)"), Err(NpyError::Fortran));
        assert_eq!(
            read("'<f4'", "False", "(8,)"),
            Err(NpyError::Shape { found: "(8,)".into(), expected: "(n, 8)" })
        );
        assert_eq!(
            read("'<f4'", "False", "(2, 3)"),
            Err(NpyError::Shape { found: "(2, 3)".into(), expected: "(n, 8)" })
        );
        assert_eq!(
            read("'<f4'", "False", "(1, 8)"),
            Err(NpyError::Length { promised: 32, found: 0 })
        );
        let huge = "(18446744073709551615, 8)";
        assert_eq!(read("'<f4'", "False", huge), Err(NpyError::Header));
        assert_eq!(read_rows::<8>(b"abc"), Err(NpyError::Magic));
        assert_eq!(read_rows::<8>(&file(9, "", &[])), Err(NpyError::Version(9)));
        let whole = file(1, &dictionary("'<f4'", "False", "(0, 8)"), &[]);
        for cut in 6..whole.len() - 1 {
            assert_eq!(read_rows::<8>(&whole[..cut]), Err(NpyError::Header), "{cut}");
        }
    }

    #[test]
    fn numbers_start_at_a_multiple_of_64() {
        for count in [0, 1, 12_345_678] {
            let bytes = header("'|u1'", count);
            assert_eq!(bytes.len() % 64, 0);
            assert_eq!(bytes.last(), Some(&b'\n'));
        }
    }
}
