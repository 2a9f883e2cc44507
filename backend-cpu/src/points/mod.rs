//! Point trees on CPU cores: built in parallel, searched by vectors.

mod divide;
mod layout;
mod lists;
pub(crate) mod order;
mod search;
mod tree;

pub use lists::KeptBytes;
pub use tree::CpuPointTree;
