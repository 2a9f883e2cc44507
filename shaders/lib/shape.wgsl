// Twin of core/src/scene/shape: where a line is in a capsule. A sphere is a capsule whose ends are one point.

// What is not greater than this part of another is nothing beside it.
const NEGLIGIBLE: f32 = 0x1p-60f;

struct ShapeRay {
    origin: vec3<f32>,
    direction: vec3<f32>,
    squared: f32,
    exponent: i32,
}

struct Span {
    some: bool,
    t: vec2<f32>,
    u: vec2<f32>,
}

fn no_span() -> vec2<f32> {
    return vec2<f32>(GREATEST, -GREATEST);
}

fn ratio(a: f32, b: f32) -> f32 {
    return snap(quotient(a, b));
}

fn dot_of(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return snapped_sum(snapped_sum(snapped_product(a.x, b.x), snapped_product(a.y, b.y)), snapped_product(a.z, b.z));
}

fn minus3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(snapped_difference(a.x, b.x), snapped_difference(a.y, b.y), snapped_difference(a.z, b.z));
}

fn times3(v: vec3<f32>, factor: f32) -> vec3<f32> {
    return vec3<f32>(snapped_product(v.x, factor), snapped_product(v.y, factor), snapped_product(v.z, factor));
}

// A ray that can hit something.
fn shape_ray(ray: Ray) -> ShapeRay {
    let direction = snap3(ray.direction);
    let power = min(exponent(most_of(abs(direction))), 126);
    let along = times3(direction, power_of_two(-power));
    return ShapeRay(times3(snap3(ray.origin), 0.25), along, dot_of(along, along), power);
}

fn shape_t(t: f32, power: i32) -> f32 {
    let half = power / 2;
    return snapped_product(snapped_product(t, power_of_two(half)), power_of_two(power - half));
}

fn within_radius(start: vec3<f32>, along: vec3<f32>, squared: f32, radius: f32) -> vec2<f32> {
    let nearest = ratio(-dot_of(start, along), squared);
    let moved = times3(along, nearest);
    let point = vec3<f32>(
        snapped_sum(start.x, moved.x),
        snapped_sum(start.y, moved.y),
        snapped_sum(start.z, moved.z),
    );
    let left = snapped_difference(snapped_product(radius, radius), dot_of(point, point));
    if left < 0.0 {
        return no_span();
    }
    let half = square_root(ratio(left, squared));
    return vec2<f32>(snapped_difference(nearest, half), snapped_sum(nearest, half));
}

// Where the line is between the planes through both ends.
fn between_planes(start: f32, direction: f32, length: f32) -> vec2<f32> {
    if snapped_product(direction, direction) <= snapped_product(length, NEGLIGIBLE) {
        return select(no_span(), -no_span(), 0.0 <= start && start <= length);
    }
    let low = ratio(-start, direction);
    let high = ratio(snapped_difference(length, start), direction);
    return select(vec2<f32>(high, low), vec2<f32>(low, high), low < high);
}

// How far along the axis the line is at `t`, from 0 to 1.
fn part_of_axis(t: f32, start: f32, direction: f32, length: f32) -> f32 {
    let part = ratio(snapped_sum(start, snapped_product(t, direction)), length);
    return clamp(part, 0.0, 1.0);
}

fn capsule_span(ray: ShapeRay, first: vec4<f32>, second: vec3<f32>) -> Span {
    let end = times3(snap3(first.xyz), 0.25);
    var start = minus3(ray.origin, end);
    var axis = minus3(times3(snap3(second), 0.25), end);
    var radius = snapped_product(snap(first.w), 0.25);
    let size = exponent(most(most_of(abs(start)), most(most_of(abs(axis)), radius)));
    let factor = power_of_two(-size);
    start = times3(start, factor);
    axis = times3(axis, factor);
    radius = snapped_product(radius, factor);
    let length = dot_of(axis, axis);
    let start_along = dot_of(start, axis);
    let direction_along = dot_of(ray.direction, axis);
    var whole = no_span();
    // The balls about both ends, and the cylinder between them: one piece of code.
    for (var k = 0u; k < 3u; k++) {
        var at = start;
        var along = ray.direction;
        var planes = -no_span();
        if k == 1u {
            at = minus3(start, axis);
        } else if k == 2u {
            at = minus3(start, times3(axis, ratio(start_along, length)));
            along = minus3(along, times3(axis, ratio(direction_along, length)));
            planes = between_planes(start_along, direction_along, length);
        }
        let squared = dot_of(along, along);
        var part = planes;
        if squared >= NEGLIGIBLE {
            let round = within_radius(at, along, squared, radius);
            part = vec2<f32>(most(round.x, planes.x), least(round.y, planes.y));
        } else if dot_of(at, at) > snapped_product(radius, radius) {
            part = no_span();
        }
        if part.x <= part.y {
            whole = vec2<f32>(least(whole.x, part.x), most(whole.y, part.y));
        }
        if length < NEGLIGIBLE {
            break;
        }
    }
    if whole.x > whole.y {
        return Span(false, vec2<f32>(), vec2<f32>());
    }
    let power = size + 2 - ray.exponent;
    let t = vec2<f32>(shape_t(whole.x, power), shape_t(whole.y, power));
    if length < NEGLIGIBLE {
        return Span(true, t, vec2<f32>());
    }
    return Span(
        true,
        t,
        vec2<f32>(
            part_of_axis(whole.x, start_along, direction_along, length),
            part_of_axis(whole.y, start_along, direction_along, length),
        ),
    );
}
