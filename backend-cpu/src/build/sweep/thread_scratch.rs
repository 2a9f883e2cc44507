//! Scratch of one thread.

use splitplane_core::layout::Reference;
use splitplane_core::tree::node::KdNode;

use super::bins::Bins;

/// Lists of references, one above the other; what is above `top` is free.
#[derive(Debug, Default)]
pub(super) struct ReferenceStack {
    pub references: Vec<Reference>,
    pub top: usize,
}

/// Scratch of one thread. A node's references are on top of one stack. References that go right
/// stay there, those that go left go to the top of the other stack: so only the lists of waiting
/// nodes are held.
#[derive(Debug, Default)]
pub(super) struct ThreadScratch {
    pub stacks: [ReferenceStack; 2],
    pub bins: Bins,
    /// Which of a build's workers it is.
    pub number: usize,
    /// Nodes of the subtrees built so far; children and references count from the start of each.
    pub nodes: Vec<KdNode>,
    /// References of their leaves.
    pub references: Vec<u32>,
    /// Where the current subtree starts in either.
    pub start: [usize; 2],
    /// Work since the last call of the watch, in references read.
    pub work: usize,
}

impl ThreadScratch {
    /// A worker of this number.
    pub(super) fn new(number: usize) -> ThreadScratch {
        ThreadScratch { number, ..ThreadScratch::default() }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> u64 {
        let [a, b] = self.stacks.each_ref().map(|stack| stack.references.capacity());
        let references = (a + b) * size_of::<Reference>();
        let out = self.nodes.capacity() * size_of::<KdNode>() + self.references.capacity() * 4;
        (references + out + size_of::<ThreadScratch>()) as u64 + self.bins.bytes()
    }
}
