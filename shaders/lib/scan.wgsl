// Exclusive scans over the lanes of a workgroup, four sums at a time. The kernel says how many lanes
// there are: LANES, a multiple of 16.

var<workgroup> scan_lanes: array<vec4<u32>, LANES>;
var<workgroup> scan_parts: array<vec4<u32>, 17>;

// What stands before this lane. Every lane must call it; `scan_total` is the sum of all.
fn exclusive_scan(lane: u32, value: vec4<u32>) -> vec4<u32> {
    const SHARE: u32 = LANES / 16u;
    workgroupBarrier();
    scan_lanes[lane] = value;
    workgroupBarrier();
    if lane < 16u {
        var before = vec4<u32>(0u);
        for (var i = 0u; i < SHARE; i++) {
            let here = scan_lanes[lane * SHARE + i];
            scan_lanes[lane * SHARE + i] = before;
            before += here;
        }
        scan_parts[lane] = before;
    }
    workgroupBarrier();
    if lane == 0u {
        var before = vec4<u32>(0u);
        for (var i = 0u; i < 16u; i++) {
            let here = scan_parts[i];
            scan_parts[i] = before;
            before += here;
        }
        scan_parts[16] = before;
    }
    workgroupBarrier();
    return scanned(lane);
}

// What stood before any lane in the last scan.
fn scanned(lane: u32) -> vec4<u32> {
    return scan_lanes[lane] + scan_parts[lane / (LANES / 16u)];
}

// The sum of what all lanes gave to the last scan.
fn scan_total() -> vec4<u32> {
    return scan_parts[16];
}
