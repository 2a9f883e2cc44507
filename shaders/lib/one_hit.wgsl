// A traversal ends with the hit that it finds. In place of through_glass.wgsl.

fn passes(search: Search) -> bool {
    return false;
}

fn passed(ray: PreparedRay, search: Search) -> PreparedRay {
    return ray;
}
