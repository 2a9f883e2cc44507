//! Answering rays: the layouts that queries read, and the traversals over them.
//!
//! Every path gives the hits of [`splitplane_core::traverse`] bit for bit: tests of many triangles at once
//! do the reference test's operations, in its order, and what they cannot decide goes to the reference
//! test itself. In accuracy `exact` they sort out what certainly is no hit (`sieve.rs`), and the hits are
//! those of [`splitplane_core::exact`].
//!
//! *Traversals*: `stream.rs` has batches of rays, `single.rs` one ray a call, both by the steps of `step.rs`;
//! `packet.rs` has rays that go the same way. Rays that need more care go through the tree's own nodes
//! (`walk.rs`), by the core's tests (`reference.rs`, `exact.rs`).

mod accelerator;
mod blocks;
mod exact;
mod indexed;
mod instruction_set;
mod layout;
mod leaf;
mod leaves;
mod limits;
mod order;
mod pack;
mod packet;
mod plan;
mod prepare;
mod prepare_one;
mod record;
mod reference;
mod sieve;
mod simd;
mod single;
mod step;
mod stream;
mod walk;
mod wide;

pub use accelerator::CpuAccelerator;
pub(crate) use blocks::WalkNode;
pub use instruction_set::InstructionSet;
pub(crate) use layout::{LayoutScratch, Source};
pub(crate) use simd::{Compiled, Simd};
