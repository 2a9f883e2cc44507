// What a traversal reads: tree, triangles and scene. The group and the numbers of the bindings are
// replaced where a host has them elsewhere.

// Two words a node, as in core/src/tree/node.rs.
@group(0) @binding(0) var<storage, read> nodes: array<vec2<u32>>;
// Triangle indices, named by leaves.
@group(0) @binding(1) var<storage, read> leaf_references: array<u32>;
// Snapped corners, nine numbers a triangle.
@group(0) @binding(2) var<storage, read> triangles: array<f32>;
// What queries know of the scene as a whole.
@group(0) @binding(3) var<uniform> scene: Scene;
