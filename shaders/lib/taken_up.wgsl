// Takes up what a shader with set_aside.wgsl has left of a walk: up to three triangles, each for a closer look. Where it has left nothing, the
// walk begins at the root, and no triangle is set aside.

// Names of triangles: 0 for none, else one more than the index. An entry point sets them.
var<private> to_take_up: vec3<u32>;

// The next triangle, or NO_TRIANGLE.
fn taken_up() -> u32 {
    let name = to_take_up.x;
    to_take_up = vec3<u32>(to_take_up.yz, 0u);
    // One less than none is NO_TRIANGLE.
    return name - 1u;
}

// Where the walk begins: nowhere if all of it that is left is to be taken up.
fn first_node(root: u32) -> u32 {
    return select(NO_NODE, root, all(to_take_up == vec3<u32>()));
}

fn set_aside(triangle: u32) -> bool {
    return false;
}

fn leaves_aside(best: u32) -> bool {
    return false;
}

fn skips_best() -> bool {
    return false;
}
