//! Files of clouds: .ply, .npy of shape (n, 3), and text with a point a line (.xyz and all others).

use super::failure::Failure;
use super::npy::{self, NpyError};
use splitplane_scene::from_file::{self, ReadError, quoted_path, quoted_word};
use splitplane_scene::ply;
use std::path::Path;

/// Reads a cloud of at most so many bytes. Points with a coordinate that is not finite are among them.
pub(super) fn read(path: &Path, limit: Option<u64>) -> Result<Vec<[f32; 3]>, Failure> {
    let bytes = from_file::read_any(path, limit).map_err(|error| {
        let mut message = said(path, &error);
        if let ReadError::TooLong { .. } = error {
            message += "; --max-file allows more";
        }
        if error.is_limit() { Failure::limit(message) } else { Failure::file(message) }
    })?;
    parse(path, &bytes)
}

/// The points in the bytes of a file. What they are is told by how they begin, else by the file's ending.
///
/// # Errors
/// The bytes are no cloud, or there is no memory; the message names file and place.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<[f32; 3]>, Failure> {
    let named = |ending: &str| super::files::ends_in(path, ending);
    if npy::is_npy(bytes) || named("npy") {
        return npy::read_rows(bytes, |point| point).map_err(|error| match error {
            NpyError::Memory => Failure::limit(said(path, &error)),
            error => Failure::file(said(path, &error)),
        });
    }
    if bytes.starts_with(b"ply") || named("ply") {
        return Ok(ply::parse_points(bytes, path).map_err(splitplane_scene::SceneError::from)?);
    }
    text(bytes).map_err(|problem| match problem {
        Problem::Memory => Failure::limit(said(path, &"there is not memory enough for its points")),
        Problem::Line(line, words) => Failure::file(said(path, &format!("line {line}: {words}"))),
    })
}

fn said(path: &Path, error: &dyn std::fmt::Display) -> String {
    format!("cannot read the cloud in `{}`: {error}", quoted_path(path))
}

#[derive(Debug, PartialEq, Eq)]
enum Problem {
    Memory,
    /// Where, counted from 1, and what.
    Line(usize, String),
}

/// A point a line: its first three numbers, with blanks, commas or semicolons between them. What follows them (colours, normals) is
/// not read; nor are empty lines, and what stands behind `#` or `//`.
fn text(bytes: &[u8]) -> Result<Vec<[f32; 3]>, Problem> {
    let mut points = Vec::new();
    for (number, line) in (1..).zip(bytes.split(|&byte| byte == b'\n')) {
        let bad = |words: String| Problem::Line(number, words);
        let line = std::str::from_utf8(line).map_err(|_| bad("it is no text".into()))?;
        let line = line.split('#').next().unwrap_or("");
        let line = line.split("//").next().unwrap_or("");
        let is_between = |c: char| c.is_whitespace() || c == ',' || c == ';';
        let mut words = line.split(is_between).filter(|word| !word.is_empty());
        let (mut point, mut found) = ([0.0f32; 3], 0);
        for (place, word) in point.iter_mut().zip(words.by_ref()) {
            *place =
                word.parse().map_err(|_| bad(format!("`{}` is no number", quoted_word(word))))?;
            found += 1;
        }
        match found {
            0 => continue,
            3 => {}
            _ => return Err(bad(format!("a point has three numbers, not {found}"))),
        }
        points.try_reserve(1).map_err(|_| Problem::Memory)?;
        points.push(point);
    }
    Ok(points)
}

/// A cloud as the bytes of a file with this name: .ply, .npy or text.
///
/// # Errors
/// No memory.
pub(super) fn to_bytes(path: &Path, points: &[[f32; 3]]) -> Result<Vec<u8>, Failure> {
    let refused = |_| Failure::limit("there is not memory enough for the file of the cloud");
    if super::files::ends_in(path, "ply") {
        return ply::points_to_bytes(points, ply::Encoding::LittleEndian).map_err(refused);
    }
    if super::files::ends_in(path, "npy") {
        let mut bytes = npy::header_of("'<f4'", &[points.len(), 3]);
        bytes.try_reserve_exact(12 * points.len()).map_err(refused)?;
        bytes.extend(points.iter().flatten().flat_map(|x| x.to_le_bytes()));
        return Ok(bytes);
    }
    let mut text = Vec::new();
    for [x, y, z] in points {
        let line = format!("{x} {y} {z}\n");
        text.try_reserve(line.len()).map_err(refused)?;
        text.extend(line.bytes());
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_has_a_point_a_line() {
        let lines = "# a cloud\n1 2 3\n\n  -1.5,2e3;.5 255 0 0 // red\r\nnan 0 inf # left out\n";
        let points = text(lines.as_bytes()).unwrap();
        assert_eq!(points[..2], [[1.0, 2.0, 3.0], [-1.5, 2000.0, 0.5]]);
        assert_eq!(points.len(), 3);
        assert!(points[2][0].is_nan() && points[2][2] == f32::INFINITY);
        let bad = |text: &[u8]| match super::text(text) {
            Err(Problem::Line(line, words)) => (line, words),
            other => panic!("{other:?}"),
        };
        assert_eq!(bad(b"1 2 3\n4 5\n"), (2, "a point has three numbers, not 2".into()));
        assert_eq!(bad(b"\n1 x 3"), (2, "`x` is no number".into()));
        assert_eq!(bad(b"1 2 3\n\xff\n"), (2, "it is no text".into()));
        assert_eq!(text(b""), Ok(Vec::new()));
    }

    /// What is written is read again, bit for bit.
    #[test]
    fn clouds_come_back() {
        let points = [[1.0, -2.5, 3.25e-20], [f32::MAX, 1e-45, 0.1]];
        for name in ["a.ply", "a.npy", "a.xyz"] {
            let path = Path::new(name);
            let bytes = to_bytes(path, &points).unwrap();
            let back = parse(path, &bytes).unwrap();
            assert_eq!(back.as_flattened(), points.as_flattened(), "{name}");
            // Cut short it is an error, with the name, or fewer points.
            for cut in 0..bytes.len() {
                match parse(path, &bytes[..cut]) {
                    Ok(fewer) => assert!(fewer.len() <= 2 && name == "a.xyz"),
                    Err(failure) => assert!(failure.message().contains(name)),
                }
            }
        }
    }
}
