//! How large a tree is.

/// What is known of a tree wherever it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct TreeSize {
    /// All nodes.
    pub nodes: usize,
    /// References of all leaves.
    pub references: usize,
    /// Bytes that queries read.
    pub bytes: u64,
}
