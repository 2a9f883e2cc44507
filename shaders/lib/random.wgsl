// Twin of render/src/random.rs: sequences that look random, whole numbers on the way.

// A hash of three words (Jarzynski and Olano 2020, PCG3D).
fn hash3(words: vec3<u32>) -> vec3<u32> {
    var v = words * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> vec3<u32>(16u);
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

// The upper 24 bits as a number from 0 to 1, 1 excluded. Exact.
fn unit(word: u32) -> f32 {
    return product(f32(word >> 8u), 0x1p-24f);
}

// Where in its pixel a sample lies: the sequence R2 (Roberts 2018), which starts at the centre.
fn sample_offset(sequence: u32) -> vec2<f32> {
    let word = 0x80000000u + vec2<u32>(0xc13fa9a9u, 0x91e10da5u) * sequence;
    return vec2<f32>(unit(word.x), unit(word.y));
}

// Three numbers for a sample of the surfaces that shine: the sequence R3, shifted by a hash of where
// it is used (Cranley and Patterson 1976).
fn light_sample(pixel: u32, wave: u32, seed: u32, index: u32) -> vec3<u32> {
    return hash3(vec3<u32>(pixel, wave, seed)) + vec3<u32>(0xd1b54a32u, 0xabc98388u, 0x8cb92ba7u) * index;
}
