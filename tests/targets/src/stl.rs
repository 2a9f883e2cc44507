//! STL files: triangles written here as text and as bytes, with bytes changed or not.

use crate::source::Source;
use splitplane::scene::stl::parse;
use splitplane::scene::{MeshFileError, Scene};
use std::fmt::Write;
use std::path::Path;

/// What reads a mesh.
pub type Reader = fn(&[u8], &Path) -> Result<Scene, MeshFileError>;

/// Bytes as an STL file. One that was not changed has the triangles that were written; all others are read or refused.
pub fn run(data: &[u8]) {
    run_on(data, parse);
}

/// The same with another reader.
pub fn run_on(data: &[u8], reader: Reader) {
    let mut source = Source::new(data);
    let mesh = crate::mesh(&mut source);
    let triangles: Vec<[[f32; 3]; 3]> = mesh.triangles().collect();
    let mut bytes = match source.once_in(2) {
        true => text(&triangles),
        false => binary(&triangles, source.once_in(2)),
    };
    let changed = crate::change(&mut source, &mut bytes);
    match reader(&bytes, Path::new("some.stl")) {
        Ok(scene) => {
            assert!(scene.mesh().is_ok());
            assert!(scene.indices.len() * 12 <= 2 * bytes.len());
            let words = |triangles: Vec<[[f32; 3]; 3]>| -> Vec<u32> {
                let bits = |x: &f32| if x.is_nan() { f32::NAN.to_bits() } else { x.to_bits() };
                triangles.as_flattened().as_flattened().iter().map(bits).collect()
            };
            if !changed {
                assert_eq!(words(scene.triangles().collect()), words(triangles));
            }
        }
        Err(error) => {
            assert!(changed || triangles.is_empty(), "{error}");
            crate::check_message(&error.to_string(), "some.stl");
        }
    }
}

fn text(triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut text = "solid a name\n".to_owned();
    for corners in triangles {
        text += " facet normal 0 0 0\n  outer loop\n";
        for [x, y, z] in corners {
            // Writing to a text cannot fail.
            let _ = writeln!(text, "   vertex {x:?} {y:?} {z:?}");
        }
        text += "  endloop\n endfacet\n";
    }
    (text + "endsolid a name\n").into_bytes()
}

fn binary(triangles: &[[[f32; 3]; 3]], is_solid: bool) -> Vec<u8> {
    let mut bytes = if is_solid { b"solid".to_vec() } else { Vec::new() };
    bytes.resize(80, b' ');
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for corners in triangles {
        bytes.extend([0; 12]);
        corners.as_flattened().iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}
