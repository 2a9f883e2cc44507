//! PLY files: meshes written here and read again, with bytes changed or not; any bytes behind a header.

use crate::source::Source;
use splitplane::scene::ply::{Encoding, parse, parse_points, points_to_bytes, to_bytes};
use splitplane::scene::{MeshFileError, Scene};
use std::path::Path;

/// What reads a mesh.
pub type Reader = fn(&[u8], &Path) -> Result<Scene, MeshFileError>;

/// Bytes as a PLY file. One that was not changed has the triangles that were written; all others are read or refused with a place.
pub fn run(data: &[u8]) {
    run_on(data, parse);
}

/// The same with another reader.
pub fn run_on(data: &[u8], reader: Reader) {
    let mut source = Source::new(data);
    let path = Path::new("some.ply");
    let encoding = source.pick(&[Encoding::Ascii, Encoding::LittleEndian, Encoding::BigEndian]);
    let mesh = crate::mesh(&mut source);
    let is_cloud = source.once_in(4);
    let mut bytes = match is_cloud {
        true => points_to_bytes(&mesh.positions, encoding).expect("memory"),
        false => to_bytes(&mesh, encoding).expect("memory"),
    };
    let changed = crate::change(&mut source, &mut bytes);
    let words = |points: &[[f32; 3]]| -> Vec<u32> {
        // A NaN in text is one, whatever its bits were.
        let bits = |x: &f32| if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() };
        points.as_flattened().iter().map(bits).collect()
    };
    match parse_points(&bytes, path) {
        Ok(points) if !changed => assert_eq!(words(&points), words(&mesh.positions)),
        Ok(points) => assert!(points.capacity() <= 4 * bytes.len()),
        Err(error) => {
            assert!(changed || mesh.positions.is_empty(), "{error}");
            crate::check_message(&error.to_string(), "some.ply");
        }
    }
    match reader(&bytes, path) {
        Ok(scene) => {
            assert!(scene.mesh().is_ok());
            assert_eq!(scene.material_of.len(), scene.indices.len());
            if !changed {
                assert_eq!(words(&scene.positions), words(&mesh.positions));
                assert_eq!(scene.indices, mesh.indices);
            }
        }
        Err(error) => {
            assert!(changed || is_cloud || mesh.indices.is_empty(), "{error}");
            crate::check_message(&error.to_string(), "some.ply");
        }
    }
}
