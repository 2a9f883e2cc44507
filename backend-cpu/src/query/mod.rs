//! Answering rays: the layouts that queries read, and the traversals over them.
//!
//! Every path gives the hits of [`splitplane_core::traverse`] bit for bit: the wide tests only sort
//! out triangles, by the same operations in the same order, and what they let through is decided by
//! the reference test. In accuracy `exact` they sort out what certainly is no hit (`sieve.rs`), and the
//! hits are those of [`splitplane_core::exact`].

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
mod record;
mod sieve;
mod simd;
mod single;
mod stream;
mod wide;

pub use accelerator::CpuAccelerator;
pub(crate) use blocks::WalkNode;
pub use instruction_set::InstructionSet;
pub(crate) use layout::{LayoutScratch, Source};
