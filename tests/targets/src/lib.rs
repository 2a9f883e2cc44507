//! What the fuzz targets do with their bytes.
//!
//! A target is a function of bytes that panics when the library does something it must not. The
//! programs in `fuzz/` give it bytes of a fuzzer, `tests/corpus.rs` those that are kept in
//! `tests/corpus`. Bytes mean something: most of them choose from a grammar, so that what comes out
//! gets past the first check of what reads it.

#![forbid(unsafe_code)]

use splitplane::scene::{Material, Scene};

pub mod animation;
pub mod arguments;
pub mod build_tree;
mod folder;
pub mod gltf;
pub mod nearness;
pub mod obj;
pub mod picture_part;
pub mod ply;
pub mod ray_file;
pub mod scene_file;
pub mod scene_json;
pub mod scene_operations;
pub mod source;
pub mod stl;
pub mod tree_file;

/// A target: panics when something is wrong.
pub type Target = fn(&[u8]);

/// All targets by their names, which are those of the programs in `fuzz/fuzz_targets` and of the
/// folders in `tests/corpus`.
pub const ALL: [(&str, Target); 14] = [
    ("animation", animation::run),
    ("arguments", arguments::run),
    ("build_tree", build_tree::run),
    ("gltf", gltf::run),
    ("nearness", nearness::run),
    ("obj", obj::run),
    ("picture_part", picture_part::run),
    ("ply", ply::run),
    ("ray_file", ray_file::run),
    ("scene_file", scene_file::run),
    ("scene_json", scene_json::run),
    ("scene_operations", scene_operations::run),
    ("stl", stl::run),
    ("tree_file", tree_file::run),
];

/// What must hold of every message to a user: one line of printable text that does not run on, which
/// says where (`place`) where there is such a thing.
fn check_message(message: &str, place: &str) {
    assert!(!message.trim().is_empty(), "an error without words");
    assert!(message.contains(place), "`{message}` does not say where: {place}");
    assert!(message.len() < 2000, "a message of {} bytes: {message}", message.len());
}

/// A mesh of a few vertices and triangles; it may have none.
fn mesh(source: &mut source::Source<'_>) -> Scene {
    let mut mesh = Scene { materials: vec![Material::clay()], ..Scene::default() };
    let vertices = source.below(9);
    mesh.positions = (0..vertices).map(|_| std::array::from_fn(|_| source.number())).collect();
    let triangles = if vertices == 0 { 0 } else { source.below(9) };
    let corner = |source: &mut source::Source<'_>| source.below(vertices.max(1)) as u32;
    mesh.indices = (0..triangles).map(|_| std::array::from_fn(|_| corner(source))).collect();
    mesh.material_of = vec![0; triangles];
    mesh
}

/// Changes some bytes of a file, cuts it off, or leaves it as it is; says whether it did something.
fn change(source: &mut source::Source<'_>, bytes: &mut Vec<u8>) -> bool {
    let before = bytes.clone();
    for _ in 0..source.below(5) {
        if bytes.is_empty() {
            break;
        }
        let at = source.below(bytes.len());
        match source.below(6) {
            0 => bytes.truncate(at),
            1 => drop(bytes.remove(at)),
            2 => bytes.insert(at, bytes[at]),
            3 => {
                let end = bytes.len().min(at + 4);
                bytes[at..end].fill(0xff);
            }
            _ => bytes[at] = source.bits() as u8,
        }
    }
    *bytes != before
}

/// Makes the calling thread the only one that works, once: handing work over costs more than most
/// inputs do.
pub fn single_thread() {
    use std::sync::Once;
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // A pool that is there already serves as well.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global();
    });
}
