//! Answering rays: the layouts that queries read, and the traversals over them.
//!
//! Every path gives the hits of [`splitplane_core::traverse`] bit for bit: the watertight test
//! (`watertight.rs`, `refined.rs`) does the operations of the reference in its order, and the fast test
//! (`fast.rs`) only sorts out triangles and leaves the others to the reference. In accuracy `exact` what
//! certainly is no hit is sorted out (`sieve.rs`), and the hits are those of [`splitplane_core::exact`].
//!
//! *Traversals*: `stream.rs` has batches of rays, `single.rs` one ray a call, both by the steps of `step.rs`;
//! `packet` has rays that go the same way. Rays that need more care go through the tree's own nodes
//! (`walk.rs`), by the core's tests (`reference.rs`, `exact.rs`).

mod accelerator;
mod blocks;
mod exact;
mod fast;
mod indexed;
mod instruction_set;
mod large;
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
mod refined;
mod sieve;
mod simd;
mod single;
mod step;
mod stream;
mod walk;
mod watertight;
mod wide;

pub use accelerator::CpuAccelerator;
pub(crate) use blocks::WalkNode;
pub use instruction_set::InstructionSet;
pub(crate) use layout::{LayoutScratch, Source};
pub(crate) use simd::{Compiled, Simd};
