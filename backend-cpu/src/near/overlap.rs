//! Overlaps, through the wide nodes of rays. What meets is decided as the reference does ([`splitplane_core::query::overlap`]), so
//! the answers are its, bit for bit.

use splitplane_core::aabb::Aabb;
use splitplane_core::error::{QueryError, refused};
use splitplane_core::query::overlap::{OverlapOptions, Region, Volume, add};

use crate::layout::tree_layout::TreeLayout;
use crate::layout::wide_node::{
    CacheLine, bounds_offset, children_offset, is_leaf, leaf_number, lines_of_node,
};
use crate::simd::{Compiled, Simd};
use crate::trace::leaves::{IndexedLeaves, Leaves, PackedLeaves};
use crate::trace::triangle_block::TriangleBlock;

/// A volume whose triangles are looked for. The layout must be made for the width of the set.
pub(crate) struct Overlapping<'a> {
    pub layout: &'a TreeLayout,
    pub volume: &'a Volume<'a>,
    /// Whether one triangle is enough.
    pub any: bool,
    pub options: &'a OverlapOptions<'a>,
}

impl Compiled for Overlapping<'_> {
    /// Triangles in any order, some more than once.
    type Output = Result<Vec<u32>, QueryError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<Vec<u32>, QueryError> {
        let Overlapping { layout, volume, any, options } = self;
        let mut found = Vec::new();
        let Some(region) = Region::new(volume)? else { return Ok(found) };
        let mut stack = Vec::new();
        let refused = |_| refused((layout.wide.stack() * size_of::<u32>()) as u64);
        stack.try_reserve_exact(layout.wide.stack()).map_err(refused)?;
        let mut search = Search { region, any, options, found: &mut found, stack };
        // SAFETY: the caller's contract.
        unsafe {
            match IndexedLeaves::of(layout) {
                None => search.run::<S, _>(layout.wide.lines(), PackedLeaves::new(layout))?,
                Some(leaves) => {
                    search.run::<S, IndexedLeaves<'_>>(layout.wide.lines(), leaves)?;
                }
            }
        }
        Ok(found)
    }
}

struct Search<'a> {
    region: Region,
    any: bool,
    options: &'a OverlapOptions<'a>,
    found: &'a mut Vec<u32>,
    /// Children that wait; as many as the nodes need fit.
    stack: Vec<u32>,
}

impl Search<'_> {
    /// # Safety
    /// The processor must have the set, and lines and leaves must be of one layout made for its width.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd, L: Leaves>(
        &mut self,
        lines: &[CacheLine],
        leaves: L,
    ) -> Result<(), QueryError> {
        if lines.is_empty() {
            return Ok(());
        }
        let mut room = L::room();
        self.stack.push(0);
        while let Some(child) = self.stack.pop() {
            // SAFETY: children are those of a node.
            unsafe {
                if !is_leaf(child) {
                    self.spread::<S>(lines, child);
                } else if !self.visit::<S, L>(leaves, leaf_number(child), &mut room)? {
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// Puts the children of a node that may meet the volume on the stack.
    ///
    /// # Safety
    /// The node must be one of the lines.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn spread<S: Simd>(&mut self, lines: &[CacheLine], node: u32) {
        // SAFETY: the caller's contract.
        let node = unsafe { lines.as_ptr().add(node as usize * lines_of_node(S::N)).cast::<u8>() };
        // SAFETY: lanes of the node.
        let side = |axis, upper, lane| unsafe {
            *node.add(bounds_offset(S::N, axis, upper)).cast::<f32>().add(lane)
        };
        for lane in 0..S::N {
            let cell = Aabb {
                lo: [0, 1, 2].map(|axis| side(axis, false, lane)),
                hi: [0, 1, 2].map(|axis| side(axis, true, lane)),
            };
            // Places without a child have sides in the wrong order.
            if cell.lo[0] <= cell.hi[0] && self.region.may_meet(&cell) {
                // SAFETY: a lane of the node.
                let child = unsafe { *node.add(children_offset(S::N)).cast::<u32>().add(lane) };
                self.stack.push(child);
            }
        }
    }

    /// Tests the triangles of a leaf; false where one of them was enough.
    ///
    /// # Safety
    /// The processor must have the set; the leaf must be one that a node names.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit<S: Simd, L: Leaves>(
        &mut self,
        leaves: L,
        leaf: u32,
        room: &mut L::Room,
    ) -> Result<bool, QueryError> {
        let mut from = 0;
        loop {
            // SAFETY: the caller's contract.
            let (block, next) = unsafe { leaves.block::<S>(leaf, from, room) };
            for lane in 0..block.count() {
                let triangle = block.triangle(lane);
                if self.options.ignore != Some(triangle) && self.region.meets(&block.corners(lane))
                {
                    add(self.found, triangle, self.options.max_memory)?;
                    if self.any {
                        return Ok(false);
                    }
                }
            }
            from = next;
            if L::ONE || from == 0 {
                return Ok(true);
            }
        }
    }
}
