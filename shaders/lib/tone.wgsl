// Twin of render/src/tone.rs: radiance to what a screen shows. Needs the bindings `frame` and
// `scene_words`.

// x (1 + x / 4) / (1 + x) (Reinhard et al. 2002, white at 2).
fn tone_curve(x: f32) -> f32 {
    // Beyond white, where the curve would go on to rise, and for what is no number.
    if x < 2.0 {
        return quotient(product(x, sum(1.0, product(x, 0.25))), sum(1.0, x));
    }
    return 1.0;
}

// The byte that shows a linear value: the last whose least value it reaches.
fn shown_byte(value: f32) -> u32 {
    var byte = 0u;
    for (var bit = 128u; bit > 0u; bit >>= 1u) {
        if value >= scene_float(frame.srgb_at + 256u + byte + bit) {
            byte += bit;
        }
    }
    return byte;
}

// What a screen shows of a radiance. The last component counts rays that were not followed to their
// end; where there are any, the result's alpha is 0, else 255.
fn shown(radiance: vec4<f32>) -> u32 {
    let red = shown_byte(tone_curve(product(radiance.x, frame.exposure)));
    let green = shown_byte(tone_curve(product(radiance.y, frame.exposure)));
    let blue = shown_byte(tone_curve(product(radiance.z, frame.exposure)));
    let alpha = select(255u, 0u, radiance.w > 0.0);
    return red | (green << 8u) | (blue << 16u) | (alpha << 24u);
}
