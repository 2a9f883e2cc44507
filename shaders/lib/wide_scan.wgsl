// Inclusive scans over the 256 lanes of a workgroup, two sums at a time, in eight steps; or over the first of them, in as many steps as
// there are doublings.

var<workgroup> scan_steps: array<vec2<u32>, 512>;

// The sum of all lanes up to this one. Every lane must call it.
fn inclusive_scan(lane: u32, value: vec2<u32>) -> vec2<u32> {
    return inclusive_scan_of(256u, lane, value);
}

// The sum of the first `count` lanes up to this one, for each of them. Every lane must call it, and all with the same `count`, which is
// not 0.
fn inclusive_scan_of(count: u32, lane: u32, value: vec2<u32>) -> vec2<u32> {
    workgroupBarrier();
    scan_steps[lane] = value;
    workgroupBarrier();
    var sum = value;
    var here = 0u;
    for (var step = 1u; step < count; step *= 2u) {
        if lane >= step {
            sum += scan_steps[here + lane - step];
        }
        here = 256u - here;
        scan_steps[here + lane] = sum;
        workgroupBarrier();
    }
    return sum;
}

// The sum of all lanes in the last scan.
fn scan_sum() -> vec2<u32> {
    return scan_sum_of(256u);
}

// The sum of the first `count` lanes in the last scan, which was over these: an odd number of steps ends in the second half.
fn scan_sum_of(count: u32) -> vec2<u32> {
    let steps = firstLeadingBit(count - 1u) + 1u;
    return scan_steps[256u * (steps % 2u) + count - 1u];
}
