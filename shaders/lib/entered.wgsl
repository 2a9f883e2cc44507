// A ray in the instance that it has entered: twin of `PackedScene::trace_in` in core/src/backend/scene/packed/trace.rs.

// What queries know of an instance's geometry.
fn scene_of(instance: u32) -> Scene {
    let lo = instances[8u * instance + 4u];
    let hi = instances[8u * instance + 5u];
    let near_lo = instances[8u * instance + 6u];
    let near_hi = instances[8u * instance + 7u];
    return Scene(
        bitcast<vec3<f32>>(lo.xyz),
        bitcast<f32>(lo.w),
        bitcast<vec3<f32>>(hi.xyz),
        hi.w,
        bitcast<vec3<f32>>(near_lo.xyz),
        0u,
        bitcast<vec3<f32>>(near_hi.xyz),
        bitcast<f32>(near_hi.w),
    );
}

// Traces a ray through an instance, and keeps what it finds if that comes before the best hit so far: lesser `t`, then the lower
// instance, then the lower triangle. False where the ray is deferred.
fn trace_entered(index: u32, instance: u32) -> bool {
    opaque_zero = scene_batch.zero;
    scene = scene_of(instance);
    entered = instance;
    // Mask, sides, root and first triangle.
    let asked = instances[8u * instance + 3u];
    let sides = (asked.y | scene_batch.culling) & 3u;
    let mirrored = (asked.y & MIRRORED) != 0u && sides != CULL_NONE;
    let culling = select(sides, 3u - sides, mirrored);
    let own = instance == scene_batch.ignored_instance;
    let ignore = select(NO_TRIANGLE, asked.w + scene_batch.ignored_triangle, own);
    let ray = batch_ray(index);
    let t_max_bits = bitcast<u32>(ray.t_max);
    let before = best_hit(index);
    let limit = select(t_max_bits, limit_after(t_max_bits, before.t), before.instance != NO_INSTANCE);
    let any = scene_batch.any != 0u;
    let hit = walk_ray(seen_by(instance, ray, limit), QueryOptions(culling, ignore), any, asked.z);
    if hit.triangle == DEFERRED {
        return false;
    }
    // Read again, since registers are dear in a traversal: no compiler can tell that it is the same.
    let again = instances[8u * (instance ^ opaque_zero) + 3u];
    let best = best_hit(index);
    let triangle = hit.triangle - again.w;
    let lower = instance < best.instance || (instance == best.instance && triangle < best.triangle);
    let at = 6u * index;
    if hit.triangle == UNFINISHED {
        scene_hits[at + 3u] = UNFINISHED;
    } else if is_hit(hit) && (best.instance == NO_INSTANCE || hit.t < best.t || (hit.t == best.t && lower)) {
        scene_hits[at] = bitcast<u32>(hit.t);
        scene_hits[at + 1u] = bitcast<u32>(hit.u);
        scene_hits[at + 2u] = bitcast<u32>(hit.v);
        scene_hits[at + 3u] = triangle;
        scene_hits[at + 4u] = again.y >> 3u;
        scene_hits[at + 5u] = instance;
    }
    return true;
}
