//! Distances and overlaps in `f64`, by formulas of their own, with a margin within which they say nothing.

use splitplane_core::query::overlap::Volume;

pub(crate) type Vector = [f64; 3];

/// Lengths below this part of the greatest coordinate are not told from none.
const MARGIN: f64 = 1e-9;
/// Triangles whose sine is less have no face here, and vectors that are this near to parallel no product.
const FLAT: f64 = 1e-6;

fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn plus(a: Vector, b: Vector, t: f64) -> Vector {
    [a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]]
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn length(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A product of two directions; `None` where they are nearly parallel.
fn across(a: Vector, b: Vector) -> Option<Vector> {
    let product = cross(a, b);
    let sine = length(product) / (length(a) * length(b));
    (sine > FLAT).then(|| product.map(|x| x / length(product)))
}

fn wide(corner: [f32; 3], origin: [f32; 3]) -> Vector {
    [0, 1, 2].map(|axis| f64::from(corner[axis]) - f64::from(origin[axis]))
}

fn greatest(points: &[Vector]) -> f64 {
    points.as_flattened().iter().fold(0.0f64, |most, x| most.max(x.abs()))
}

/// Where a segment is closest to the origin.
fn on_segment(a: Vector, b: Vector) -> Vector {
    let edge = minus(b, a);
    let part = -dot(a, edge) / dot(edge, edge);
    plus(a, edge, if part > 0.0 { part.min(1.0) } else { 0.0 })
}

/// Where a triangle is closest to the origin.
fn on_triangle([a, b, c]: [Vector; 3]) -> Vector {
    let edges = [(a, b), (b, c), (c, a)];
    let nearer = |x: Vector, y: Vector| if dot(y, y) < dot(x, x) { y } else { x };
    let best = edges.iter().map(|&(a, b)| on_segment(a, b)).reduce(nearer).unwrap_or(a);
    let Some(normal) = across(minus(b, a), minus(c, a)) else { return best };
    let foot = normal.map(|x| x * dot(normal, a));
    let is_left = |&(from, to): &(Vector, Vector)| {
        dot(normal, cross(minus(to, from), minus(foot, from))) >= 0.0
    };
    if edges.iter().all(is_left) { nearer(best, foot) } else { best }
}

/// What a distance between two convex sets is within, if a vector is about the least from one to the other.
fn range(x: Vector, from: &[Vector], to: &[Vector], margin: f64) -> (f64, f64) {
    let far = length(x);
    if far <= margin {
        return (0.0, far + margin);
    }
    let most = from.iter().map(|&p| dot(x, p)).fold(f64::NEG_INFINITY, f64::max);
    let least = to.iter().map(|&p| dot(x, p)).fold(f64::INFINITY, f64::min);
    (((least - most) / far - margin).max(0.0), far + margin)
}

/// What the distance of a triangle from a point is within.
pub(crate) fn distance(point: [f32; 3], corners: &[[f32; 3]; 3]) -> (f64, f64) {
    let corners = corners.map(|corner| wide(corner, point));
    let margin = MARGIN * greatest(&corners);
    range(on_triangle(corners), &[[0.0; 3]], &corners, margin)
}

/// Whether a range is within a distance; `None` where that is not known.
fn within((low, high): (f64, f64), distance: f64) -> Option<bool> {
    if high < distance {
        Some(true)
    } else if low > distance {
        Some(false)
    } else {
        None
    }
}

/// From a point of one segment to a point of the other, the least but for roundings.
fn between_segments([a, b]: [Vector; 2], [c, d]: [Vector; 2]) -> Vector {
    let (u, v, w) = (minus(b, a), minus(d, c), minus(a, c));
    let mut best = [a, b].map(|p| on_segment(minus(c, p), minus(d, p)));
    let ends = [c, d].map(|p| {
        let back = on_segment(minus(a, p), minus(b, p));
        back.map(|x| -x)
    });
    best.sort_by(|x, y| dot(*x, *x).total_cmp(&dot(*y, *y)));
    let mut least = best[0];
    for end in ends {
        if dot(end, end) < dot(least, least) {
            least = end;
        }
    }
    let (uu, uv, vv) = (dot(u, u), dot(u, v), dot(v, v));
    let whole = uu * vv - uv * uv;
    if whole > FLAT * uu * vv {
        let s = (uv * dot(v, w) - vv * dot(u, w)) / whole;
        let t = (uu * dot(v, w) - uv * dot(u, w)) / whole;
        if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
            let x = minus(plus(c, v, t), plus(a, u, s));
            if dot(x, x) < dot(least, least) {
                least = x;
            }
        }
    }
    least
}

fn capsule([p, q]: [Vector; 2], corners: [Vector; 3], radius: f64, margin: f64) -> Option<bool> {
    let [a, b, c] = corners;
    let mut all = vec![];
    for end in [p, q] {
        all.push(on_triangle(corners.map(|corner| minus(corner, end))));
    }
    for edge in [[a, b], [b, c], [c, a]] {
        all.push(between_segments([p, q], edge));
    }
    let least = all.into_iter().reduce(|x, y| if dot(y, y) < dot(x, x) { y } else { x })?;
    if within(range(least, &[p, q], &corners, margin), radius).is_some() {
        return within(range(least, &[p, q], &corners, margin), radius);
    }
    // The segment may go through.
    let normal = across(minus(b, a), minus(c, a))?;
    let (from, to) = (dot(normal, minus(p, a)), dot(normal, minus(q, a)));
    if from.abs() < margin || to.abs() < margin || (from > 0.0) == (to > 0.0) {
        return None;
    }
    let through = plus(p, minus(q, p), from / (from - to));
    let inside = [(a, b), (b, c), (c, a)].iter().all(|&(from, to)| {
        let edge = minus(to, from);
        dot(normal, cross(edge, minus(through, from))) > 10.0 * margin * length(edge)
    });
    let is_steep = (from - to).abs() > 1e-3 * length(minus(q, p));
    (inside && is_steep).then_some(true)
}

