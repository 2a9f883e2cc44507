// Rays through one tree, whose root is its first node: the walk stands in walk.wgsl.

// As `walk_ray`, for a kernel that has done nothing before.
fn trace_ray(ray: Ray, options: QueryOptions, any: bool) -> Hit {
    opaque_zero = scene.zero;
    return walk_ray(ray, options, any, 0u);
}

// The hit of least (t, triangle); where hits are to be certain, of least exact t, or `UNDECIDED_HIT`.
fn closest_hit(ray: Ray, options: QueryOptions) -> Hit {
    return trace_ray(ray, options, false);
}

// Whether the ray hits anything. False for a ray that is undecided or unfinished.
fn any_hit(ray: Ray, options: QueryOptions) -> bool {
    return is_hit(trace_ray(ray, options, true));
}
