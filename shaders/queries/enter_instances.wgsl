// The next instance that every ray of a batch enters, nearest boxes first, as long as it can hold a hit that comes before the ray's
// best.
// One invocation a ray; those that are done do nothing.
// Reads: the tree over instances, masks and sides of the instances; the rays of the batch, their best hits, their ways.
// Writes: the instance entered, and how the way goes on. For a ray that begins, the record of a miss: (infinity, 0, 0, NO_TRIANGLE,
// no geometry, no instance). UNFINISHED as the triangle of one that the driver did not let finish. That no ray is deferred.
// Ties: the order of instances does not matter to hits.

// Sixteen times four words a node.
@group(0) @binding(0) var<storage, read> box_nodes: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read> instances: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> scene_hits: array<u32>;
@group(0) @binding(4) var<uniform> scene_batch: SceneBatch;
@group(0) @binding(5) var<storage, read_write> deferred_rays: array<u32>;
@group(0) @binding(6) var<storage, read_write> ways: array<u32>;
// Instances entered since the host set this to zero, and rays that are done.
@group(0) @binding(7) var<storage, read_write> wave_counts: array<atomic<u32>>;

// What intersect.wgsl declares, and nothing here reads.
var<private> scene: Scene;

// The number of a stack's entries of a ray that is done.
const DONE: u32 = 0xffffffffu;

// Four words of the tree.
fn box_words(at: u32) -> vec4<u32> {
    return box_nodes[at];
}

// The stack of a ray: nodes times 256, and a bit for each child that is yet to be visited. There is room for every tree.
fn way_store(index: u32, place: u32, entry: u32) {
    ways[(2u + place) * scene_batch.count + index] = entry;
}

fn way_entry(index: u32, place: u32) -> u32 {
    return ways[(2u + place) * scene_batch.count + index];
}

// Whether an instance answers rays of the batch.
fn is_asked(instance: u32) -> bool {
    let asked = instances[8u * instance + 3u];
    return (asked.x & scene_batch.mask) != 0u && ((asked.y | scene_batch.culling) & 3u) != 3u;
}

// The ray will enter nothing more.
fn end_way(index: u32) {
    ways[index] = NO_INSTANCE;
    ways[scene_batch.count + index] = DONE;
    atomicAdd(&wave_counts[1], 1u);
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    opaque_zero = scene_batch.zero;
    let index = ray_index(workgroup, workgroups, local);
    if index >= scene_batch.count {
        return;
    }
    if index == 0u {
        deferred_rays[0] = 0u;
    }
    let state = ways[scene_batch.count + index];
    if state == DONE {
        return;
    }
    let ray = batch_ray(index);
    var top = state - 1u;
    if state == 0u {
        scene_hits[6u * index] = INFINITY_BITS;
        scene_hits[6u * index + 1u] = 0u;
        scene_hits[6u * index + 2u] = 0u;
        scene_hits[6u * index + 3u] = NO_TRIANGLE;
        scene_hits[6u * index + 4u] = NO_INSTANCE;
        scene_hits[6u * index + 5u] = NO_INSTANCE;
        if scene_batch.way == 0u || !can_hit(ray) {
            end_way(index);
            return;
        }
        // The root, with all of its children.
        way_store(index, 0u, 0xffu);
        top = 1u;
    }
    let best = best_hit(index);
    let found = best.instance != NO_INSTANCE;
    if best.triangle == UNFINISHED || (found && scene_batch.any != 0u) {
        end_way(index);
        return;
    }
    let t_max_bits = bitcast<u32>(ray.t_max);
    let best_bits = bitcast<u32>(best.t);
    let nearer = found && limit_key(best_bits) < limit_key(t_max_bits);
    let next = next_instance(index, box_ray(ray, select(t_max_bits, best_bits, nearer)), top);
    if !loops_run() {
        scene_hits[6u * index + 3u] = UNFINISHED;
        end_way(index);
        return;
    }
    if next.instance == NO_INSTANCE {
        end_way(index);
        return;
    }
    ways[index] = next.instance;
    ways[scene_batch.count + index] = next.top + 1u;
    atomicAdd(&wave_counts[0], 1u);
}
