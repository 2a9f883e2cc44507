// Twin of render/src/fresnel.rs: what a clear surface reflects and where it refracts to.

// How light is parted at the boundary of two clear bodies.
struct Parting {
    // Part that is reflected, 1 for total internal reflection.
    reflectance: f32,
    // Cosine of the refracted ray to the normal; 0 when there is none.
    cosine: f32,
}

// Fresnel's equations for unpolarised light. `cosine` is that of the incoming ray to the normal, 0 to
// 1; `ratio` is the refractive index on its side over the one behind.
fn part(cosine: f32, ratio: f32) -> Parting {
    let sine_squared =
        product(product(ratio, ratio), difference(1.0, product(cosine, cosine)));
    if sine_squared >= 1.0 {
        return Parting(1.0, 0.0);
    }
    let refracted_cosine = square_root(difference(1.0, sine_squared));
    let across = product(ratio, cosine);
    let along = product(ratio, refracted_cosine);
    // Perpendicular to the plane of incidence, and in it.
    let perpendicular =
        quotient_or_one(difference(across, refracted_cosine), sum(across, refracted_cosine));
    let parallel = quotient_or_one(difference(cosine, along), sum(cosine, along));
    let squares = sum(product(perpendicular, perpendicular), product(parallel, parallel));
    return Parting(product(squares, 0.5), refracted_cosine);
}

// Both parts are 0 for a ray along the surface, which is reflected whole.
fn quotient_or_one(a: f32, b: f32) -> f32 {
    if b > 0.0 {
        return quotient(a, b);
    }
    return 1.0;
}

// The refracted direction.
fn refracted(
    direction: vec3<f32>,
    normal: vec3<f32>,
    cosine: f32,
    ratio: f32,
    refracted_cosine: f32,
) -> vec3<f32> {
    let along_normal = difference(product(ratio, cosine), refracted_cosine);
    return sum3(scaled3(direction, ratio), scaled3(normal, along_normal));
}
