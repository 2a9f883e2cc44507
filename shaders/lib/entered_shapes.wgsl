// A ray in the set of shapes that it has entered: what the kernel trace_shapes does with each ray, as a function. Twin of
// `PackedScene::trace_shapes` in core/src/backend/scene/packed/trace.rs. A test holds the text to the kernel's.

// Traces a ray through an instance of shapes, and keeps what it finds if that comes before the best hit so far: lesser `t`, then the lower
// instance, then the lower shape.
fn trace_shapes(index: u32, instance: u32) {
    let own = instances[8u * instance + 6u].w;
    // Mask, sides, root and the block of the first shape.
    let asked = instances[8u * instance + 3u];
    let culling = (asked.y | scene_batch.culling) & 3u;
    let ignored = select(NO_TRIANGLE, scene_batch.ignored_triangle, instance == scene_batch.ignored_instance);
    let given = batch_ray(index);
    let t_max_bits = bitcast<u32>(given.t_max);
    let before = best_hit(index);
    let limit = select(t_max_bits, limit_after(t_max_bits, before.t), before.instance != NO_INSTANCE);
    let ray = seen_by(instance, given, limit);
    if !can_hit(ray) {
        return;
    }
    let ready = shape_ray(ray);
    var boxes = box_ray(ray, limit);
    way_store(index, 0u, (own << 8u) | 0xffu);
    var top = 1u;
    var hit = no_hit();
    loop {
        let next = next_instance(index, boxes, top);
        if next.instance == NO_INSTANCE || (scene_batch.any != 0u && is_hit(hit)) {
            break;
        }
        top = next.top;
        let at = 16u * asked.w + 2u * next.instance;
        let span = capsule_span(ready, bitcast<vec4<f32>>(shapes[at]), bitcast<vec4<f32>>(shapes[at + 1u]).xyz);
        if !span.some || next.instance == ignored {
            continue;
        }
        // In at the first end, from the front; out at the other.
        for (var k = 0u; k < 2u; k++) {
            let t = select(span.t.x, span.t.y, k == 1u);
            let bits = bitcast<u32>(t);
            let is_culled = culling == select(CULL_FRONT, CULL_BACK, k == 1u);
            let within = limit_key(bitcast<u32>(ray.t_min)) <= limit_key(bits) && limit_key(bits) <= limit_key(limit);
            let first = !is_hit(hit) || t < hit.t || (t == hit.t && next.instance < hit.triangle);
            if is_finite_bits(bits) && within && !is_culled && first {
                hit = Hit(t, next.instance, select(span.u.x, span.u.y, k == 1u), 0.0);
                boxes = box_ray(ray, bits);
            }
        }
    }
    let at = 6u * index;
    let lower = instance < before.instance || (instance == before.instance && hit.triangle < before.triangle);
    if !loops_run() {
        scene_hits[at + 3u] = UNFINISHED;
    } else if is_hit(hit) && (before.instance == NO_INSTANCE || hit.t < before.t || (hit.t == before.t && lower)) {
        scene_hits[at] = bitcast<u32>(hit.t);
        scene_hits[at + 1u] = bitcast<u32>(hit.u);
        scene_hits[at + 2u] = 0u;
        scene_hits[at + 3u] = hit.triangle;
        scene_hits[at + 4u] = asked.y >> 3u;
        scene_hits[at + 5u] = instance;
    }
}
