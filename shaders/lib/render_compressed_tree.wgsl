// Compressed nodes, which kernels of the ray tracer bind in place of render_tree.wgsl.

// Five vectors a node, as `CompressedNode` in core/src/query/compressed.rs says.
@group(0) @binding(4) var<storage, read> compressed_nodes: array<vec4<u32>>;
// Triangle indices, named by leaves.
@group(0) @binding(5) var<storage, read> compressed_references: array<u32>;
