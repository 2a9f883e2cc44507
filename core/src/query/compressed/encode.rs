//! Boxes as bytes: quantised outward.

use super::{CHILDREN, CompressedNode, REFERENCE_BITS};
use crate::aabb::{Aabb, max};
use crate::arithmetic::{Arithmetic, Strict, exponent, power_of_two, snap};

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

/// The float next to `x` that is not above it.
pub(super) fn rounded_down(x: f64) -> f32 {
    let near = (x as f32).clamp(-f32::MAX, f32::MAX);
    if f64::from(near) > x { near.next_down().max(-f32::MAX) } else { near }
}

/// The float next to `x` that is not below it.
pub(super) fn rounded_up(x: f64) -> f32 {
    -rounded_down(-x)
}

/// The float below a snapped one, snapped: below what rounds to that.
pub(super) fn lower(x: f32) -> f32 {
    if x == 0.0 { -f32::MIN_POSITIVE } else { snap(x.next_down()).max(-f32::MAX) }
}

/// The float above a snapped one, likewise.
pub(super) fn upper(x: f32) -> f32 {
    -lower(-x)
}

/// Origin and exponent of the quanta on an axis for sides from `lo` to `hi`. By guarded operations, so that a device finds
/// the same.
fn frame(lo: f32, hi: f32) -> (f32, i32) {
    // Less than a hundredth of what a float of this magnitude resolves is never needed.
    let finest = exponent(max(lo.abs(), hi.abs())) - 32;
    let extent = Strict::snapped_difference(hi, lo);
    let mut power = (exponent(extent) - 8).max(finest).clamp(LEAST_QUANTUM, MOST_QUANTUM);
    loop {
        // Two quanta below the least side, so that none is negative.
        let origin = lower(Strict::snapped_difference(lo, power_of_two(power + 1)));
        if above(place(hi, origin, power)) <= 255 || power >= MOST_QUANTUM {
            return (origin, power);
        }
        power += 1;
    }
}

/// Where a side is, in quanta from the origin; rounded.
fn place(side: f32, origin: f32, power: i32) -> f32 {
    Strict::snapped_product(Strict::snapped_difference(side, origin), power_of_two(-power))
}

/// One quantum below a place that was rounded, in whole quanta.
fn below(place: f32) -> u32 {
    (max(lower(place), 0.0) as u32).saturating_sub(1)
}

/// One quantum above a place that was rounded, in whole quanta.
fn above(place: f32) -> u32 {
    let place = max(upper(place), 0.0);
    let whole = place as u32;
    whole.saturating_add(if (whole as f32) < place { 2 } else { 1 })
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
            let (origin, quantum) = frame(all.lo[axis], all.hi[axis]);
            self.origin[axis] = origin;
            self.exponents |= ((quantum + 127 + UNITS) as u32) << (8 * axis);
            let placed = |side: f32| place(side, origin, quantum);
            for (child, bounds) in boxes.iter().enumerate() {
                let (low, high) = (below(placed(bounds.lo[axis])), above(placed(bounds.hi[axis])));
                for (words, side) in self.sides[child / 4].iter_mut().zip([low, high]) {
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
