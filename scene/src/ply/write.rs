//! Meshes and points to PLY files.

use std::collections::TryReserveError;

use crate::Scene;

/// How numbers are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As text, with the fewest digits that give the same number again.
    Ascii,
    /// As bytes, the least first.
    LittleEndian,
    /// As bytes, the greatest first.
    BigEndian,
}

impl Encoding {
    const fn name(self) -> &'static str {
        match self {
            Encoding::Ascii => "ascii",
            Encoding::LittleEndian => "binary_little_endian",
            Encoding::BigEndian => "binary_big_endian",
        }
    }
}

/// The triangles of a scene as a PLY file: positions as `float`, corners as a list of three `uint`; normals where every vertex has one of
/// its own number. Read again it has the same positions bit for bit (a NaN stays one) and the same triangles. Materials, texture
/// coordinates, camera and lights have no place in it.
///
/// # Errors
/// No memory.
pub fn to_bytes(scene: &Scene, encoding: Encoding) -> Result<Vec<u8>, TryReserveError> {
    let has_normals = !scene.normals.is_empty()
        && scene.normals.len() == scene.positions.len()
        && scene.normal_indices == scene.indices;
    let (vertices, count) = (scene.positions.len(), scene.indices.len());
    let vertex = if has_normals { 24 } else { 12 };
    let mut out = Out::new(encoding, vertices.saturating_mul(vertex), count.saturating_mul(13))?;
    out.vertices(vertices, has_normals)?;
    out.text(&format!("element face {count}\nproperty list uchar uint vertex_indices\n"))?;
    out.text("end_header\n")?;
    for (at, position) in scene.positions.iter().enumerate() {
        out.floats(position)?;
        if has_normals {
            out.space()?;
            out.floats(&scene.normals[at])?;
        }
        out.end()?;
    }
    for corners in &scene.indices {
        out.corners(*corners)?;
        out.end()?;
    }
    Ok(out.bytes)
}

/// Points as a PLY file of one element `vertex`.
///
/// # Errors
/// No memory.
pub fn points_to_bytes(
    points: &[[f32; 3]],
    encoding: Encoding,
) -> Result<Vec<u8>, TryReserveError> {
    let mut out = Out::new(encoding, points.len().saturating_mul(12), 0)?;
    out.vertices(points.len(), false)?;
    out.text("end_header\n")?;
    for point in points {
        out.floats(point)?;
        out.end()?;
    }
    Ok(out.bytes)
}

struct Out {
    encoding: Encoding,
    bytes: Vec<u8>,
}

/// More than a header takes.
const HEADER: usize = 512;

impl Out {
    /// `vertices` and `faces` are bytes of both, where numbers are written as bytes.
    fn new(encoding: Encoding, vertices: usize, faces: usize) -> Result<Out, TryReserveError> {
        let mut bytes = Vec::new();
        let body = if encoding == Encoding::Ascii { 0 } else { vertices.saturating_add(faces) };
        bytes.try_reserve_exact(body.saturating_add(HEADER))?;
        let mut out = Out { encoding, bytes };
        out.text(&format!("ply\nformat {} 1.0\ncomment splitplane\n", encoding.name()))?;
        Ok(out)
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), TryReserveError> {
        self.bytes.try_reserve(bytes.len())?;
        self.bytes.extend_from_slice(bytes);
        Ok(())
    }

    fn text(&mut self, text: &str) -> Result<(), TryReserveError> {
        self.put(text.as_bytes())
    }

    fn vertices(&mut self, count: usize, has_normals: bool) -> Result<(), TryReserveError> {
        let lines = "property float x\nproperty float y\nproperty float z\n";
        self.text(&format!("element vertex {count}\n{lines}"))?;
        if has_normals {
            self.text("property float nx\nproperty float ny\nproperty float nz\n")?;
        }
        Ok(())
    }

    fn floats(&mut self, point: &[f32; 3]) -> Result<(), TryReserveError> {
        let [x, y, z] = point;
        match self.encoding {
            Encoding::Ascii => self.text(&format!("{x:?} {y:?} {z:?}")),
            Encoding::LittleEndian => self.put(point.map(f32::to_le_bytes).as_flattened()),
            Encoding::BigEndian => self.put(point.map(f32::to_be_bytes).as_flattened()),
        }
    }

    fn corners(&mut self, corners: [u32; 3]) -> Result<(), TryReserveError> {
        if self.encoding == Encoding::Ascii {
            let [a, b, c] = corners;
            return self.text(&format!("3 {a} {b} {c}"));
        }
        self.put(&[3])?;
        match self.encoding {
            Encoding::BigEndian => self.put(corners.map(u32::to_be_bytes).as_flattened()),
            _ => self.put(corners.map(u32::to_le_bytes).as_flattened()),
        }
    }

    fn space(&mut self) -> Result<(), TryReserveError> {
        if self.encoding == Encoding::Ascii { self.put(b" ") } else { Ok(()) }
    }

    fn end(&mut self) -> Result<(), TryReserveError> {
        if self.encoding == Encoding::Ascii { self.put(b"\n") } else { Ok(()) }
    }
}
