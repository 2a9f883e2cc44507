//! The records of the kernels that make compressed nodes.

use core::ops::{Index, IndexMut};

use bytemuck::{Pod, Zeroable};

use crate::kernel::CompressCounter;

/// A part of a tree that becomes a compressed node or a leaf of one. 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Part {
    /// Lower corner of its cell, or of the box around a leaf.
    pub lo: [f32; 3],
    /// A node of the tree, or the first of some references.
    pub first: u32,
    /// Upper corner.
    pub hi: [f32; 3],
    /// How many references, or [`Part::SUBTREE`].
    pub count: u32,
}

impl Part {
    /// [`Part::count`] of a subtree.
    pub const SUBTREE: u32 = u32::MAX;
}

/// The inputs of the kernels: the WGSL struct of the same name.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Compress {
    /// What boxes are widened by: [`SceneScale::slack`](crate::query::intersect::SceneScale::slack).
    pub slack: f32,
    /// Always 0, as in [`SceneUniform::zero`](crate::layout::SceneUniform::zero).
    pub zero: u32,
    /// Most parts of a batch. No byte of the result depends on it.
    pub batch_room: u32,
    /// Most parts that can be queued.
    pub part_room: u32,
}

/// The counters, by [`CompressCounter`].
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct CompressCounters {
    /// Their values; the last ones are not used.
    pub words: [u32; 8],
}

impl CompressCounters {
    /// The counters before the first round: the root is queued.
    pub fn at_start() -> CompressCounters {
        let mut counters = CompressCounters::default();
        counters[CompressCounter::Waiting] = 1;
        counters[CompressCounter::Queued] = 1;
        counters
    }
}

impl Index<CompressCounter> for CompressCounters {
    type Output = u32;

    fn index(&self, counter: CompressCounter) -> &u32 {
        &self.words[counter as usize]
    }
}

impl IndexMut<CompressCounter> for CompressCounters {
    fn index_mut(&mut self, counter: CompressCounter) -> &mut u32 {
        &mut self.words[counter as usize]
    }
}
