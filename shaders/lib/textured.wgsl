// Twin of `texture_colour` in render/src/scene_words.rs; for scenes without textures there is
// untextured.wgsl. Needs the bindings `frame` and `scene_words`.

const TEXTURE_WORDS: u32 = 4u;

// The two texels on either side of a coordinate, and the part of the second.
struct TexelPair {
    before: u32,
    behind: u32,
    part: f32,
}

// The coordinate repeats after 1.
fn texel_pair(coordinate: f32, size: u32) -> TexelPair {
    // A coordinate that repeats too often to be resolved has no place in the picture.
    var within = 0.0;
    if abs(coordinate) < 4194304.0 {
        within = difference(coordinate, floor(coordinate));
    }
    let place = difference(product(within, f32(size)), 0.5);
    let before = floor(place);
    let index = i32(before);
    let last = i32(size) - 1;
    let left = select(min(index, last), last, index < 0);
    let right = select(left + 1, 0, left == last);
    return TexelPair(u32(left), u32(right), difference(place, before));
}

// The linear colour of a texel.
fn texel(index: u32) -> vec3<f32> {
    let word = scene_words[frame.texels_at + index];
    return vec3<f32>(
        scene_float(frame.srgb_at + (word & 255u)),
        scene_float(frame.srgb_at + ((word >> 8u) & 255u)),
        scene_float(frame.srgb_at + ((word >> 16u) & 255u)),
    );
}

// Two texels of a row, mixed.
fn texel_row(start: u32, across: TexelPair) -> vec3<f32> {
    return mix3(texel(start + across.before), texel(start + across.behind), across.part);
}

// The colour of a texture at a point of a triangle: four texels, weighted by nearness. White for no
// texture.
fn texture_colour(texture: u32, triangle: u32, weights: vec3<f32>) -> vec3<f32> {
    if texture == NONE {
        return vec3<f32>(1.0);
    }
    let corner = frame.texcoords_at + 6u * triangle;
    let s = vec3<f32>(scene_float(corner), scene_float(corner + 2u), scene_float(corner + 4u));
    let t = vec3<f32>(scene_float(corner + 1u), scene_float(corner + 3u), scene_float(corner + 5u));
    let at = frame.textures_at + TEXTURE_WORDS * texture;
    let first = scene_words[at];
    let width = scene_words[at + 1u];
    let height = scene_words[at + 2u];
    // Rows run downwards, and texel centres are at halves.
    let across = texel_pair(dot3(s, weights), width);
    let down = texel_pair(difference(1.0, dot3(t, weights)), height);
    let upper = texel_row(first + down.before * width, across);
    let lower = texel_row(first + down.behind * width, across);
    return mix3(upper, lower, down.part);
}
