#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]

extern crate alloc;

mod continued;
mod device;
mod embed;
mod embed_scene;
mod query;
mod render;
mod table;

pub use continued::{continue_lists, parts_by_halves};
pub use device::{for_software, with_workgroup_stacks};
pub use embed::{
    TRAVERSAL_BINDING_COUNT, TriangleTest, filtered_traversal, traversal, traversal_bindings,
};
pub use embed_scene::{SCENE_BINDING_COUNT, filtered_scene_traversal, scene_traversal};
pub use query::query;
pub use render::{
    RenderFeatures, has_tail, render_compressed, render_parts, render_retry, render_settle,
};
pub use table::{
    CHECKS, COMPRESS, KERNEL_RETRIES, KERNELS, LIBRARY, NEAR, POINT_BUILD, POINTS, QUERIES, RENDER,
    RENDER_COMPRESSED, RENDER_RETRIES, RENDER_SETTLES,
};

use alloc::string::String;

/// The name of every entry point.
pub const ENTRY_POINT: &str = "main";

/// A text with a name: the file's, without its ending.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Name of the file.
    pub name: &'static str,
    /// The text.
    pub text: &'static str,
}

/// A compute shader: what it shares, then its own text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shader {
    /// Name of the kernel.
    pub name: &'static str,
    /// The parts, in the order they are joined; the last is the kernel's own.
    pub parts: &'static [Part],
}

impl Shader {
    /// The whole WGSL module.
    pub fn source(&self) -> String {
        join(self.parts)
    }
}

/// Joins parts into one WGSL module.
pub fn join(parts: &[Part]) -> String {
    let mut source = String::with_capacity(parts.iter().map(|part| part.text.len() + 1).sum());
    for part in parts {
        source.push_str(part.text);
        source.push('\n');
    }
    source
}

/// The kernel of this name, of any table.
pub fn find(name: &str) -> Option<&'static Shader> {
    let tables = [
        KERNELS,
        KERNEL_RETRIES,
        COMPRESS,
        QUERIES,
        POINT_BUILD,
        POINTS,
        NEAR,
        RENDER,
        RENDER_COMPRESSED,
        RENDER_RETRIES,
        RENDER_SETTLES,
        CHECKS,
    ];
    tables.into_iter().flatten().find(|shader| shader.name == name)
}

/// The shader that finishes what this kernel of the tree builder leaves to it, if there is one: see [`KERNEL_RETRIES`].
pub fn kernel_retry(kernel: &str) -> Option<&'static Shader> {
    KERNEL_RETRIES.iter().find(|shader| shader.name.strip_suffix("_retry") == Some(kernel))
}
