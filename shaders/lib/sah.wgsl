// Twin of core/src/sah.rs: the integer surface area heuristic (Zhou et al. 2008, Equation 6).

// A cell whose longest half extent has a smaller exponent becomes a leaf.
const LEAST_EXPONENT: i32 = -117;

// A cell's extents as integers: the longest in 512..=1023.
struct Extents {
    cells: vec3<u32>,
    scale: f32,
    // False for a cell too small to be split.
    large_enough: bool,
}

fn quantise(half: f32, factor: f32) -> u32 {
    return u32(product(half, factor));
}

fn extents_of(cell: Aabb) -> Extents {
    let half = half_extents(cell);
    let longest = most(most(half.x, half.y), half.z);
    if exponent(longest) < LEAST_EXPONENT {
        return Extents(vec3<u32>(0u), 1.0, false);
    }
    let factor = power_of_two(9 - exponent(longest));
    let cells =
        vec3<u32>(quantise(half.x, factor), quantise(half.y, factor), quantise(half.z, factor));
    return Extents(cells, factor, true);
}

// The quantised distance from a cell's lower side to a plane inside it.
fn quantised_offset(extents: Extents, lower: f32, plane: f32) -> u32 {
    return quantise(half_distance(lower, plane), extents.scale);
}

// Half area of a box with these extents; an extent of zero counts as one.
fn half_area(cells: vec3<u32>) -> u32 {
    let c = max(cells, vec3<u32>(1u));
    return c.x * (c.y + c.z) + c.y * c.z;
}

// Half areas of the parts left and right of a plane at this offset on `axis`.
fn split_areas(extents: Extents, axis: u32, offset: u32) -> vec2<u32> {
    let on = vec3<bool>(axis == 0u, axis == 1u, axis == 2u);
    let rest = max(extents.cells, vec3<u32>(offset)) - vec3<u32>(offset);
    let left = half_area(select(extents.cells, vec3<u32>(offset), on));
    let right = half_area(select(extents.cells, rest, on));
    return vec2<u32>(left, right);
}

// ceil(count / W).
fn blocks(count: u32) -> u32 {
    return (count + parameters.block_width - 1u) / parameters.block_width;
}
