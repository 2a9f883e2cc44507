// Inclusive scans over the 256 lanes of a workgroup, two sums at a time, in eight steps.

var<workgroup> scan_steps: array<vec2<u32>, 512>;

// The sum of all lanes up to this one. Every lane must call it.
fn inclusive_scan(lane: u32, value: vec2<u32>) -> vec2<u32> {
    workgroupBarrier();
    scan_steps[lane] = value;
    workgroupBarrier();
    var sum = value;
    var here = 0u;
    for (var step = 1u; step < 256u; step *= 2u) {
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
    return scan_steps[255];
}
