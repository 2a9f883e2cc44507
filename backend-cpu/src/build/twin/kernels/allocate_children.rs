//! `allocate_children`: one workgroup.
//!
//! Reads: active nodes, decisions with counts. Writes: where each child's references go; the next
//! list, the small list and the top tree, in the order of the active list. Caps bind here, by a
//! running sum over the list: nodes beyond them are transferred unsplit.

use splitplane_core::config::{BuildConfig, CHUNK};
use splitplane_core::kernel::Counter;
use splitplane_core::layout::{Counters, Decision, LargeNode, Sides, SmallRoot, TopNode};

/// The lists that grow.
#[derive(Debug)]
pub(crate) struct Lists<'a> {
    /// The next list, from its start.
    pub next: &'a mut Vec<LargeNode>,
    /// The small list.
    pub small: &'a mut Vec<SmallRoot>,
    /// The top tree.
    pub top: &'a mut Vec<TopNode>,
    /// First top node of each level.
    pub level_starts: &'a mut Vec<u32>,
    /// Not part of the schedule: how many references splits have added, whether they were done or not.
    pub growth: &'a mut u64,
}

/// What a level adds to the lists at most, whatever caps do: top nodes, small roots and next nodes.
pub(crate) fn most(decisions: &[Decision]) -> [usize; 3] {
    let children = 2 * decisions.len();
    let cuts: usize = decisions.iter().map(|decision| 2 * decision.cut_count as usize).sum();
    [cuts + children, children, children]
}

/// Runs the kernel. The lists have space for what [`most`] says.
pub(crate) fn run(
    config: &BuildConfig,
    active: &[LargeNode],
    decisions: &mut [Decision],
    lists: &mut Lists<'_>,
    counters: &mut Counters,
) {
    let triangles = counters[Counter::Triangles];
    let reference_cap = config.reference_cap(triangles);
    let node_cap = config.node_cap(triangles);
    lists.next.clear();
    lists.small.truncate(counters[Counter::SmallRoots] as usize);
    lists.top.truncate(counters[Counter::TopNodes] as usize);
    lists.level_starts.truncate(counters[Counter::Levels] as usize);
    lists.level_starts.push(counters[Counter::TopNodes]);

    // What is alive if no further node is split.
    let before = counters[Counter::SmallReferences] + counters[Counter::ActiveReferences];
    let mut alive = before;
    let level = counters[Counter::Levels];
    let (mut next_references, mut next_chunks) = (0, 0);
    let mut small_references = counters[Counter::SmallReferences];
    for (node, decision) in active.iter().zip(decisions) {
        let emitted = 2 * decision.cut_count + 2;
        let growth = (decision.counts.left + decision.counts.right).saturating_sub(node.count);
        *lists.growth += u64::from(growth);
        if lists.top.len() as u64 + u64::from(emitted) > u64::from(node_cap) {
            decision.cut_count = 0;
            transfer(decision, node.count);
        } else if decision.axis != Decision::TRANSFER {
            // Kept even when the cap binds, so that one large node does not let smaller ones pass:
            // the sum is a plain scan.
            alive = alive.saturating_add(growth);
            if alive > reference_cap {
                transfer(decision, node.count);
            }
        }

        decision.first_node = lists.top.len() as u32;
        let mut current = node.node as usize;
        let mut cell = node.cell();
        let mut depth = node.depth;
        for index in 0..decision.cut_count {
            let (side, position) = (decision.cut_side(index), decision.cuts[index as usize]);
            let empty = lists.top.len() as u32;
            lists.top.push(EMPTY);
            lists.top.push(EMPTY);
            let low = side.is_multiple_of(2);
            let (left, right) = if low { (empty, empty + 1) } else { (empty + 1, empty) };
            lists.top[current] = interior(side / 2, position, left, right);
            if low {
                cell.lo[side / 2] = position;
            } else {
                cell.hi[side / 2] = position;
            }
            current = empty as usize + 1;
            depth += 1;
        }
        let mut place = |count: u32, cell, depth, top: usize, side: u32, lists: &mut Lists<'_>| {
            if count > config.small_node_limit() && decision.axis != Decision::TRANSFER {
                let first = next_references;
                let first_chunk = next_chunks;
                next_references += count;
                next_chunks += count.div_ceil(CHUNK);
                lists.next.push(LargeNode {
                    first,
                    count,
                    node: top as u32,
                    depth,
                    source: node.first_chunk,
                    source_chunks: node.count.div_ceil(CHUNK),
                    side,
                    inseparable: u32::from(
                        decision.counts.left == node.count && decision.counts.right == node.count,
                    ),
                    first_chunk,
                    padding: 0,
                    ..with_cell(cell)
                });
                first
            } else if count > 0 {
                let first = small_references;
                small_references += count;
                lists.top[top] = TopNode {
                    kind: TopNode::SMALL_ROOT,
                    split: 0,
                    left: lists.small.len() as u32,
                    right: 0,
                };
                lists.small.push(SmallRoot {
                    lo: cell.lo,
                    first,
                    hi: cell.hi,
                    count,
                    node: top as u32,
                    depth,
                    level: level + u32::from(decision.axis != Decision::TRANSFER),
                    padding: 0,
                });
                first
            } else {
                small_references
            }
        };
        if decision.axis == Decision::TRANSFER {
            decision.first =
                Sides { left: place(node.count, cell, depth, current, 0, lists), right: 0 };
        } else {
            let (axis, position) = (decision.axis as usize, decision.position);
            let left = lists.top.len();
            lists.top.push(EMPTY);
            lists.top.push(EMPTY);
            lists.top[current] = interior(axis, position, left as u32, left as u32 + 1);
            let (mut left_cell, mut right_cell) = (cell, cell);
            left_cell.hi[axis] = position;
            right_cell.lo[axis] = position;
            decision.first = Sides {
                left: place(decision.counts.left, left_cell, depth + 1, left, 0, lists),
                right: place(decision.counts.right, right_cell, depth + 1, left + 1, 1, lists),
            };
        }
    }
    counters[Counter::NextNodes] = lists.next.len() as u32;
    counters[Counter::NextReferences] = next_references;
    counters[Counter::NextChunks] = next_chunks;
    counters[Counter::SmallRoots] = lists.small.len() as u32;
    counters[Counter::SmallReferences] = small_references;
    counters[Counter::TopNodes] = lists.top.len() as u32;
    counters[Counter::Levels] += 1;
    counters[Counter::Growth] = counters[Counter::Growth].saturating_add(alive - before);
}

/// Turns a split into a transfer.
fn transfer(decision: &mut Decision, count: u32) {
    decision.axis = Decision::TRANSFER;
    decision.position = 0.0;
    decision.counts = Sides { left: count, right: 0 };
}

/// What a top node is until its list says otherwise.
const EMPTY: TopNode = TopNode { kind: TopNode::EMPTY, split: 0, left: 0, right: 0 };

fn interior(axis: usize, position: f32, left: u32, right: u32) -> TopNode {
    TopNode { kind: axis as u32, split: position.to_bits(), left, right }
}

fn with_cell(cell: splitplane_core::aabb::Aabb) -> LargeNode {
    LargeNode { lo: cell.lo, hi: cell.hi, ..bytemuck::Zeroable::zeroed() }
}
