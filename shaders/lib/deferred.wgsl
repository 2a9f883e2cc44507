// The list of the rays that a lean query left to this kernel.

// Their number, then four words each: the index in the batch, and what is left of the walk.
@group(0) @binding(7) var<storage, read> deferred_rays: array<u32>;

fn deferred_count() -> u32 {
    return deferred_rays[0];
}

fn deferred_ray(place: u32) -> u32 {
    return deferred_rays[1u + 4u * place];
}

// What is left of its walk: see taken_up.wgsl.
fn left_of_walk(place: u32) -> vec3<u32> {
    let at = 1u + 4u * place;
    return vec3<u32>(deferred_rays[at + 1u], deferred_rays[at + 2u], deferred_rays[at + 3u]);
}
