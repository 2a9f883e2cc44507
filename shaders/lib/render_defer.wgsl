// The list of the rays that a lean kernel of the ray tracer leaves to another. Needs the binding `deferred_rays`, atomic.

// `count` is the word where their number is.
fn defer_ray(count: u32, index: u32) {
    let place = atomicAdd(&deferred_rays[count], 1u);
    atomicStore(&deferred_rays[DEFERRED_HEAD + place], index);
}
