// The tree, as kernels of the ray tracer bind it that trace rays.

// Two words a node, as in core/src/tree/node.rs.
@group(0) @binding(4) var<storage, read> nodes: array<vec2<u32>>;
// Triangle indices, named by leaves.
@group(0) @binding(5) var<storage, read> leaf_references: array<u32>;
