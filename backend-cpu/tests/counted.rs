//! Tests that count memory, or refuse it, by an allocator of their own: one at a time.

#[path = "common/counting.rs"]
mod counting;

mod allocations;
mod held_by_updates;
mod memory;
mod refusals;
mod scene_allocations;
