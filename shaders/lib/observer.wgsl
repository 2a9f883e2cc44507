// Observes nothing of a traversal: twin of the observer `()` in core/src/query/traverse.rs.

fn observe_node() {}

fn observe_triangle() {}
