use crate::config::{CHUNK, SPAN};
use crate::layout::{Chunk, Decision, Sides};

/// Adds what a chunk gives to the children of its node, as [`super::classify_references()`] counts it, to the node's decision and
/// to the first chunk of its span: the second step of that kernel. Chunks may come in any order.
///
/// Nothing is added where the node is transferred: its decision has the counts already.
pub fn count_children(
    chunk: usize,
    counts: Sides,
    chunks: &mut [Chunk],
    decisions: &mut [Decision],
) {
    let decision = &mut decisions[chunks[chunk].node as usize];
    if decision.axis == Decision::TRANSFER {
        return;
    }
    decision.counts.left += counts.left;
    decision.counts.right += counts.right;
    let place = (chunks[chunk].first - decision.source_first) / CHUNK;
    let first_of_span = chunk - (place % SPAN) as usize;
    chunks[first_of_span].span_sides += counts.left + (counts.right << 16);
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    /// A node that is transferred before one of two spans and a chunk, in which all references go to both sides.
    #[test]
    fn nodes_and_spans_are_counted() {
        const LONG: u32 = 2 * SPAN + 1;
        let chunk =
            |node, index| Chunk { node, first: 7 + index * CHUNK, count: CHUNK, span_sides: 0 };
        let mut chunks: [Chunk; 3 + LONG as usize] =
            core::array::from_fn(|index| chunk(u32::from(index >= 3), index as u32));
        let transfer = Sides { left: 3 * CHUNK, right: 0 };
        let mut decisions = [
            Decision {
                axis: Decision::TRANSFER,
                counts: transfer,
                source_first: 7,
                ..Decision::zeroed()
            },
            Decision { source_first: 7 + 3 * CHUNK, ..Decision::zeroed() },
        ];
        for index in (0..chunks.len()).rev() {
            count_children(index, Sides { left: CHUNK, right: CHUNK }, &mut chunks, &mut decisions);
        }
        assert_eq!(decisions[0].counts, transfer);
        let all = LONG * CHUNK;
        assert_eq!(decisions[1].counts, Sides { left: all, right: all });
        let full = SPAN * CHUNK;
        let spans = [(3, full), (3 + SPAN, full), (3 + 2 * SPAN, CHUNK)];
        for (index, chunk) in (0..).zip(&chunks) {
            let sides = spans.iter().find(|span| span.0 == index).map_or(0, |span| span.1);
            assert_eq!(chunk.span_sides, sides | sides << 16, "{index}");
        }
    }
}
