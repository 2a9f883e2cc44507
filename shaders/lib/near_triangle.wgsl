// How far a triangle is from the origin of a query, between bounds that hold whatever its shape is.
//
// Any point x of the triangle is an upper bound. Any direction x gives a lower one: all of the triangle lies beyond the plane
// across x through the corner that is least along x. Where x is near the closest point, the bounds are near one another; where a sliver's
// foot is badly known, they are apart, and the host decides between more triangles.

// The corners from the origin of a query, in its unit.
fn corners_from(origin: vec3<f32>, unit: f32, triangle: u32) -> Triangle {
    let corners = corners_of(triangle);
    return Triangle(
        scaled3(difference3(corners.a, origin), unit),
        scaled3(difference3(corners.b, origin), unit),
        scaled3(difference3(corners.c, origin), unit),
    );
}

// A point of the triangle that is about as near to the origin as any.
fn near_point(seen: Triangle) -> vec3<f32> {
    let e = difference3(seen.b, seen.a);
    let f = difference3(seen.c, seen.a);
    let n = cross3(e, f);
    let nn = dot3(n, n);
    if nn > LEAST_DIVISOR {
        let root = inverse_root(nn);
        let inverse = product(root, root);
        let v = product(dot3(n, cross3(f, seen.a)), inverse);
        let w = product(dot3(n, cross3(seen.a, e)), inverse);
        if v >= 0.0 && w >= 0.0 && sum(v, w) <= 1.0 {
            return sum3(sum3(seen.a, scaled3(e, v)), scaled3(f, w));
        }
    }
    // The nearest point of the edges. In a loop, which keeps the shader small.
    var best = seen.a;
    var least_square = dot3(best, best);
    var start = seen.a;
    var edge = e;
    for (var number = 0u; number < 3u; number++) {
        let square = dot3(edge, edge);
        var part = 0.0;
        if square > LEAST_DIVISOR {
            let root = inverse_root(square);
            part = clamp(product(product(-dot3(start, edge), root), root), 0.0, 1.0);
        }
        let point = sum3(start, scaled3(edge, part));
        let own = dot3(point, point);
        if own < least_square {
            least_square = own;
            best = point;
        }
        start = select(seen.b, seen.a, number == 0u);
        edge = select(difference3(seen.c, seen.b), f, number == 0u);
    }
    return best;
}

// The least and the greatest that the distance of a triangle from the origin may be.
fn distance_range(seen: Triangle) -> vec2<f32> {
    let x = near_point(seen);
    let square = dot3(x, x);
    if square < LEAST_SQUARE {
        return vec2<f32>(0.0, sum(NEAR_BATCH_SLACK, NEAR_BATCH_SLACK));
    }
    let inverse = inverse_root(square);
    let along = least(least(dot3(x, seen.a), dot3(x, seen.b)), dot3(x, seen.c));
    let lower = difference(product(along, inverse), NEAR_BATCH_SLACK);
    return vec2<f32>(most(lower, 0.0), sum(product(square, inverse), NEAR_BATCH_SLACK));
}
