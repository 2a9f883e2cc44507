//! A walk through the wide nodes of rays for whoever asks about volumes: cells are looked at one by one, and triangles given as they are.

use splitplane_core::aabb::Aabb;
use splitplane_core::error::{QueryError, refused};
use splitplane_core::triangle::Triangle;

use crate::layout::tree_layout::TreeLayout;
use crate::layout::wide_node::{
    CacheLine, bounds_offset, children_offset, is_leaf, leaf_number, lines_of_node,
};
use crate::simd::{Compiled, MOST_LANES, Simd};
use crate::trace::leaves::{IndexedLeaves, Leaves, PackedLeaves};
use crate::trace::triangle_block::TriangleBlock;

/// What a walk is for.
pub(crate) trait CellVisitor {
    /// A number for a box by which the least is visited first; `None` where it is of no interest.
    fn bound(&self, cell: &Aabb) -> Option<f64>;

    /// Whether a box with this number still is.
    fn is_open(&self, bound: f64) -> bool;

    /// Looks at a triangle; one may come again. False where that was enough.
    fn test(&mut self, corners: &Triangle, triangle: u32) -> Result<bool, QueryError>;
}

/// A walk. The layout must be made for the width of the set.
pub(crate) struct Walk<'a, V> {
    pub layout: &'a TreeLayout,
    pub visitor: &'a mut V,
}

/// A child that waits.
#[derive(Clone, Copy)]
struct Waiting {
    bound: f64,
    child: u32,
}

impl<V: CellVisitor> Compiled for Walk<'_, V> {
    type Output = Result<(), QueryError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<(), QueryError> {
        let Walk { layout, visitor } = self;
        let lines = layout.wide.lines();
        if lines.is_empty() {
            return Ok(());
        }
        let mut stack = Vec::new();
        let refused = |_| refused((layout.wide.stack() * size_of::<Waiting>()) as u64);
        stack.try_reserve_exact(layout.wide.stack()).map_err(refused)?;
        // SAFETY: the caller's contract.
        unsafe {
            match IndexedLeaves::of(layout) {
                None => walk::<S, _, V>(lines, PackedLeaves::new(layout), visitor, stack),
                Some(leaves) => walk::<S, IndexedLeaves<'_>, V>(lines, leaves, visitor, stack),
            }
        }
    }
}

/// # Safety
/// The processor must have the set, and lines and leaves must be of one layout made for its width.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn walk<S: Simd, L: Leaves, V: CellVisitor>(
    lines: &[CacheLine],
    leaves: L,
    visitor: &mut V,
    mut stack: Vec<Waiting>,
) -> Result<(), QueryError> {
    let mut room = L::room();
    stack.push(Waiting { bound: f64::NEG_INFINITY, child: 0 });
    while let Some(Waiting { bound, child }) = stack.pop() {
        if !visitor.is_open(bound) {
            continue;
        }
        // SAFETY: children are those of a node.
        unsafe {
            if !is_leaf(child) {
                spread::<S, V>(lines, child, visitor, &mut stack);
            } else if !visit::<S, L, V>(leaves, leaf_number(child), &mut room, visitor)? {
                return Ok(());
            }
        }
    }
    Ok(())
}

/// Puts the children of a node that are of interest on the stack, the least last.
///
/// # Safety
/// The node must be one of the lines.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn spread<S: Simd, V: CellVisitor>(
    lines: &[CacheLine],
    node: u32,
    visitor: &V,
    stack: &mut Vec<Waiting>,
) {
    // SAFETY: the caller's contract.
    let node = unsafe { lines.as_ptr().add(node as usize * lines_of_node(S::N)).cast::<u8>() };
    // SAFETY: lanes of the node.
    let side = |axis, upper, lane| unsafe {
        *node.add(bounds_offset(S::N, axis, upper)).cast::<f32>().add(lane)
    };
    let mut few = [Waiting { bound: 0.0, child: 0 }; MOST_LANES];
    let mut count = 0;
    for lane in 0..S::N {
        let cell = Aabb {
            lo: [0, 1, 2].map(|axis| side(axis, false, lane)),
            hi: [0, 1, 2].map(|axis| side(axis, true, lane)),
        };
        // Places without a child have sides in the wrong order.
        if cell.lo[0] > cell.hi[0] {
            continue;
        }
        let Some(bound) = visitor.bound(&cell).filter(|&bound| visitor.is_open(bound)) else {
            continue;
        };
        // SAFETY: a lane of the node.
        let child = unsafe { *node.add(children_offset(S::N)).cast::<u32>().add(lane) };
        let mut place = count;
        while place > 0 && few[place - 1].bound < bound {
            few[place] = few[place - 1];
            place -= 1;
        }
        few[place] = Waiting { bound, child };
        count += 1;
    }
    stack.extend_from_slice(&few[..count]);
}

/// Shows the triangles of a leaf; false where that was enough.
///
/// # Safety
/// The processor must have the set; the leaf must be one that a node names.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn visit<S: Simd, L: Leaves, V: CellVisitor>(
    leaves: L,
    leaf: u32,
    room: &mut L::Room,
    visitor: &mut V,
) -> Result<bool, QueryError> {
    let mut from = 0;
    loop {
        // SAFETY: the caller's contract.
        let (block, next) = unsafe { leaves.block::<S>(leaf, from, room) };
        for lane in 0..block.count() {
            if !visitor.test(&block.corners(lane), block.triangle(lane))? {
                return Ok(false);
            }
        }
        from = next;
        if L::ONE || from == 0 {
            return Ok(true);
        }
    }
}
