//! The C interface: the library's calls on handles, pointers and strides. `splitplane.h` is made of this by cbindgen.
//!
//! Objects are named by handles, numbers that a table resolves, so a dead one is an error and not a crash. Every call returns a status; no panic leaves.

#![allow(
    clippy::too_many_arguments,
    reason = "what C hands over: pointer, stride and count of each array"
)]

mod backend;
mod batch;
mod buffer;
mod build_settings;
mod built;
mod casts;
mod edits;
mod entry;
mod filter;
mod handle;
mod lazy;
mod lists;
mod mesh;
mod opacity;
mod options;
mod points;
mod pool;
mod progress;
mod query_settings;
mod ray;
mod record;
mod scene;
mod scene_query;
mod shapes;
mod status;
mod tree;
mod tree_query;
mod volumes;

#[cfg(test)]
mod tests;
