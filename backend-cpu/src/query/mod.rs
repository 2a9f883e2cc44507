//! Answering rays: the layouts that queries read, and the traversals over them.
//!
//! Every path gives the hits of [`splitplane_core::traverse`] bit for bit: the watertight test of many
//! triangles at once (`watertight.rs`) does the reference test's operations, in its order, and the fast
//! one (`fast.rs`) only sorts out triangles and leaves the others to the reference test. In accuracy
//! `exact` what certainly is no hit is sorted out (`sieve.rs`), and the hits are those of
//! [`splitplane_core::exact`].
//!
//! *Traversals*: `stream.rs` has batches of rays, `single.rs` one ray a call, both by the steps of `step.rs`;
//! `packet.rs` has rays that go the same way. Rays that need more care go through the tree's own nodes
//! (`walk.rs`), by the core's tests (`reference.rs`, `exact.rs`).

mod accelerator;
mod blocks;
mod exact;
mod fast;
mod indexed;
mod instruction_set;
mod leaf;
mod leaves;
mod packet;
mod plane;
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
mod watertight;
mod wide;

pub use accelerator::CpuAccelerator;
pub(crate) use blocks::{LayoutScratch, Source, WalkNode};
pub use instruction_set::InstructionSet;
pub(crate) use simd::{Compiled, Simd};
