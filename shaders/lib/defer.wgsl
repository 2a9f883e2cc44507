// The list of the rays that a lean query leaves to another kernel.

// Their number, then four words each: the index in the batch, and what is left of the walk.
@group(0) @binding(7) var<storage, read_write> deferred_rays: array<atomic<u32>>;

fn defer_ray(index: u32, left: vec3<u32>) {
    let at = 1u + 4u * atomicAdd(&deferred_rays[0], 1u);
    atomicStore(&deferred_rays[at], index);
    atomicStore(&deferred_rays[at + 1u], left.x);
    atomicStore(&deferred_rays[at + 2u], left.y);
    atomicStore(&deferred_rays[at + 3u], left.z);
}