/// By axes that may separate two hulls; `is_all` if no other axis does.
fn by_axes(
    axes: &[Vector],
    one: &[Vector],
    other: &[Vector],
    is_all: bool,
    margin: f64,
) -> Option<bool> {
    let mut gap = f64::NEG_INFINITY;
    for &axis in axes {
        let ends = |hull: &[Vector]| {
            hull.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &p| {
                let at = dot(axis, p);
                (low.min(at), high.max(at))
            })
        };
        let ((low, high), (others_low, others_high)) = (ends(one), ends(other));
        gap = gap.max(others_low - high).max(low - others_high);
    }
    if gap > margin {
        Some(false)
    } else if gap < -margin && is_all {
        Some(true)
    } else {
        None
    }
}

fn edges([a, b, c]: [Vector; 3]) -> [Vector; 3] {
    [minus(b, a), minus(c, b), minus(a, c)]
}

fn hulls(
    one: (&[Vector], &[Vector], &[Vector]),
    other: (&[Vector], &[Vector], &[Vector]),
    margin: f64,
) -> Option<bool> {
    let (mut axes, mut is_all) = (Vec::new(), true);
    axes.extend(one.1.iter().chain(other.1));
    for &own in one.2 {
        for &others in other.2 {
            match across(own, others) {
                Some(axis) => axes.push(axis),
                None => is_all = false,
            }
        }
    }
    by_axes(&axes, one.0, other.0, is_all, margin)
}

/// What is left of a polygon in a half of space, as many times larger as the margin says.
fn clipped(polygon: Vec<Vector>, normal: Vector, offset: f64) -> Vec<Vector> {
    let mut left = Vec::new();
    for (at, &p) in polygon.iter().enumerate() {
        let q = polygon[(at + 1) % polygon.len()];
        let (own, next) = (dot(normal, p) - offset, dot(normal, q) - offset);
        if own <= 0.0 {
            left.push(p);
        }
        if (own < 0.0) != (next < 0.0) && own != 0.0 && next != 0.0 {
            left.push(plus(p, minus(q, p), own / (own - next)));
        }
    }
    left
}

/// Whether a triangle meets a volume; `None` where it is too near to tell.
pub(crate) fn meets(volume: &Volume<'_>, triangle: &[[f32; 3]; 3]) -> Option<bool> {
    let origin = triangle[0];
    let corners = triangle.map(|corner| wide(corner, origin));
    let [a, b, c] = corners;
    let normal = across(minus(b, a), minus(c, a));
    let own = edges(corners);
    let margin = |others: &[Vector]| MARGIN * greatest(others).max(greatest(&corners));
    match *volume {
        Volume::Ball { centre, radius } => within(distance(centre, triangle), f64::from(radius)),
        Volume::Capsule { from, to, radius } => {
            let ends = [from, to].map(|end| wide(end, origin));
            capsule(ends, corners, f64::from(radius), margin(&ends))
        }
        Volume::Box(bounds) => {
            let [lo, hi] = [bounds.lo, bounds.hi].map(|corner| wide(corner, origin));
            let ends: Vec<Vector> = (0..8)
                .map(|k| [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { lo[axis] } else { hi[axis] }))
                .collect();
            let faces = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            let normals: Vec<Vector> = normal.into_iter().collect();
            let found = hulls((&corners, &normals, &own), (&ends, &faces, &faces), margin(&ends));
            // Without its normal it is not all.
            found.filter(|&found| !found || normal.is_some())
        }
        Volume::Triangle(other) => {
            let others = other.map(|corner| wide(corner, origin));
            let [d, e, f] = others;
            let others_normal = across(minus(e, d), minus(f, d));
            let (normals, others_normals): (Vec<Vector>, Vec<Vector>) =
                (normal.into_iter().collect(), others_normal.into_iter().collect());
            let others_edges = edges(others);
            let found = hulls(
                (&corners, &normals, &own),
                (&others, &others_normals, &others_edges),
                margin(&others),
            );
            found.filter(|&found| !found || (normal.is_some() && others_normal.is_some()))
        }
        Volume::Planes(planes) => {
            let margin = margin(&[wide([0.0; 3], origin)]);
            let clip = |by: f64| {
                planes.iter().fold(corners.to_vec(), |polygon, plane| {
                    let normal = plane.normal.map(f64::from);
                    let size = length(normal);
                    let offset = f64::from(plane.offset) - dot(normal, origin.map(f64::from));
                    let by = by * (margin + MARGIN * f64::from(plane.offset).abs() / size);
                    clipped(polygon, normal.map(|x| x / size), offset / size + by)
                })
            };
            if clip(1.0).is_empty() {
                Some(false)
            } else if !clip(-1.0).is_empty() {
                Some(true)
            } else {
                None
            }
        }
        // Nothing is known of others.
        _ => None,
    }
}
