// The list of the rays that a lean query leaves to another kernel.

// Their number, then their indices in the batch.
@group(0) @binding(7) var<storage, read_write> deferred_rays: array<atomic<u32>>;

fn defer_ray(index: u32) {
    let place = atomicAdd(&deferred_rays[0], 1u);
    atomicStore(&deferred_rays[1u + place], index);
}
