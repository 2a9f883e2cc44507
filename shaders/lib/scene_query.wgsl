// What the batch queries of scenes of many objects share in addition to the traversal, in place of query.wgsl.

// A batch: how many rays, and the options.
struct SceneBatch {
    count: u32,
    culling: u32,
    mask: u32,
    ignored_instance: u32,
    ignored_triangle: u32,
    // 1 where any hit will do.
    any: u32,
    // Always 0: what `opaque_zero` is set to.
    zero: u32,
    // Words of a ray's way.
    way: u32,
}

const NO_INSTANCE: u32 = 0xffffffffu;

// The ray of an invocation: workgroups of 64 in rows, since one dimension is not long enough.
fn ray_index(workgroup: vec3<u32>, workgroups: vec3<u32>, local: u32) -> u32 {
    return (workgroup.y * workgroups.x + workgroup.x) * 64u + local;
}

fn batch_ray(index: u32) -> Ray {
    return ray_of_words(rays[2u * index], rays[2u * index + 1u]);
}

// The best hit of a ray so far: `t`, instance and triangle.
struct BestHit {
    t: f32,
    // NO_INSTANCE for none.
    instance: u32,
    triangle: u32,
}

fn best_hit(index: u32) -> BestHit {
    let at = 6u * index;
    return BestHit(bitcast<f32>(scene_hits[at]), scene_hits[at + 5u], scene_hits[at + 3u]);
}
