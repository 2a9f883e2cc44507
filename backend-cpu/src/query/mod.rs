//! Answering rays: the layouts that queries read, and the traversals over them.
//!
//! Every path gives the hits of [`splitplane_core::traverse`] bit for bit: the watertight test
//! (`watertight.rs`) does the operations of the reference in the same order, and the fast test
//! (`fast.rs`) only sorts out triangles and leaves the others to the reference. In accuracy `exact` what
//! certainly is no hit is sorted out (`sieve.rs`), and the hits are those of [`splitplane_core::exact`].

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
mod record;
mod sieve;
mod simd;
mod single;
mod stream;
mod watertight;
mod wide;

pub use accelerator::CpuAccelerator;
pub(crate) use blocks::{LayoutScratch, Source, WalkNode};
pub use instruction_set::InstructionSet;
