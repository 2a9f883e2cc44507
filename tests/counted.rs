//! Tests that count memory by an allocator of their own: one at a time.

#[path = "common/counting.rs"]
mod counting;

#[cfg(all(feature = "animation", feature = "render"))]
mod frames;
mod limits;
