//! Subtrees in cache: what the kernels do level by level, one task does depth first for a node with few
//! references. The trees are the same.

pub mod build_cached;
pub(crate) mod columns;
pub(crate) mod count_bins;
pub(crate) mod cut;
pub(crate) mod lanes;
pub(crate) mod small_root;
