//! Scratch of one thread.

use splitplane_core::layout::Reference;
use splitplane_core::node::KdNode;

use super::bins::Bins;

/// Lists of references, one above the other; what is above `top` is free.
#[derive(Debug, Default)]
pub(super) struct ReferenceStack {
    pub references: Vec<Reference>,
    pub top: usize,
}

/// Scratch of one thread. A node's references are on top of one stack. What goes right stays there, what
/// goes left goes to the top of the other: so nothing is held but the lists of nodes that wait.
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
    /// Where the subtree at hand starts in either.
    pub start: [usize; 2],
    /// Work since the watch was asked last, in references looked at.
    pub work: usize,
}

impl ThreadScratch {
    /// A worker of this number.
    pub fn new(number: usize) -> ThreadScratch {
        ThreadScratch { number, ..ThreadScratch::default() }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let [a, b] = self.stacks.each_ref().map(|stack| stack.references.capacity());
        let references = (a + b) * size_of::<Reference>();
        let out = self.nodes.capacity() * size_of::<KdNode>() + self.references.capacity() * 4;
        (references + out + size_of::<ThreadScratch>()) as u64 + self.bins.bytes()
    }
}
