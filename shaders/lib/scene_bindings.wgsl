// What a traversal of an instance reads, in place of bindings.wgsl: the trees of all geometries of a scene of many objects, the instances, and
// what each ray has entered. See core/src/backend/scene/packed.

// Two words a node, as in core/src/tree/node.rs; children by their places among all nodes.
@group(0) @binding(0) var<storage, read> nodes: array<vec2<u32>>;
// Triangle indices among all triangles, named by leaves; and opacity masks.
@group(0) @binding(1) var<storage, read> leaf_references: array<u32>;
// Snapped corners, nine numbers a triangle.
@group(0) @binding(2) var<storage, read> triangles: array<f32>;
// Eight times four words an instance.
@group(0) @binding(3) var<storage, read> instances: array<vec4<u32>>;
// 32 bytes a ray: origin and t_min, direction and t_max. As bits, since limits may be infinite.
@group(0) @binding(4) var<storage, read> rays: array<vec4<u32>>;
// Six words a hit: t, u, v, triangle, geometry, instance.
@group(0) @binding(5) var<storage, read_write> scene_hits: array<u32>;
@group(0) @binding(6) var<uniform> scene_batch: SceneBatch;
// The first words are the instances that rays have entered.
@group(0) @binding(8) var<storage, read> ways: array<u32>;

// What queries know of the geometry that the ray is in.
var<private> scene: Scene;
// The instance that it is in.
var<private> entered: u32;
