// Twin of core/src/tree/node.rs: the two words of a node.

// Subtrees that `build_small` keeps for `emit_small`: three words a node. Of an interior node its two words, the first and
// the last; of a leaf which of the root's references it has, a bit each, and then where it begins among the subtree's.
const SUBTREE_NODES: u32 = 42u;
const SUBTREE_WORDS: u32 = 126u;

// A leaf of `count` references from `first` on.
fn leaf(first: u32, count: u32) -> vec2<u32> {
    return vec2<u32>(first, (count << 2u) | 3u);
}
