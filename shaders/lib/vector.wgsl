// Twin of render/src/vector.rs: vectors of three floats, in guarded operations.

fn sum3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(sum(a.x, b.x), sum(a.y, b.y), sum(a.z, b.z));
}

fn difference3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(difference(a.x, b.x), difference(a.y, b.y), difference(a.z, b.z));
}

// Component by component.
fn product3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(product(a.x, b.x), product(a.y, b.y), product(a.z, b.z));
}

fn scaled3(a: vec3<f32>, factor: f32) -> vec3<f32> {
    return vec3<f32>(product(a.x, factor), product(a.y, factor), product(a.z, factor));
}

fn dot3(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return sum(sum(product(a.x, b.x), product(a.y, b.y)), product(a.z, b.z));
}

fn cross3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        difference(product(a.y, b.z), product(a.z, b.y)),
        difference(product(a.z, b.x), product(a.x, b.z)),
        difference(product(a.x, b.y), product(a.y, b.x)),
    );
}

// a + (b - a) * part.
fn mix3(a: vec3<f32>, b: vec3<f32>, part: f32) -> vec3<f32> {
    return sum3(a, scaled3(difference3(b, a), part));
}

// a * w.x + b * w.y + c * w.z.
fn weighted3(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, w: vec3<f32>) -> vec3<f32> {
    return sum3(sum3(scaled3(a, w.x), scaled3(b, w.y)), scaled3(c, w.z));
}

// The greatest component.
fn greatest(a: vec3<f32>) -> f32 {
    return most(most(a.x, a.y), a.z);
}

// The greatest magnitude of a component.
fn reach(a: vec3<f32>) -> f32 {
    return greatest(abs(a));
}

// The vector of length 1 in its direction; zero for zero. Squares neither overflow nor vanish: the
// components are first brought near 1 by a power of two, which is exact.
fn normalized(a: vec3<f32>) -> vec3<f32> {
    let near_one = scaled3(a, power_of_two(-exponent(reach(a))));
    let squared = dot3(near_one, near_one);
    if squared > 0.0 {
        return scaled3(near_one, quotient(1.0, square_root(squared)));
    }
    return vec3<f32>(0.0);
}

// The length, with the same care.
fn length3(a: vec3<f32>) -> f32 {
    let power = exponent(reach(a));
    let near_one = scaled3(a, power_of_two(-power));
    return product(square_root(dot3(near_one, near_one)), power_of_two(power));
}
