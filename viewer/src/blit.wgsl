// Shows a buffer of pixels in a part of the window.

struct Picture {
    // Where it is in the window, in pixels: left, top, width, height.
    place: vec4<f32>,
    // Width and height of the picture in its own pixels.
    size: vec2<u32>,
    // 1 when the window encodes what is written to it, 0 when it takes it as it is.
    encodes: u32,
    unused: u32,
}

@group(0) @binding(0) var<storage, read> pixels: array<u32>;
@group(0) @binding(1) var<uniform> picture: Picture;

@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    // One triangle that covers the whole viewport.
    let x = f32(i32(index & 1u) * 4 - 1);
    let y = f32(i32(index >> 1u) * 4 - 1);
    return vec4<f32>(x, y, 0.0, 1.0);
}

fn pixel(x: u32, y: u32) -> vec3<f32> {
    let column = min(x, picture.size.x - 1u);
    let row = min(y, picture.size.y - 1u);
    return unpack4x8unorm(pixels[row * picture.size.x + column]).rgb;
}

// From what displays take to what the window encodes again.
fn decoded(colour: vec3<f32>) -> vec3<f32> {
    let low = colour / 12.92;
    let high = pow((colour + vec3<f32>(0.055)) / 1.055, vec3<f32>(2.4));
    return select(high, low, colour <= vec3<f32>(0.04045));
}

@fragment
fn colour(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    // Between pixel centres, blended; at a pixel's centre, that pixel. A picture as large as its
    // place is shown as it is.
    let part = (position.xy - picture.place.xy) / picture.place.zw;
    let at = max(part * vec2<f32>(picture.size) - vec2<f32>(0.5), vec2<f32>(0.0));
    let first = vec2<u32>(at);
    let weight = at - vec2<f32>(first);
    let upper = mix(pixel(first.x, first.y), pixel(first.x + 1u, first.y), weight.x);
    let lower = mix(pixel(first.x, first.y + 1u), pixel(first.x + 1u, first.y + 1u), weight.x);
    let shown = mix(upper, lower, weight.y);
    return vec4<f32>(select(shown, decoded(shown), picture.encodes == 1u), 1.0);
}
