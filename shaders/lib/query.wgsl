// What the batch queries share in addition to the traversal: rays, options, and which ray is whose.

// A batch: how many rays, and the options.
struct Batch {
    count: u32,
    culling: u32,
    ignore: u32,
    // Words of a ray's list, where triangles are listed or counted.
    room: u32,
}

// 32 bytes a ray: origin and t_min, direction and t_max. As bits, since limits may be infinite.
@group(0) @binding(4) var<storage, read> rays: array<vec4<u32>>;
@group(0) @binding(6) var<uniform> batch: Batch;

// The ray of an invocation: workgroups of 64 in rows, since one dimension is not long enough.
fn ray_index(workgroup: vec3<u32>, workgroups: vec3<u32>, local: u32) -> u32 {
    return (workgroup.y * workgroups.x + workgroup.x) * 64u + local;
}

fn batch_ray(index: u32) -> Ray {
    return ray_of_words(rays[2u * index], rays[2u * index + 1u]);
}

// The answer to an any-hit query: 1 for a hit, 0 for none, 2 for a ray that was not followed to its end (yet), 3 for one that
// is undecided.
fn occluded_word(hit: Hit) -> u32 {
    let marked = select(select(0u, 2u, is_unfinished(hit)), 3u, hit.triangle == UNDECIDED_HIT);
    return select(marked, 1u, is_hit(hit));
}
