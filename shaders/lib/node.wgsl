// Twin of core/src/node.rs: the two words of a node.

// A leaf of `count` references from `first` on.
fn leaf(first: u32, count: u32) -> vec2<u32> {
    return vec2<u32>(first, (count << 2u) | 3u);
}
