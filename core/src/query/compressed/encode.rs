//! Boxes as bytes: quantised outward.

use super::{CHILDREN, CompressedNode, REFERENCE_BITS};
use crate::aabb::Aabb;

/// Least exponent of a quantum: such quanta, and their products with what rays have, are normal numbers.
const LEAST_QUANTUM: i32 = -100;
/// The greatest: 2^15 of such quanta are a number.
const MOST_QUANTUM: i32 = 127 - UNITS;
/// Where a side in quanta begins in a number from 1 to 2: in the middle of its mantissa.
const SIDE_SHIFT: u32 = 8;
/// A number from 1 to 2 whose mantissa holds a side stands for 2^15 quanta and the side.
const UNITS: i32 = 23 - SIDE_SHIFT as i32;

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
        if above((hi - f64::from(origin)) / power(exponent)) <= 255 || exponent >= MOST_QUANTUM {
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
        self.sides = [[[u32::MAX; 3], [0; 3]]; 2];
        if boxes.is_empty() {
            return;
        }
        for axis in 0..3 {
            let (origin, exponent) = frame(all.lo[axis], all.hi[axis]);
            self.origin[axis] = origin;
            self.exponents |= ((exponent + 127 + UNITS) as u32) << (8 * axis);
            let place = |side: f32| (f64::from(side) - f64::from(origin)) / power(exponent);
            for (child, bounds) in boxes.iter().enumerate() {
                let (lower, upper) = (below(place(bounds.lo[axis])), above(place(bounds.hi[axis])));
                for (words, side) in self.sides[child / 4].iter_mut().zip([lower, upper]) {
                    set_byte(&mut words[axis], child, side.min(255));
                }
            }
        }
    }

    /// 2^15 quanta on an axis.
    pub(super) fn units(&self, axis: usize) -> f32 {
        f32::from_bits(((self.exponents >> (8 * axis)) & 0xff) << 23)
    }

    /// The quantum on an axis.
    pub(super) fn quantum(&self, axis: usize) -> f64 {
        f64::from(self.units(axis)) * power(-UNITS)
    }

    /// Says what the children are: so many nodes, then leaves with so many references each.
    pub(super) fn set_children(&mut self, nodes: usize, leaves: &[u32]) {
        self.first_reference |= (nodes as u32) << REFERENCE_BITS;
        let mut end = 0;
        for child in nodes..CHILDREN {
            end += leaves.get(child - nodes).copied().unwrap_or(0);
            set_byte(&mut self.ends[child / 4], child, end);
        }
    }

    /// How many children are nodes.
    fn inner(&self) -> usize {
        (self.first_reference >> REFERENCE_BITS) as usize
    }

    /// The lower or upper side of a child's box on an axis, as a number from 1 to 2: 1 and the side in quanta by 2^15.
    pub(super) fn side(&self, child: usize, axis: usize, upper: bool) -> f32 {
        f32::from_bits(0x3f80_0000 | self.quanta(child, axis, upper) << SIDE_SHIFT)
    }

    fn quanta(&self, child: usize, axis: usize, upper: bool) -> u32 {
        byte(self.sides[child / 4][usize::from(upper)][axis], child)
    }

    /// A child's box, as it is in real numbers: for tests and reports.
    pub fn child_bounds(&self, child: usize) -> [[f64; 2]; 3] {
        core::array::from_fn(|axis| {
            [false, true].map(|upper| {
                let quanta = f64::from(self.quanta(child, axis, upper));
                f64::from(self.origin[axis]) + quanta * self.quantum(axis)
            })
        })
    }

    /// What the children are, in their order: the number of a node, or a leaf's range of references.
    pub fn children(&self) -> impl Iterator<Item = CompressedChild> {
        let node = *self;
        let all = (0..CHILDREN).map(move |child| node.child(child));
        all.take_while(|child| !matches!(child, CompressedChild::Leaf { count: 0, .. }))
    }

    /// A child; where there is none, a leaf without references.
    pub(super) fn child(&self, child: usize) -> CompressedChild {
        if child < self.inner() {
            return CompressedChild::Node(self.first_child + child as u32);
        }
        let end = |child: usize| byte(self.ends[child / 4], child);
        let start = if child == 0 { 0 } else { end(child - 1) };
        let first = (self.first_reference & ((1 << REFERENCE_BITS) - 1)) + start;
        CompressedChild::Leaf { first, count: end(child) - start }
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

/// The byte of a child in the word for it and its three neighbours.
fn byte(word: u32, child: usize) -> u32 {
    (word >> (8 * (child % 4))) & 0xff
}

/// Sets it.
fn set_byte(word: &mut u32, child: usize, value: u32) {
    let shift = 8 * (child % 4);
    *word = *word & !(0xff << shift) | value << shift;
}
