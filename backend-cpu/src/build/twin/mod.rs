//! The twin of what devices run: the schedule, kernel by kernel, over buffers that hold the same bytes.
//!
//! `kernels` has one file a kernel. The rules that kernels share with [`super::depth_first`] are beside it: how a small root
//! becomes a subtree, and how references are counted by bins.

pub mod buffers;
pub(crate) mod count_bins;
mod dispatch;
pub(crate) mod executor;
pub(crate) mod kernels;
pub(crate) mod small_root;
pub(crate) mod subtrees;

pub use executor::CpuExecutor;
