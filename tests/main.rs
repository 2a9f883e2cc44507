//! Tests of the facade and of what is below it, one module a file, in one program.

mod all_hits;
#[cfg(feature = "animation")]
mod animation;
mod bad_input;
#[cfg(feature = "scene")]
mod best;
mod common;
#[cfg(feature = "wgpu")]
#[path = "../backend-wgpu/tests/common/device.rs"]
mod device;
#[cfg(feature = "scene")]
mod extremes;
mod file;
#[cfg(all(feature = "render", feature = "wgpu"))]
mod gpu_builtin;
#[cfg(feature = "parity")]
mod gpu_comparison;
#[cfg(all(feature = "animation", feature = "render", feature = "wgpu"))]
mod gpu_frames;
mod gpu_marked;
#[cfg(all(feature = "scene", feature = "wgpu"))]
mod gpu_trees;
mod hits;
mod hostile;
#[cfg(feature = "picture")]
mod images;
mod inside;
mod lazy;
#[cfg(feature = "scene")]
mod lights;
#[cfg(feature = "obj")]
mod materials;
mod no_std;
mod relations;
#[cfg(feature = "json")]
mod saved_scene;
#[cfg(feature = "obj")]
mod scenes;
mod schedule;
mod stats;
mod surfaces;
#[cfg(feature = "textures")]
mod textures;
mod trees;
#[cfg(all(feature = "scene", feature = "verify"))]
mod verify;
mod web;
