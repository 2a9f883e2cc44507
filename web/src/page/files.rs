//! Files that are dropped on the page.

use std::path::Path;

use splitplane::scene::{Scene, SceneOptions, gltf, obj, ply, stl};

use super::MOST_BYTES;
use crate::failure::Failure;

/// Most bytes that the triangles of all instances of a glTF file may take together, and that its pictures may.
const MOST_FLAT: u64 = 1 << 30;
const MOST_TEXELS: u64 = 64 << 20;

fn failed(error: impl ToString) -> Failure {
    Failure::new("file", error.to_string())
}

/// The scene of a file, by the ending of its name. All instances of a glTF file become one mesh.
pub(super) fn scene(bytes: &[u8], name: &str) -> Result<Scene, Failure> {
    let path = Path::new(name);
    let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
    match ending.to_str() {
        Some("ply") => ply::parse(bytes, path).map_err(failed),
        Some("stl") => stl::parse(bytes, path).map_err(failed),
        Some("glb" | "gltf") => {
            let options = SceneOptions {
                file_limit: Some(u64::from(MOST_BYTES)),
                texture_limit: MOST_TEXELS,
                decode_limit: 4 * MOST_TEXELS,
                ..SceneOptions::default()
            };
            let scene = gltf::parse(bytes, path, &options).map_err(failed)?;
            scene.flatten(MOST_FLAT).map_err(failed)
        }
        Some("obj") => {
            let text = std::str::from_utf8(bytes);
            obj::parse(text.map_err(|error| failed(format!("the file is no text: {error}")))?, name)
                .map_err(failed)
        }
        _ => Err(failed(format!(
            "the page reads .gltf, .glb, .obj, .ply and .stl files, and `{name}` is none of them"
        ))),
    }
}
