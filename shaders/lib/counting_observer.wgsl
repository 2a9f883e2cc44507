// Counts what a traversal does: twin of `Cost` in core/src/query/traverse.rs. In place of observer.wgsl.

// Nodes visited and triangles tested since it was last zero.
var<private> counted: vec2<u32>;

fn observe_node() {
    counted.x += 1u;
}

fn observe_triangle() {
    counted.y += 1u;
}
