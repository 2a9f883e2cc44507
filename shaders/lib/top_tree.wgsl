// Ways up the top tree. Every node but the root is one of a pair, and pairs stand side by side behind the root.

// No more nodes or references are counted than this, which no list has room for: a bit is left to say who has arrived.
const MOST_SUMMED: u32 = 0x7fffffffu;

// The pair that a node other than the root belongs to.
fn pair_of(node: u32) -> u32 {
    return (node - 1u) >> 1u;
}

// The other node of its pair.
fn sibling_of(node: u32) -> u32 {
    return ((node - 1u) ^ 1u) + 1u;
}

// A word for each pair: the parent, and whether the first of the pair is the left child.
fn pair_word(parent: u32, first_is_left: bool) -> u32 {
    return (parent << 1u) | select(0u, 1u, first_is_left);
}

fn parent_in(word: u32) -> u32 {
    return word >> 1u;
}

// Whether a node is the right child, by the word of its pair. First nodes are odd.
fn is_right_child(node: u32, word: u32) -> bool {
    return (word & 1u) != (node & 1u);
}
