//! Boxes as bytes: quantised outward.

use super::{CHILDREN, CompressedNode, LEAF_ENTRY, LEAF_SHIFT};
use crate::aabb::Aabb;

/// Least exponent of a quantum: such quanta, and their products with what rays have, are normal numbers.
const LEAST_QUANTUM: i32 = -100;

/// A power of two, exact in `f64`.
fn power(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

/// floor(log2 x) of a positive number; that of the least normal one for less.
fn exponent_of(x: f64) -> i32 {
    ((x.to_bits() >> 52) & 0x7ff) as i32 - 1023
}

/// The float next to `x` that is not above it.
pub(super) fn rounded_down(x: f64) -> f32 {
    let near = (x as f32).clamp(-f32::MAX, f32::MAX);
    if f64::from(near) > x { near.next_down().max(-f32::MAX) } else { near }
}

/// The float next to `x` that is not below it.
pub(super) fn rounded_up(x: f64) -> f32 {
    -rounded_down(-x)
}

/// Origin and exponent of the quanta on an axis for sides from `lo` to `hi`.
fn frame(lo: f32, hi: f32) -> (f32, i32) {
    let (lo, hi) = (f64::from(lo), f64::from(hi));
    // Less than a hundredth of what a float of this magnitude resolves is never needed.
    let finest = exponent_of(lo.abs().max(hi.abs())) - 32;
    let mut exponent = exponent_of((hi - lo) / 256.0).max(finest).max(LEAST_QUANTUM);
    loop {
        // Two quanta below the least side, so that none is negative.
        let origin = rounded_down(lo - 2.0 * power(exponent));
        if above((hi - f64::from(origin)) / power(exponent)) <= 255 || exponent >= 127 {
            return (origin, exponent);
        }
        exponent += 1;
    }
}

/// One quantum below a place, in whole quanta.
fn below(place: f64) -> u32 {
    (place.max(0.0) as u32).saturating_sub(1)
}

/// One quantum above a place, in whole quanta.
fn above(place: f64) -> u32 {
    let whole = place.max(0.0) as u32;
    whole.saturating_add(if f64::from(whole) < place { 2 } else { 1 })
}

impl CompressedNode {
    /// Sets the boxes of the children: each holds the given one and a quantum more on every side.
    pub(super) fn set_boxes(&mut self, boxes: &[Aabb]) {
        let all = boxes.iter().fold(Aabb::EMPTY, |all, one| all.union(one));
        self.exponents = 0;
        if boxes.is_empty() {
            return;
        }
        for axis in 0..3 {
            let (origin, exponent) = frame(all.lo[axis], all.hi[axis]);
            self.origin[axis] = origin;
            self.exponents |= ((exponent + 127) as u32) << (8 * axis);
            let place = |side: f32| (f64::from(side) - f64::from(origin)) / power(exponent);
            for (child, bounds) in boxes.iter().enumerate() {
                let shift = 8 * (child % 4);
                let (lower, upper) = (below(place(bounds.lo[axis])), above(place(bounds.hi[axis])));
                self.lower[axis][child / 4] |= lower.min(255) << shift;
                self.upper[axis][child / 4] |= upper.min(255) << shift;
            }
        }
    }

    /// The quantum on an axis.
    pub(super) fn quantum(&self, axis: usize) -> f32 {
        f32::from_bits(((self.exponents >> (8 * axis)) & 0xff) << 23)
    }

    /// Says what a child is; its byte was 0.
    pub(super) fn set_count(&mut self, child: usize, count: u32) {
        self.counts[child / 4] |= count << (8 * (child % 4));
    }

    /// What there is of a child: see [`CompressedNode::counts`].
    pub(super) fn count(&self, child: usize) -> u32 {
        byte(&self.counts, child)
    }

    /// The lower or upper side of a child's box on an axis, in quanta.
    pub(super) fn side(&self, child: usize, axis: usize, upper: bool) -> u32 {
        byte(if upper { &self.upper[axis] } else { &self.lower[axis] }, child)
    }

    /// A child's box, as it is in real numbers: for tests and reports.
    pub fn child_bounds(&self, child: usize) -> [[f64; 2]; 3] {
        core::array::from_fn(|axis| {
            [false, true].map(|upper| {
                let quanta = f64::from(self.side(child, axis, upper));
                f64::from(self.origin[axis]) + quanta * f64::from(self.quantum(axis))
            })
        })
    }

    /// What the children are, in their order: the number of a node, or a leaf's range of references.
    pub fn children(&self) -> impl Iterator<Item = CompressedChild> {
        let (mut node, mut first) = (self.first_child, self.first_reference);
        let node_of = *self;
        (0..CHILDREN).map_while(move |child| match node_of.count(child) {
            0 => None,
            super::INNER_CHILD => {
                node += 1;
                Some(CompressedChild::Node(node - 1))
            }
            count => {
                first += count;
                Some(CompressedChild::Leaf { first: first - count, count })
            }
        })
    }
}

/// What a child of a compressed node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CompressedChild {
    /// Another node.
    Node(u32),
    /// A leaf.
    Leaf {
        /// Its first reference.
        first: u32,
        /// How many references it has; at least one.
        count: u32,
    },
}

impl CompressedChild {
    /// The entry of a stack for the child: [`LEAF_ENTRY`] says how.
    pub(super) fn entry(self) -> u32 {
        match self {
            CompressedChild::Node(node) => node,
            CompressedChild::Leaf { first, count } => LEAF_ENTRY | count << LEAF_SHIFT | first,
        }
    }

    /// The child of an entry.
    pub(super) fn of_entry(entry: u32) -> CompressedChild {
        if entry & LEAF_ENTRY == 0 {
            return CompressedChild::Node(entry);
        }
        let first = entry & ((1 << LEAF_SHIFT) - 1);
        CompressedChild::Leaf { first, count: (entry & !LEAF_ENTRY) >> LEAF_SHIFT }
    }
}

/// A byte of eight.
fn byte(words: &[u32; 2], place: usize) -> u32 {
    (words[place / 4] >> (8 * (place % 4))) & 0xff
}
