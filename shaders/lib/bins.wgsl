// Twin of core/src/build/bins.rs: bins of a node's tight bounds, and what the planes between them cost. The
// best of these planes is in the kernel that finds it. Needs the binding `parameters`.

const MAX_BINS: u32 = 64u;

// The bins of one axis: equal parts of the tight bounds.
struct BinAxis {
    // Quarters of the lower end and of the extent.
    lower: f32,
    quarter: f32,
    // Bins in a quarter of a unit of length.
    scale: f32,
    // False when the bounds are flat on the axis or too small to be divided: then there are no bins.
    divisible: bool,
}

fn bins_between(lo: f32, hi: f32) -> BinAxis {
    let half = half_distance(lo, hi);
    if exponent(half) < LEAST_EXPONENT {
        return BinAxis(0.0, 0.0, 0.0, false);
    }
    let quarter = product(half, 0.5);
    let factor = quotient(f32(parameters.bins), quarter);
    return BinAxis(snapped_product(lo, 0.25), quarter, factor, true);
}

// Where a coordinate lies, in bins from the lower end.
fn place_in_bins(axis: BinAxis, coordinate: f32) -> f32 {
    let distance = snapped_difference(snapped_product(coordinate, 0.25), axis.lower);
    return snapped_product(distance, axis.scale);
}

// The bins in which a reference starts and ends. One that ends exactly at a border ends below it.
fn bin_range(axis: BinAxis, lo: f32, hi: f32) -> vec2<u32> {
    let end = place_in_bins(axis, hi);
    let whole = u32(end);
    let at_border = f32(whole) == end && whole > 0u;
    let last = min(whole - select(0u, 1u, at_border), parameters.bins - 1u);
    return vec2<u32>(min(u32(place_in_bins(axis, lo)), last), last);
}

// The plane below bin `index`, which is not the first.
fn bin_border(axis: BinAxis, index: u32) -> f32 {
    let part = quotient(f32(index), f32(parameters.bins));
    let quarter = snapped_sum(axis.lower, snapped_product(axis.quarter, part));
    return product(quarter, 4.0);
}

// Costs of a split, from the half areas of node, left and right, and of a leaf; times the node's half
// area.
fn wide_split_cost(node_area: u32, areas: vec2<u32>, left: u32, right: u32) -> vec2<u32> {
    return weigh(node_area, areas, parameters.traversal_cost, vec2<u32>(blocks(left), blocks(right)));
}

// The same with children that cost what is expected of them, in quarters: what borders are compared by.
fn expected_split_cost(node_area: u32, areas: vec2<u32>, left: u32, right: u32) -> vec2<u32> {
    let children = vec2<u32>(expected_quarters(blocks(left)), expected_quarters(blocks(right)));
    return weigh(node_area, areas, 4u * parameters.traversal_cost, children);
}

fn weigh(node_area: u32, areas: vec2<u32>, traversal: u32, children: vec2<u32>) -> vec2<u32> {
    let tests = wide_sum(wide_product(children.x, areas.x), wide_product(children.y, areas.y));
    return wide_sum(wide_product(traversal, node_area), wide_multiple(tests, parameters.intersection_cost));
}

// The expected cost of a subtree over this many blocks, in quarters of a block: itself up to four,
// beyond them 4 (b / 4)^(3/4); linear between powers of two.
fn expected_quarters(blocks: u32) -> u32 {
    if blocks <= 4u {
        return 4u * blocks;
    }
    let power = firstLeadingBit(blocks);
    let low = quarters_of_power(power);
    let part = wide_product(quarters_of_power(power + 1u) - low, blocks - (1u << power));
    return low + ((part.y << (32u - power)) | (part.x >> power));
}

fn quarters_of_power(power: u32) -> u32 {
    let eights = (power - 2u) / 4u;
    var base = 128u;
    switch (power - 2u) % 4u {
        case 1u: { base = 215u; }
        case 2u: { base = 362u; }
        case 3u: { base = 609u; }
        default: {}
    }
    if eights == 0u {
        return (base + 4u) >> 3u;
    }
    return base << (3u * (eights - 1u));
}

fn wide_leaf_cost(area: u32, count: u32) -> vec2<u32> {
    return wide_multiple(wide_product(blocks(count), area), parameters.intersection_cost);
}
