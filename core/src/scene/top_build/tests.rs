use super::*;
use crate::aabb::Aabb;
use crate::random;

fn boxes(count: usize, seed: u64) -> Vec<(u32, WorldBox)> {
    let number = |what: u64, at: usize| {
        (random::hash(seed, &[at as u64, what]) >> 40) as f32 / (1u64 << 24) as f32
    };
    let one = |at: usize| {
        let lo = [0, 1, 2].map(|axis| number(axis, at));
        let size = if at % 50 == 7 { 0.5 } else { 0.02 };
        let hi = [0, 1, 2].map(|axis| lo[axis] + size * number(axis as u64 + 3, at));
        (at as u32, WorldBox { bounds: Aabb { lo, hi }, reach: number(6, at) })
    };
    (0..count).map(one).collect()
}

/// Every instance has one place, boxes hold what is below, children come before empty places, and no node has just one.
fn check(tree: &TopTree, boxes: &[(u32, WorldBox)]) -> usize {
    let mut seen = alloc::vec![0u32; boxes.len()];
    let mut depth = alloc::vec![0usize; tree.nodes().len()];
    for (at, node) in tree.nodes().iter().enumerate() {
        depth[at] += 1;
        let there =
            node.children.iter().filter(|&&child| child != super::super::top_tree::NONE).count();
        assert!(there > 1 || boxes.len() == 1, "a node of {there}");
        for (slot, &child) in node.children[..there].iter().enumerate() {
            let own = node.child_box(slot);
            if child & INSTANCE != 0 {
                let name = (child & !INSTANCE) as usize;
                assert_eq!(own, boxes[name].1);
                assert_eq!(tree.places[name], Place { node: at as u32, slot: slot as u32 });
                seen[name] += 1;
            } else {
                assert!(child as usize > at);
                assert_eq!(own, tree.nodes()[child as usize].whole_box());
                depth[child as usize] = depth[at];
            }
        }
    }
    assert!(seen.iter().all(|&count| count == 1));
    let deepest = depth.into_iter().max().unwrap_or(0);
    assert_eq!(tree.depth(), deepest);
    deepest
}

#[test]
fn every_instance_has_one_place() {
    for count in [0, 1, 2, 7, 8, 9, 16, 17, 63, 64, 65, 500, 3000] {
        let boxes = boxes(count, count as u64);
        let tree = TopTree::build(count, boxes.iter().copied()).expect("memory");
        check(&tree, &boxes);
        // Nodes are full, but for a few.
        let least = count.saturating_sub(1).div_ceil(WIDTH - 1);
        assert!(tree.nodes().len() <= least * 2 + 1, "{} nodes over {count}", tree.nodes().len());
        let again = TopTree::build(count, boxes.iter().copied()).expect("memory");
        assert_eq!(tree.nodes(), again.nodes());
    }
}

/// Boxes in one place, boxes that hold one another, and those as wide as floats go: no deeper than stacks are.
#[test]
fn trees_are_no_deeper_than_stacks() {
    let same = WorldBox { bounds: Aabb { lo: [1.0; 3], hi: [2.0; 3] }, reach: 0.5 };
    let nested = |at: usize| {
        let far = crate::arithmetic::power_of_two((at % 250) as i32 - 126);
        WorldBox { bounds: Aabb { lo: [-far; 3], hi: [far * 1.5, far, far] }, reach: 0.0 }
    };
    let apart = |at: usize| {
        let far = crate::arithmetic::power_of_two((at % 250) as i32 - 126);
        WorldBox { bounds: Aabb { lo: [far; 3], hi: [far * 1.5; 3] }, reach: 0.0 }
    };
    for count in [9, 200, 2000] {
        for kind in 0..4 {
            let boxes: Vec<_> = (0..count)
                .map(|at| {
                    let own = match kind {
                        0 => same,
                        1 => nested(at),
                        2 => apart(at),
                        _ => WorldBox::EVERYWHERE,
                    };
                    (at as u32, own)
                })
                .collect();
            let tree = TopTree::build(count, boxes.iter().copied()).expect("memory");
            assert!(check(&tree, &boxes) <= LEVELS, "{kind}");
            assert!(tree.stack() <= super::super::top_walk::WIDEST_STACK);
        }
    }
}
