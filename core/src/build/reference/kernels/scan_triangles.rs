use crate::aabb::Aabb;
use crate::config::CHUNK;
use crate::kernel::Counter;
use crate::layout::{ChunkBounds, Counters, LargeNode, Sides, TopNode};

/// Makes the root from the chunks of the input.
///
/// `ChunkCounts` become the exclusive scan of the triangles kept, on the left; the right stays.
/// Writes the root as the first of `ActiveNodes`, its cell being the bounds of all triangles kept,
/// and as the first of `TopNodes`. Where nothing is kept, the list of active nodes stays empty and
/// the root an empty leaf. Counts triangles dropped and snapped, active nodes, their references and chunks,
/// and top nodes.
pub fn scan_triangles(
    chunk_bounds: &[ChunkBounds],
    chunk_counts: &mut [Sides],
    counters: &mut Counters,
) -> (LargeNode, TopNode) {
    let (mut kept, mut snapped) = (0, 0);
    let mut cell = Aabb::EMPTY;
    for (counts, bounds) in chunk_counts.iter_mut().zip(chunk_bounds) {
        let here = counts.left;
        counts.left = kept;
        kept += here;
        snapped += counts.right;
        cell = cell.union(&bounds.sides[0]);
    }
    counters[Counter::Dropped] = counters[Counter::Triangles] - kept;
    counters[Counter::Snapped] = snapped;
    counters[Counter::ActiveNodes] = u32::from(kept > 0);
    counters[Counter::ActiveReferences] = kept;
    counters[Counter::Chunks] = kept.div_ceil(CHUNK);
    counters[Counter::TopNodes] = 1;
    let root = LargeNode {
        lo: cell.lo,
        first: 0,
        hi: cell.hi,
        count: kept,
        node: 0,
        depth: 0,
        // The chunks of the input take the place of those of a parent.
        source: 0,
        source_chunks: chunk_bounds.len() as u32,
        side: 0,
        inseparable: 0,
        first_chunk: 0,
        padding: 0,
    };
    (root, TopNode { kind: TopNode::EMPTY, split: 0, left: 0, right: 0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_holds_all_that_is_kept() {
        let part = |x: f32| Aabb { lo: [x; 3], hi: [x + 1.0; 3] };
        let bounds = [part(3.0), Aabb::EMPTY, part(-1.0)]
            .map(|left| ChunkBounds { sides: [left, Aabb::EMPTY] });
        let mut counts = [(200, 3), (0, 0), (17, 4)].map(|(left, right)| Sides { left, right });
        let mut counters = Counters::at_start(600);
        let (root, top) = scan_triangles(&bounds, &mut counts, &mut counters);
        assert_eq!(counts.map(|counts| counts.left), [0, 200, 200]);
        assert_eq!((root.cell(), root.count), (Aabb { lo: [-1.0; 3], hi: [4.0; 3] }, 217));
        assert_eq!((root.source_chunks, top.kind), (3, TopNode::EMPTY));
        assert_eq!((counters[Counter::Dropped], counters[Counter::Snapped]), (383, 7));
        assert_eq!((counters[Counter::ActiveNodes], counters[Counter::TopNodes]), (1, 1));
        assert_eq!((counters[Counter::InputChunks], counters[Counter::Chunks]), (3, 1));
    }

    #[test]
    fn without_triangles_no_node_is_active() {
        let mut counters = Counters::at_start(0);
        let (root, _) = scan_triangles(&[], &mut [], &mut counters);
        assert_eq!(root.cell(), Aabb::EMPTY);
        assert_eq!((counters[Counter::ActiveNodes], counters[Counter::TopNodes]), (0, 1));
    }
}
