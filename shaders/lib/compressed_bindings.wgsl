// What a traversal of compressed nodes reads, in place of bindings.wgsl.

// Five vectors a node, as `CompressedNode` in core/src/query/compressed.rs says.
@group(0) @binding(0) var<storage, read> compressed_nodes: array<vec4<u32>>;
// Triangle indices, named by leaves.
@group(0) @binding(1) var<storage, read> compressed_references: array<u32>;
// Snapped corners, nine numbers a triangle.
@group(0) @binding(2) var<storage, read> triangles: array<f32>;
// What queries know of the scene as a whole.
@group(0) @binding(3) var<uniform> scene: Scene;
