// The list of the rays that a lean query left to this kernel.

// Their number, then their indices in the batch.
@group(0) @binding(7) var<storage, read> deferred_rays: array<u32>;

fn deferred_count() -> u32 {
    return deferred_rays[0];
}
