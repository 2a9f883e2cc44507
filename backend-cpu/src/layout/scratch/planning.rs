//! Planning: what tasks do with their subtrees, and the nodes above them.

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::QueryLayout;
use splitplane_core::config::MAX_DEPTH;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::{KdNode, NodeKind};

use super::packed_words::{Budget, PackedWords};
use super::{LayoutSource, PackTask};
use crate::cancel::ProgressMeter;
use crate::layout::cells::{halves, within};
use crate::layout::large::Large;
use crate::layout::leaf_groups::{DIVIDED, LeafGroups};
use crate::layout::pack::Packer;
use crate::layout::packed_block::UNIT_WORDS;
use crate::layout::plan::{Branch, Branches, PlaceCosts, Planner};
use crate::simd::InstructionSet;

/// What tasks read.
pub(super) struct LayoutPlanning<'a> {
    pub(super) tree: &'a KdTreeView<'a>,
    pub(super) source: LayoutSource<'a>,
    pub(super) set: InstructionSet,
    pub(super) meter: &'a ProgressMeter<'a>,
    pub(super) planner: Planner,
    pub(super) budget: &'a Budget,
    pub(super) large: &'a Large,
    /// Whether blocks have their corners written out.
    pub(super) written: bool,
}

impl LayoutPlanning<'_> {
    /// Packs the leaves of a task's subtree and plans it. After cancellation, or where there was no memory, the result is
    /// incomplete and must not be used.
    pub(super) fn make(
        &self,
        task: &mut PackTask,
        part: &mut PackedWords,
        branches: &mut [Branch],
    ) {
        let nodes = &self.tree.nodes[task.first as usize..task.end as usize];
        let mut packer = Packer::new(self.set.lanes(), self.written, self.source.triangles);
        // Large triangles have blocks of their own already, and are in the others for nothing.
        let divided = LeafGroups::are_worth_their_time(&self.tree.config) && self.large.is_empty();
        let mut groups = divided.then(|| LeafGroups::new(self.set.lanes(), self.planner.scale()));
        part.begin();
        // The references of the leaves follow each other.
        let last = match nodes.last().map(KdNode::kind) {
            Some(NodeKind::Leaf { first, count }) => first + count,
            _ => 0,
        };
        // The cells of right children that are to come.
        let mut cells = [Aabb::EMPTY; MAX_DEPTH as usize + 1];
        let (mut open, mut cell) = (0, task.cell);
        for (node, branch) in nodes.iter().zip(&mut *branches) {
            match node.kind() {
                NodeKind::Interior { axis, split, .. } => {
                    (cell, cells[open]) = halves(&cell, axis as usize, split);
                    open += 1;
                }
                NodeKind::Leaf { first, count } => {
                    if self.meter.record_work(2 * u64::from(count)) {
                        return;
                    }
                    if count > 0 {
                        let with = (&mut packer, groups.as_mut());
                        let leaf = self.leaf([first, count, last], &cell, with, part);
                        let Some(leaf) = leaf else { return };
                        *branch = leaf;
                        self.meter.advance(u64::from(count));
                    }
                    open = open.wrapping_sub(1);
                    if let Some(next) = cells.get(open) {
                        cell = *next;
                    }
                }
            }
        }
        task.costs = self.planner.subtree(self.set, task.first, nodes, branches);
        // The other half is that of the nodes that are made.
        self.meter.advance(nodes.len() as u64 / 2);
        self.meter.record_work(8 * nodes.len() as u64);
    }

    /// A leaf that is not empty: its first reference and how many, and the end of the task's. `None` where
    /// there is no memory for its blocks.
    fn leaf(
        &self,
        [first, count, last]: [u32; 3],
        cell: &Aabb,
        (packer, groups): (&mut Packer<'_>, Option<&mut LeafGroups>),
        part: &mut PackedWords,
    ) -> Option<Branch> {
        let references = &self.tree.references[first as usize..];
        let to_come = last.saturating_sub(first + count) as usize;
        let unit = (part.used / UNIT_WORDS) as u32;
        let compact = self.source.layout == QueryLayout::Compact;
        let (mut bounds, blocks) = match compact {
            true => (Aabb::EMPTY, 1),
            false => {
                let (own, counts) = (&references[..count as usize], [count as usize, to_come]);
                // Asked here too, so that the compiler can leave the division out of a browser's part.
                let divided = groups.filter(|_| DIVIDED).and_then(|groups| {
                    groups.several(own, self.source.triangles, cell).then_some(groups)
                });
                match divided {
                    None => self.pack(references, counts, packer, part)?,
                    Some(groups) => self.pack_groups(groups, counts, packer, part)?,
                }
            }
        };
        if compact || !self.large.is_empty() {
            let corners = |&triangle: &u32| (triangle, self.source.triangles[triangle as usize]);
            let own = references[..count as usize].iter().map(corners);
            bounds = self.large.bounds_of_others(own);
        }
        // No ray goes to a leaf without bounds.
        let within = if bounds.is_empty() { bounds } else { within(cell, &bounds) };
        Some(Branch::leaf(within, unit, blocks))
    }

    /// Packs the triangles of a leaf in groups. Otherwise as [`LayoutPlanning::pack`].
    fn pack_groups(
        &self,
        groups: &LeafGroups,
        [count, to_come]: [usize; 2],
        packer: &mut Packer<'_>,
        part: &mut PackedWords,
    ) -> Option<(Aabb, u32)> {
        let (mut bounds, mut blocks, mut left) = (Aabb::EMPTY, 0, count);
        for group in groups.groups() {
            left -= group.len();
            let packed = self.pack(group, [group.len(), left + to_come], packer, part)?;
            (bounds, blocks) = (bounds.union(&packed.0), blocks + packed.1);
        }
        Some((bounds, blocks))
    }

    /// Packs some triangles, the first of these references, with space for more to come. Returns
    /// their bounds, and how many blocks they take; `None` where there is no memory for them.
    fn pack(
        &self,
        references: &[u32],
        [count, to_come]: [usize; 2],
        packer: &mut Packer<'_>,
        part: &mut PackedWords,
    ) -> Option<(Aabb, u32)> {
        let (mut bounds, mut blocks, mut left) = (Aabb::EMPTY, 0, count);
        while left > 0 {
            let to = part.next(left + to_come, self.budget)?;
            let packed = packer.block(&references[count - left..], left, to);
            part.used += packed.words;
            bounds = bounds.union(&packed.bounds);
            left -= packed.count;
            blocks += 1;
        }
        Some((bounds, blocks))
    }

    /// Packs the large triangles, and says how many blocks they take: none in the compact layout.
    pub(super) fn pack_large(&self, part: &mut PackedWords) -> Option<u32> {
        part.begin();
        let triangles = self.large.triangles();
        if triangles.is_empty() || self.source.layout == QueryLayout::Compact {
            return Some(0);
        }
        let mut packer = Packer::large(self.set.lanes(), self.written, self.source.triangles);
        let (_, blocks) = self.pack(triangles, [triangles.len(), 0], &mut packer, part)?;
        Some(blocks)
    }

    /// Plans the nodes above the tasks.
    pub(super) fn join(
        &self,
        node: u32,
        tasks: &mut std::slice::Iter<'_, PackTask>,
        branches: &mut Branches<'_>,
    ) -> PlaceCosts {
        if let Some(task) = tasks.as_slice().first()
            && task.first == node
        {
            tasks.next();
            return task.costs;
        }
        let NodeKind::Interior { axis, right, .. } = self.tree.nodes[node as usize].kind() else {
            return PlaceCosts::NOTHING;
        };
        let one = self.join(node + 1, tasks, branches);
        let mut other = self.join(right, tasks, branches);
        self.planner.join(node, axis as u8, &one, &mut other, branches);
        other
    }
}
