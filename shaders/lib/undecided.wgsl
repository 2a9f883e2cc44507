// The records of rays that the CPU has to trace again. Needs the binding `deferred_rays`, atomic: the records lie behind the
// list of deferred rays.

// Words of a record: the index, the triangle or NO_TRIANGLE, eight of the ray, three of the light that it brings.
const UNDECIDED_WORDS: u32 = 13u;

// `count` is the word where their number is. A ray that the device found to meet `triangle` first is undecided only in
// the last bits of where.
fn leave_undecided(
    count: u32,
    index: u32,
    triangle: u32,
    first: vec4<u32>,
    second: vec4<u32>,
    light: vec3<f32>,
) {
    let place = atomicAdd(&deferred_rays[count], 1u);
    let room = max(frame.path_room, frame.shadow_room);
    let at = DEFERRED_HEAD + 4u * room + UNDECIDED_WORDS * place;
    atomicStore(&deferred_rays[at], index);
    atomicStore(&deferred_rays[at + 1u], triangle);
    for (var k = 0u; k < 4u; k++) {
        atomicStore(&deferred_rays[at + 2u + k], first[k]);
        atomicStore(&deferred_rays[at + 6u + k], second[k]);
    }
    for (var k = 0u; k < 3u; k++) {
        atomicStore(&deferred_rays[at + 10u + k], bitcast<u32>(light[k]));
    }
}
