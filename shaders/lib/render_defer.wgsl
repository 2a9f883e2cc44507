// The list of the rays that a lean kernel of the ray tracer leaves to another. Needs the binding `deferred_rays`, atomic.

// `count` is the word where their number is. Four words each: the index, and what is left of the walk.
fn defer_ray(count: u32, index: u32, left: vec3<u32>) {
    let at = DEFERRED_HEAD + 4u * atomicAdd(&deferred_rays[count], 1u);
    atomicStore(&deferred_rays[at], index);
    atomicStore(&deferred_rays[at + 1u], left.x);
    atomicStore(&deferred_rays[at + 2u], left.y);
    atomicStore(&deferred_rays[at + 3u], left.z);
}
