//! Meshes and points to PLY files.

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
pub fn to_bytes(scene: &Scene, encoding: Encoding) -> Vec<u8> {
    let has_normals = !scene.normals.is_empty()
        && scene.normals.len() == scene.positions.len()
        && scene.normal_indices == scene.indices;
    let mut out = Out::new(encoding);
    out.vertices(scene.positions.len(), has_normals);
    let count = scene.indices.len();
    out.header(&format!("element face {count}\nproperty list uchar uint vertex_indices\n"));
    out.header("end_header\n");
    for (at, position) in scene.positions.iter().enumerate() {
        out.floats(position);
        if has_normals {
            out.space();
            out.floats(&scene.normals[at]);
        }
        out.end();
    }
    for corners in &scene.indices {
        out.corners(*corners);
        out.end();
    }
    out.bytes
}

/// Points as a PLY file of one element `vertex`.
pub fn points_to_bytes(points: &[[f32; 3]], encoding: Encoding) -> Vec<u8> {
    let mut out = Out::new(encoding);
    out.vertices(points.len(), false);
    out.header("end_header\n");
    for point in points {
        out.floats(point);
        out.end();
    }
    out.bytes
}

struct Out {
    encoding: Encoding,
    bytes: Vec<u8>,
}

impl Out {
    fn new(encoding: Encoding) -> Out {
        let name = encoding.name();
        let bytes = format!("ply\nformat {name} 1.0\ncomment splitplane\n").into_bytes();
        Out { encoding, bytes }
    }

    fn header(&mut self, lines: &str) {
        self.bytes.extend_from_slice(lines.as_bytes());
    }

    fn vertices(&mut self, count: usize, has_normals: bool) {
        let lines = "property float x\nproperty float y\nproperty float z\n";
        self.header(&format!("element vertex {count}\n{lines}"));
        if has_normals {
            self.header("property float nx\nproperty float ny\nproperty float nz\n");
        }
    }

    fn floats(&mut self, [x, y, z]: &[f32; 3]) {
        match self.encoding {
            Encoding::Ascii => self.header(&format!("{x:?} {y:?} {z:?}")),
            Encoding::LittleEndian => {
                [x, y, z].iter().for_each(|part| self.bytes.extend(part.to_le_bytes()));
            }
            Encoding::BigEndian => {
                [x, y, z].iter().for_each(|part| self.bytes.extend(part.to_be_bytes()));
            }
        }
    }

    fn corners(&mut self, corners: [u32; 3]) {
        match self.encoding {
            Encoding::Ascii => {
                let [a, b, c] = corners;
                self.header(&format!("3 {a} {b} {c}"));
            }
            Encoding::LittleEndian => {
                self.bytes.push(3);
                corners.iter().for_each(|part| self.bytes.extend(part.to_le_bytes()));
            }
            Encoding::BigEndian => {
                self.bytes.push(3);
                corners.iter().for_each(|part| self.bytes.extend(part.to_be_bytes()));
            }
        }
    }

    fn space(&mut self) {
        if self.encoding == Encoding::Ascii {
            self.bytes.push(b' ');
        }
    }

    fn end(&mut self) {
        if self.encoding == Encoding::Ascii {
            self.bytes.push(b'\n');
        }
    }
}
