use crate::layout::Sides;

/// The references of both children of an active node: its decision's counts.
///
/// `chunk_counts` are those of the node's chunks, see [`super::chunks_of`]; their exclusive scan takes
/// their place.
pub fn count_children(chunk_counts: &mut [Sides]) -> Sides {
    let mut total = Sides::default();
    for counts in chunk_counts {
        let here = *counts;
        *counts = total;
        total.left += here.left;
        total.right += here.right;
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_become_offsets() {
        let sides = |pairs: [(u32, u32); 3]| pairs.map(|(left, right)| Sides { left, right });
        let mut counts = sides([(200, 100), (0, 256), (3, 4)]);
        assert_eq!(count_children(&mut counts), Sides { left: 203, right: 360 });
        assert_eq!(counts, sides([(0, 0), (200, 100), (200, 356)]));
    }
}
