// Twin of core/src/tree/node.rs: the two words of a node.

// Subtrees that `build_small` keeps for `emit_small`: two words a node, then one a reference.
const SUBTREE_NODES: u32 = 24u;
const SUBTREE_REFERENCES: u32 = 80u;
const SUBTREE_WORDS: u32 = 128u;

// A leaf of `count` references from `first` on.
fn leaf(first: u32, count: u32) -> vec2<u32> {
    return vec2<u32>(first, (count << 2u) | 3u);
}
