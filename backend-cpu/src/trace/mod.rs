//! Answering rays: traversals over what [`layout`](crate::layout) has made.
//!
//! Every path gives the hits of [`splitplane_core::query::traverse`] bit for bit: the watertight test
//! (`watertight.rs`, `refined.rs`) performs the operations of the reference in the same order, and
//! the fast test (`fast.rs`) only rejects triangles and leaves the others to the reference. In
//! accuracy `exact` triangles that are certainly no hit are rejected (`sieve.rs`), and the hits are
//! those of [`splitplane_core::exact`].
//!
//! *Traversals*: `stream.rs` traces batches of rays (by `turns.rs`) and `single.rs` one ray per call, both by the
//! steps of `step.rs`; `packet` traces rays that go the same way. Rays that need more care go
//! through the tree's own nodes (`walk.rs`), by the core's tests (`reference.rs`, `exact.rs`).

pub(crate) mod batch;
pub(crate) mod block_test;
pub(crate) mod bunch;
pub(crate) mod exact;
#[cfg(not(target_family = "wasm"))]
pub(crate) mod exact_hits;
pub(crate) mod fast;
pub(crate) mod keep;
pub(crate) mod leaves;
pub(crate) mod packet;
pub(crate) mod prepare;
pub(crate) mod prepare_one;
pub(crate) mod queues;
pub(crate) mod ray_state;
pub(crate) mod reference;
pub(crate) mod refined;
pub(crate) mod sieve;
pub(crate) mod single;
pub(crate) mod step;
pub(crate) mod stream;
mod supply;
pub(crate) mod triangle_block;
mod turns;
mod unfinished;
pub(crate) mod walk;
pub(crate) mod watertight;
