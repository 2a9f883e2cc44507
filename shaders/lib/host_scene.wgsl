// Rays through a scene of many objects, each in one invocation from the first instance to the last: what the kernels of a wave do in turn, for a
// host's own shader. Twin of `PackedScene::trace` in core/src/backend/scene/packed/trace.rs.

// Query settings: twin of `SceneOptions` in core/src/scene/options.rs.
struct SceneOptions {
    // CULL_NONE, CULL_BACK or CULL_FRONT: the side to ignore as seen in the world, besides what instances ignore.
    culling: u32,
    // Instances answer when a bit of theirs is in this mask.
    mask: u32,
    // A triangle, or a shape, to ignore: of this instance, NO_INSTANCE for none.
    ignored_instance: u32,
    ignored_triangle: u32,
}

// Where a ray meets a triangle, a sphere or a capsule of an instance: twin of `SceneHit` in core/src/scene/hit.rs. For a miss `instance` is
// NO_INSTANCE, `triangle` NO_TRIANGLE, `t` GREATEST and the weights 0. `triangle` is UNFINISHED, and the rest as for a miss, when the driver ended
// the way of the ray early.
struct SceneHit {
    t: f32,
    u: f32,
    v: f32,
    triangle: u32,
    geometry: u32,
    instance: u32,
}

// The bit of an instance's mask for a set of shapes.
const SHAPES: u32 = 0x80000000u;
// Trees over boxes have 42 levels at most.
const BOX_ENTRIES: u32 = 48u;

// The way through the tree over instances, and behind it that through a tree over shapes.
var<private> box_stack: array<u32, 96>;
// Whether the ray is in a set of shapes.
var<private> in_shapes: bool;

fn box_words(at: u32) -> vec4<u32> {
    if in_shapes {
        return shapes[at];
    }
    return box_nodes[at];
}

fn way_store(index: u32, place: u32, entry: u32) {
    box_stack[select(0u, BOX_ENTRIES, in_shapes) + place] = entry;
}

fn way_entry(index: u32, place: u32) -> u32 {
    return box_stack[select(0u, BOX_ENTRIES, in_shapes) + place];
}

// Whether an instance answers the ray, or a shape, which always does.
fn is_asked(instance: u32) -> bool {
    if in_shapes {
        return true;
    }
    let asked = instances[8u * instance + 3u];
    return (asked.x & scene_batch.mask) != 0u && ((asked.y | scene_batch.culling) & 3u) != 3u;
}

// Both sides count, all instances answer, nothing is ignored.
fn default_scene_options() -> SceneOptions {
    return SceneOptions(CULL_NONE, 0xffffffffu, NO_INSTANCE, NO_TRIANGLE);
}

fn is_scene_hit(hit: SceneHit) -> bool {
    return hit.instance != NO_INSTANCE;
}

fn no_scene_hit(triangle: u32) -> SceneHit {
    return SceneHit(GREATEST, 0.0, 0.0, triangle, NO_INSTANCE, NO_INSTANCE);
}

// The 24 bytes of a hit's record.
fn scene_hit_words(hit: SceneHit) -> array<u32, 6> {
    let t = select(INFINITY_BITS, bitcast<u32>(hit.t), is_scene_hit(hit));
    return array<u32, 6>(t, bitcast<u32>(hit.u), bitcast<u32>(hit.v), hit.triangle, hit.geometry, hit.instance);
}

// The hit of least (t, instance, triangle); with `any` whichever is found first. The triangle is UNFINISHED where the driver ended a loop.
fn trace_scene(ray: Ray, options: SceneOptions, any: bool) -> SceneHit {
    opaque_zero = scene_facts.zero;
    scene_batch = SceneBatch(
        1u,
        options.culling,
        options.mask,
        options.ignored_instance,
        options.ignored_triangle,
        select(0u, 1u, any),
        scene_facts.zero,
        0u,
    );
    let t_max_bits = bitcast<u32>(ray.t_max);
    rays[0] = vec4<u32>(bitcast<vec3<u32>>(ray.origin), bitcast<u32>(ray.t_min));
    rays[1] = vec4<u32>(bitcast<vec3<u32>>(ray.direction), t_max_bits);
    scene_hits = array<u32, 6>(bitcast<u32>(GREATEST), 0u, 0u, NO_TRIANGLE, NO_INSTANCE, NO_INSTANCE);
    if scene_facts.top_nodes == 0u || !can_hit(ray) {
        return no_scene_hit(NO_TRIANGLE);
    }
    in_shapes = false;
    var boxes = box_ray(ray, t_max_bits);
    // The root, with all of its children.
    way_store(0u, 0u, 0xffu);
    var top = 1u;
    loop {
        let next = next_instance(0u, boxes, top);
        if next.instance == NO_INSTANCE {
            break;
        }
        top = next.top;
        if (instances[8u * next.instance + 6u].w & SHAPES) != 0u {
            in_shapes = true;
            trace_shapes(0u, next.instance);
            in_shapes = false;
        } else {
            // Every kind of ray and triangle is there, so none is deferred.
            _ = trace_entered(0u, next.instance);
        }
        let best = best_hit(0u);
        let found = best.instance != NO_INSTANCE;
        if best.triangle == UNFINISHED || (found && any) {
            break;
        }
        if found {
            let best_bits = bitcast<u32>(best.t);
            boxes = box_ray(ray, select(t_max_bits, best_bits, limit_key(best_bits) < limit_key(t_max_bits)));
        }
    }
    if !loops_run() || scene_hits[3] == UNFINISHED {
        return no_scene_hit(UNFINISHED);
    }
    return SceneHit(
        bitcast<f32>(scene_hits[0]),
        bitcast<f32>(scene_hits[1]),
        bitcast<f32>(scene_hits[2]),
        scene_hits[3],
        scene_hits[4],
        scene_hits[5],
    );
}

// The hit of least (t, instance, triangle).
fn scene_closest_hit(ray: Ray, options: SceneOptions) -> SceneHit {
    return trace_scene(ray, options, false);
}

// Whether the ray hits anything. False for a ray that is unfinished.
fn scene_any_hit(ray: Ray, options: SceneOptions) -> bool {
    return is_scene_hit(trace_scene(ray, options, true));
}
