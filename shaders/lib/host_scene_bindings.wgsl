// What a host's own shader reads of a scene of many objects, in place of scene_bindings.wgsl: the buffers of
// core/src/backend/scene/packed. The group and the numbers of the bindings are replaced where a host has them elsewhere. A ray and what is
// found are in the memory of the invocation, where the kernels of a batch have buffers.

struct SceneFacts {
    // Nodes of the tree over instances.
    top_nodes: u32,
    // Always 0: what `opaque_zero` is set to.
    zero: u32,
    unused: vec2<u32>,
}

// Sixteen times four words a node.
@group(0) @binding(0) var<storage, read> box_nodes: array<vec4<u32>>;
// Eight times four words an instance.
@group(0) @binding(1) var<storage, read> instances: array<vec4<u32>>;
// Two words a node; children by their places among all nodes.
@group(0) @binding(2) var<storage, read> nodes: array<vec2<u32>>;
// Triangle indices among all triangles, named by leaves; and opacity masks.
@group(0) @binding(3) var<storage, read> leaf_references: array<u32>;
// Snapped corners, nine numbers a triangle.
@group(0) @binding(4) var<storage, read> triangles: array<f32>;
// Sets of spheres and capsules: sixteen times four words a block.
@group(0) @binding(5) var<storage, read> shapes: array<vec4<u32>>;
@group(0) @binding(6) var<uniform> scene_facts: SceneFacts;

// What queries know of the geometry that the ray is in.
var<private> scene: Scene;
// The instance that it is in.
var<private> entered: u32;
// The ray, as a batch of one.
var<private> rays: array<vec4<u32>, 2>;
// Its best hit so far: t, u, v, triangle, geometry, instance.
var<private> scene_hits: array<u32, 6>;
// Its options.
var<private> scene_batch: SceneBatch;
