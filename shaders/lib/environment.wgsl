// Twin of render/src/environment.rs: light from everywhere. Needs the binding `frame`.

// Radiance from a direction of length 1.
fn environment_radiance(direction: vec3<f32>) -> vec3<f32> {
    let height = direction.y;
    if height >= 0.0 {
        return mix3(frame.horizon, frame.zenith, height);
    }
    return mix3(frame.horizon, frame.nadir, -height);
}

// Irradiance of a surface with this normal that nothing occludes, over pi.
fn environment_irradiance(normal: vec3<f32>) -> vec3<f32> {
    let above = scaled3(difference3(frame.zenith, frame.horizon), hemisphere(normal.y));
    let below = scaled3(difference3(frame.nadir, frame.horizon), hemisphere(-normal.y));
    return sum3(sum3(frame.horizon, above), below);
}

// The mean over a cosine-weighted hemisphere of the height of directions above the horizon, by the
// cosine of the hemisphere's axis to the zenith.
fn hemisphere(cosine: f32) -> f32 {
    let quadratic = product(product(cosine, cosine), 0.1171875);
    return sum(sum(0.2109375, product(cosine, 0.33333334)), quadratic);
}
