//! glTF files: scenes written here as .glb, with bytes or words of their JSON changed or not.

use crate::source::Source;
use splitplane::scene::gltf::{parse, to_glb};
use splitplane::scene::instanced::{Key, Pose};
use splitplane::scene::{Camera, InstancedScene, Light, MeshFileError, SceneOptions};
use std::path::Path;

/// What reads a scene.
pub type Reader = fn(&[u8], &Path, &SceneOptions) -> Result<InstancedScene, MeshFileError>;

/// What may stand in the place of a number.
const ODD: [&str; 12] = [
    "0",
    "-1",
    "1e39",
    "1e-46",
    "4294967295",
    "18446744073709551615",
    "0.5",
    "null",
    "[]",
    "{}",
    "\"x\"",
    "true",
];

/// Bytes as a `.glb` file. One that was not changed has the triangles that were written; all others are read or refused with a place.
pub fn run(data: &[u8]) {
    run_on(data, parse);
}

/// The same with another reader.
pub fn run_on(data: &[u8], reader: Reader) {
    let mut source = Source::new(data);
    let mesh = crate::mesh(&mut source);
    let count = mesh.indices.len();
    let mut scene: InstancedScene = mesh.into();
    scene.parts.camera = Camera::new([0.0, 0.0, 5.0], [0.0; 3], [0.0, 1.0, 0.0], 40.0).ok();
    let (position, irradiance, distance) = ([1.0; 3], [1.0, 2.0, 3.0], 2.0);
    scene.parts.lights.push(Light::Point { position, irradiance, distance });
    if source.once_in(2) {
        let pose = |x| Pose { translate: [x, 0.0, 0.0], ..Pose::IDENTITY };
        scene.instances[0].keys =
            [0, 3].map(|frame| Key { frame, pose: pose(f64::from(frame)) }).to_vec();
        scene.frames = 4;
    }
    let mut bytes = to_glb(&scene).expect("a small file");
    let changed = match source.below(3) {
        0 => false,
        1 => crate::change(&mut source, &mut bytes),
        _ => {
            bytes = with_numbers_changed(&mut source, &bytes);
            true
        }
    };
    match reader(&bytes, Path::new("some.glb"), &SceneOptions::default()) {
        Ok(mut read) => {
            let mut described = read.describe().expect("what is read can be described");
            for frame in [0, read.frames / 2, read.frames - 1] {
                read.set(frame, &mut described).expect("a frame of the file");
            }
            let sorted = |scene: &InstancedScene| {
                let mut all: Vec<u32> =
                    scene.parts.triangles().flatten().flatten().map(f32::to_bits).collect();
                all.sort_unstable();
                all
            };
            if !changed {
                assert_eq!(read.parts.indices.len(), count);
                assert_eq!(sorted(&read), sorted(&scene));
                assert_eq!(read.instances[0].keys.is_empty(), scene.instances[0].keys.is_empty());
                assert!(read.parts.camera.is_some() && read.parts.lights.len() == 1);
            }
            assert!(read.flatten(1 << 26).is_ok_and(|mesh| mesh.mesh().is_ok()));
        }
        Err(error) => {
            assert!(changed || count == 0, "{error}");
            crate::check_message(&error.to_string(), "some.glb");
        }
    }
}

/// The JSON alone, with some of its numbers as something else. What it says of its bytes then lacks them, or they are in the file again.
fn with_numbers_changed(source: &mut Source<'_>, bytes: &[u8]) -> Vec<u8> {
    let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
    let (json, rest) = bytes[20..].split_at(length);
    let mut json = String::from_utf8_lossy(json).into_owned();
    for _ in 0..1 + source.below(3) {
        let starts: Vec<usize> = json
            .match_indices(|letter: char| letter.is_ascii_digit())
            .map(|(at, _)| at)
            .filter(|at| *at > 0 && matches!(json.as_bytes()[at - 1], b':' | b'[' | b','))
            .collect();
        if starts.is_empty() {
            break;
        }
        let start = starts[source.below(starts.len())];
        let own = json[start..].find([',', ']', '}']).unwrap_or(0);
        json.replace_range(start..start + own, source.pick(&ODD));
    }
    while !json.len().is_multiple_of(4) {
        json.push(' ');
    }
    let mut out = b"glTF".to_vec();
    let length = 20 + json.len() + rest.len();
    out.extend([2, length as u32, json.len() as u32].map(u32::to_le_bytes).as_flattened());
    out.extend(b"JSON");
    out.extend(json.as_bytes());
    out.extend(rest);
    out
}
