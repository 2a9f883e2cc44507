// Inclusive scans over the first lanes of a workgroup, eight sums at a time, in as many steps as there are doublings. The
// kernel says how many lanes there are: LANES.

struct Sums {
    a: vec4<u32>,
    b: vec4<u32>,
}

var<workgroup> scan_steps: array<Sums, LANES>;

// What stands before this lane among the first `count`, and the sum of these. Every lane must call it, and all with the same
// `count`, which is not 0.
fn exclusive_scan(lane: u32, count: u32, value: Sums) -> Sums {
    workgroupBarrier();
    scan_steps[lane] = value;
    workgroupBarrier();
    var sum = value;
    for (var step = 1u; step < count; step *= 2u) {
        var other = Sums(vec4<u32>(0u), vec4<u32>(0u));
        if lane >= step {
            other = scan_steps[lane - step];
        }
        workgroupBarrier();
        sum = Sums(sum.a + other.a, sum.b + other.b);
        scan_steps[lane] = sum;
        workgroupBarrier();
    }
    return Sums(sum.a - value.a, sum.b - value.b);
}

// The sums of all of the first `count` lanes in the last scan.
fn scan_totals(count: u32) -> Sums {
    return scan_steps[count - 1u];
}
