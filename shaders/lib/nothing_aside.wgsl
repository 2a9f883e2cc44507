// No triangle is set aside: a ray that meets one which takes a closer look is deferred, or the walk waits for the closer look. In place of
// set_aside.wgsl and taken_up.wgsl.

fn set_aside(triangle: u32) -> bool {
    return false;
}

fn leaves_aside(best: u32) -> bool {
    return false;
}

fn left_aside(hit: Hit) -> vec3<u32> {
    return vec3<u32>();
}

fn taken_up() -> u32 {
    return NO_TRIANGLE;
}

fn first_node(root: u32) -> u32 {
    return root;
}

fn skips_best() -> bool {
    return false;
}
