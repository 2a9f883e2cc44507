// Twin of core/src/aabb.rs.

struct Aabb {
    lo: vec3<f32>,
    hi: vec3<f32>,
}

// The box that holds nothing.
fn empty_aabb() -> Aabb {
    return Aabb(vec3<f32>(GREATEST), vec3<f32>(-GREATEST));
}

fn is_empty(bounds: Aabb) -> bool {
    return any(bounds.lo > bounds.hi);
}

// The vector with one coordinate replaced.
fn with_axis(v: vec3<f32>, axis: u32, value: f32) -> vec3<f32> {
    return vec3<f32>(
        select(v.x, value, axis == 0u),
        select(v.y, value, axis == 1u),
        select(v.z, value, axis == 2u),
    );
}

// Component by component: the lesser; the first on equality.
fn least3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return select(a, b, b < a);
}

// Component by component: the greater; the first on equality.
fn most3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return select(a, b, b > a);
}

// Half the distance from `lo` to `hi`, snapped at each step.
fn half_distance(lo: f32, hi: f32) -> f32 {
    return snapped_difference(snapped_product(hi, 0.5), snapped_product(lo, 0.5));
}

// Half the extents of a box.
fn half_extents(bounds: Aabb) -> vec3<f32> {
    return vec3<f32>(
        half_distance(bounds.lo.x, bounds.hi.x),
        half_distance(bounds.lo.y, bounds.hi.y),
        half_distance(bounds.lo.z, bounds.hi.z),
    );
}

// Half of each coordinate, snapped: differences of these are `half_distance`.
fn halves(v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(snapped_product(v.x, 0.5), snapped_product(v.y, 0.5), snapped_product(v.z, 0.5));
}

fn snapped_differences(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(snapped_difference(a.x, b.x), snapped_difference(a.y, b.y), snapped_difference(a.z, b.z));
}
