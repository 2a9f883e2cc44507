// Inclusive scans over the first 64 lanes of a workgroup, two sums at a time, in six steps.

var<workgroup> scan_steps: array<vec2<u32>, 128>;

// The sum of the lanes up to this one, for the first 64. Every lane must call it.
fn inclusive_scan(lane: u32, value: vec2<u32>) -> vec2<u32> {
    workgroupBarrier();
    if lane < 64u {
        scan_steps[lane] = value;
    }
    workgroupBarrier();
    var sum = value;
    var here = 0u;
    for (var step = 1u; step < 64u; step *= 2u) {
        if lane >= step && lane < 64u {
            sum += scan_steps[here + lane - step];
        }
        here = 64u - here;
        if lane < 64u {
            scan_steps[here + lane] = sum;
        }
        workgroupBarrier();
    }
    return sum;
}

// The sum of all of them in the last scan.
fn scan_sum() -> vec2<u32> {
    return scan_steps[63];
}
