// Takes no notice of what a traversal does: twin of the observer `()` in core/src/traverse.rs.

fn observe_node() {}

fn observe_triangle() {}
