//! Point trees on CPU cores: built in parallel, searched by vectors.

mod layout;
pub(crate) mod order;
mod search;
mod tree;

pub use tree::CpuPointTree;
