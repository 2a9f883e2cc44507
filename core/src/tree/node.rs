//! The 8-byte tree node.

use bytemuck::{Pod, Zeroable};

/// A coordinate axis.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Axis {
    /// First coordinate.
    X = 0,
    /// Second coordinate.
    Y = 1,
    /// Third coordinate.
    Z = 2,
}

impl Axis {
    /// All axes, in the order that breaks ties.
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// The axis with index 0, 1 or 2 (taken modulo 4; 3 is not an axis and gives `Z`).
    pub const fn from_index(index: u32) -> Axis {
        match index & 3 {
            0 => Axis::X,
            1 => Axis::Y,
            _ => Axis::Z,
        }
    }

    /// 0, 1 or 2.
    pub const fn index(self) -> usize {
        self as usize
    }
}

/// A node of the tree in 8 bytes, after Wald and Havran 2006 and pbrt.
///
/// | | word 0 | word 1, bits 2..32 | word 1, bits 0..2 |
/// |---|---|---|---|
/// | interior | split plane, bits of an `f32` | index of the right child | axis, 0 to 2 |
/// | leaf | index of the first reference | number of references | 3 |
///
/// Nodes are stored in preorder: the left child of node `i` is node `i + 1`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct KdNode {
    word: u32,
    tagged: u32,
}

/// The content of a node, decoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NodeKind {
    /// A split plane with two children.
    Interior {
        /// Axis the plane is perpendicular to.
        axis: Axis,
        /// Position of the plane on that axis.
        split: f32,
        /// Index of the right child; the left child follows its parent.
        right: u32,
    },
    /// A list of triangle references.
    Leaf {
        /// Index of the first one in the reference array.
        first: u32,
        /// How many; 0 for empty space.
        count: u32,
    },
}

impl KdNode {
    /// Greatest child index and greatest leaf size a node can hold: 30 bits.
    pub const MAX_INDEX: u32 = (1 << 30) - 1;

    /// An interior node. `right` must be at most [`KdNode::MAX_INDEX`].
    pub const fn interior(axis: Axis, split: f32, right: u32) -> KdNode {
        KdNode { word: split.to_bits(), tagged: (right << 2) | axis as u32 }
    }

    /// A leaf. `count` must be at most [`KdNode::MAX_INDEX`].
    pub const fn leaf(first: u32, count: u32) -> KdNode {
        KdNode { word: first, tagged: (count << 2) | 3 }
    }

    /// True for a leaf.
    #[inline]
    pub const fn is_leaf(&self) -> bool {
        self.axis_index() == 3
    }

    /// The node, decoded.
    #[inline]
    pub const fn kind(&self) -> NodeKind {
        if self.is_leaf() {
            NodeKind::Leaf { first: self.first(), count: self.count() }
        } else {
            NodeKind::Interior {
                axis: Axis::from_index(self.axis_index()),
                split: self.split(),
                right: self.right(),
            }
        }
    }

    /// Axis of an interior node, 0 to 2; 3 for a leaf.
    #[inline]
    pub const fn axis_index(&self) -> u32 {
        self.tagged & 3
    }

    /// Position of the split plane; only an interior node has one.
    #[inline]
    pub const fn split(&self) -> f32 {
        f32::from_bits(self.word)
    }

    /// Index of the right child; only an interior node has one.
    #[inline]
    pub const fn right(&self) -> u32 {
        self.tagged >> 2
    }

    /// Index of the first reference; only a leaf has one.
    #[inline]
    pub const fn first(&self) -> u32 {
        self.word
    }

    /// Number of references; only a leaf has them.
    #[inline]
    pub const fn count(&self) -> u32 {
        self.tagged >> 2
    }

    /// An interior node with another right child, for builders that know it later. `right` must be at most
    /// [`KdNode::MAX_INDEX`].
    #[inline]
    pub const fn with_right(self, right: u32) -> KdNode {
        KdNode { word: self.word, tagged: (right << 2) | self.axis_index() }
    }

    /// The two words as stored: what is hashed, written to files and sent to devices.
    pub const fn words(&self) -> [u32; 2] {
        [self.word, self.tagged]
    }

    /// The node with these two words; the inverse of [`KdNode::words`].
    pub const fn from_words(words: [u32; 2]) -> KdNode {
        KdNode { word: words[0], tagged: words[1] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_round_trip() {
        let inner = KdNode::interior(Axis::Y, -1.5, KdNode::MAX_INDEX);
        assert_eq!(
            inner.kind(),
            NodeKind::Interior { axis: Axis::Y, split: -1.5, right: KdNode::MAX_INDEX }
        );
        let leaf = KdNode::leaf(u32::MAX, KdNode::MAX_INDEX);
        assert_eq!(leaf.kind(), NodeKind::Leaf { first: u32::MAX, count: KdNode::MAX_INDEX });
        assert_eq!(KdNode::from_words(inner.words()), inner);
        let pending = KdNode::interior(Axis::Z, 0.25, 0);
        assert_eq!(pending.with_right(7), KdNode::interior(Axis::Z, 0.25, 7));
        assert_eq!(pending.with_right(7).with_right(KdNode::MAX_INDEX).right(), KdNode::MAX_INDEX);
    }
}
