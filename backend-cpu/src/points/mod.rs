//! Point trees on CPU cores: built in parallel, searched by vectors.

mod columns;
#[cfg(test)]
mod counted;
mod divide;
mod few;
mod gather;
mod layout;
mod lists;
pub(crate) mod order;
mod search;
mod select;
mod tree;

pub use lists::KeptBytes;
pub use tree::CpuPointTree;
