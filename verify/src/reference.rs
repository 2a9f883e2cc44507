//! Answers in f64 that share no code with any backend: Woop's test over all triangles, and over a
//! bounding volume hierarchy where all are too many.

use rayon::prelude::*;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;

/// Triangles of a leaf.
const LEAF: usize = 4;
/// Bins of the surface area heuristic.
const BINS: usize = 16;
/// Below this depth the hierarchy halves instead of weighing areas, so that it stays shallow.
const WEIGHED_DEPTH: u32 = 40;
/// Subtrees of fewer triangles are built on one thread.
const PARALLEL: usize = 4096;
/// Relative slack of box tests, a thousand times the rounding of f64.
const SLACK: f64 = 1e-12;

/// A ray in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray64 {
    /// Where `t = 0`.
    pub origin: [f64; 3],
    /// Direction, not zero.
    pub direction: [f64; 3],
    /// Least accepted `t`.
    pub t_min: f64,
    /// Greatest accepted `t`.
    pub t_max: f64,
}

impl From<&Ray> for Ray64 {
    fn from(ray: &Ray) -> Ray64 {
        Ray64 {
            origin: ray.origin.map(f64::from),
            direction: ray.direction.map(f64::from),
            t_min: f64::from(ray.t_min),
            t_max: f64::from(ray.t_max),
        }
    }
}

/// A hit in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit64 {
    /// Distance in units of the ray's direction.
    pub t: f64,
    /// Index of the triangle in the mesh.
    pub triangle: u32,
    /// Barycentric weights of the second and the third corner.
    pub uv: [f64; 2],
}

impl Hit64 {
    fn precedes(&self, other: &Hit64) -> bool {
        self.t < other.t || (self.t == other.t && self.triangle < other.triangle)
    }
}

/// The triangles of a mesh, ready for rays in f64.
#[derive(Debug)]
pub struct Reference {
    triangles: Vec<(u32, [[f64; 3]; 3])>,
    root: Option<Node>,
}

#[derive(Clone, Copy, Debug)]
struct Bounds {
    lo: [f64; 3],
    hi: [f64; 3],
}

#[derive(Debug)]
enum Node {
    Leaf { bounds: Bounds, first: usize, count: usize },
    Inner { bounds: Bounds, children: Box<[Node; 2]> },
}

impl Reference {
    /// Copies the triangles and builds the hierarchy. Left out is what every backend leaves out: a
    /// corner that is not finite, or two equal ones; coordinates below 2^-126 count as 0.
    pub fn new(mesh: &Mesh<'_>) -> Reference {
        let mut triangles: Vec<(u32, [[f64; 3]; 3])> =
            (0..mesh.len()).filter_map(|i| Some((i as u32, keep(mesh.triangle(i))?))).collect();
        let root = (!triangles.is_empty()).then(|| build(&mut triangles, 0, 0));
        Reference { triangles, root }
    }

    /// How many triangles take part.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// True when no triangle takes part.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Corners of the triangle at a place below [`Reference::len`]; places are not mesh indices.
    pub(super) fn corners(&self, place: usize) -> [[f64; 3]; 3] {
        self.triangles[place].1
    }

    /// Lower and upper corner of the box that holds all triangles; zeros without any.
    pub(super) fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        let bounds = self.root.as_ref().map(bounds_of);
        bounds.map_or(([0.0; 3], [0.0; 3]), |bounds| (bounds.lo, bounds.hi))
    }

    /// The hit of least (`t`, triangle), by the hierarchy.
    pub fn closest(&self, ray: &Ray64) -> Option<Hit64> {
        let test = Woop::new(ray);
        let mut best: Option<Hit64> = None;
        let mut stack: Vec<(f64, &Node)> = Vec::new();
        let enter = |node| enter_box(ray, bounds_of(node)).map(|t| (t, node));
        stack.extend(self.root.as_ref().and_then(enter));
        while let Some((entry, node)) = stack.pop() {
            if best.is_some_and(|hit| entry > hit.t + hit.t.abs() * SLACK) {
                continue;
            }
            match node {
                Node::Leaf { first, count, .. } => {
                    test.closest_of(&self.triangles[*first..first + count], &mut best);
                }
                Node::Inner { children, .. } => {
                    let [a, b] = [enter(&children[0]), enter(&children[1])];
                    let near_first =
                        a.map_or(f64::INFINITY, |c| c.0) <= b.map_or(f64::INFINITY, |c| c.0);
                    let [near, far] = if near_first { [a, b] } else { [b, a] };
                    stack.extend(far);
                    stack.extend(near);
                }
            }
        }
        best
    }

    /// The same by testing every triangle.
    pub fn closest_by_brute_force(&self, ray: &Ray64) -> Option<Hit64> {
        let test = Woop::new(ray);
        let in_parts = self.triangles.par_chunks(1 << 14).map(|part| {
            let mut best = None;
            test.closest_of(part, &mut best);
            best
        });
        in_parts.reduce(
            || None,
            |a, b| match (a, b) {
                (Some(a), Some(b)) => Some(if b.precedes(&a) { b } else { a }),
                (a, b) => a.or(b),
            },
        )
    }
}

/// The corners in f64; `None` for a triangle that takes no part.
fn keep(corners: [[f32; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let snap = |x: f32| if x.abs() < f32::MIN_POSITIVE { 0.0 } else { x };
    let [a, b, c] = corners.map(|corner| corner.map(snap));
    let finite = [a, b, c].as_flattened().iter().all(|x| x.is_finite());
    (finite && a != b && b != c && c != a).then(|| [a, b, c].map(|corner| corner.map(f64::from)))
}

fn bounds_of(node: &Node) -> &Bounds {
    match node {
        Node::Leaf { bounds, .. } | Node::Inner { bounds, .. } => bounds,
    }
}

/// Where the ray enters the box; `None` when it misses it.
fn enter_box(ray: &Ray64, bounds: &Bounds) -> Option<f64> {
    let (mut enter, mut leave) = (ray.t_min, ray.t_max);
    for k in 0..3 {
        let (o, d) = (ray.origin[k], ray.direction[k]);
        if d == 0.0 {
            if o < bounds.lo[k] || o > bounds.hi[k] {
                return None;
            }
            continue;
        }
        let (a, b) = ((bounds.lo[k] - o) / d, (bounds.hi[k] - o) / d);
        let (near, far) = if a < b { (a, b) } else { (b, a) };
        enter = enter.max(near - near.abs() * SLACK);
        leave = leave.min(far + far.abs() * SLACK);
    }
    (enter <= leave).then_some(enter)
}

/// The test of Woop, Benthin and Wald 2013 in f64: the same edge of two triangles gives the same
/// value but for its sign, so nothing slips between them.
struct Woop {
    ray: Ray64,
    axes: [usize; 3],
    shear: [f64; 3],
}

impl Woop {
    fn new(ray: &Ray64) -> Woop {
        let d = ray.direction;
        let z = (0..3).fold(0, |best, k| if d[k].abs() > d[best].abs() { k } else { best });
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        Woop { ray: *ray, axes: [x, y, z], shear: [d[x] / d[z], d[y] / d[z], 1.0 / d[z]] }
    }

    fn closest_of(&self, triangles: &[(u32, [[f64; 3]; 3])], best: &mut Option<Hit64>) {
        for (triangle, corners) in triangles {
            if let Some((t, uv)) = self.hit(corners) {
                let hit = Hit64 { t, triangle: *triangle, uv };
                if best.is_none_or(|best| hit.precedes(&best)) {
                    *best = Some(hit);
                }
            }
        }
    }

    fn hit(&self, corners: &[[f64; 3]; 3]) -> Option<(f64, [f64; 2])> {
        let [x, y, z] = self.axes;
        let [sx, sy, sz] = self.shear;
        let [a, b, c] = corners.map(|corner| {
            let p: [f64; 3] = std::array::from_fn(|k| corner[k] - self.ray.origin[k]);
            [p[x] - sx * p[z], p[y] - sy * p[z], p[z]]
        });
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        let t = sz * (u * a[2] + v * b[2] + w * c[2]) / det;
        (t >= self.ray.t_min && t <= self.ray.t_max).then_some((t, [v / det, w / det]))
    }
}

impl Bounds {
    const EMPTY: Bounds = Bounds { lo: [f64::INFINITY; 3], hi: [f64::NEG_INFINITY; 3] };

    fn of(corners: &[[f64; 3]; 3]) -> Bounds {
        corners.iter().fold(Bounds::EMPTY, |bounds, p| bounds.union(&Bounds { lo: *p, hi: *p }))
    }

    fn union(&self, other: &Bounds) -> Bounds {
        Bounds {
            lo: std::array::from_fn(|k| self.lo[k].min(other.lo[k])),
            hi: std::array::from_fn(|k| self.hi[k].max(other.hi[k])),
        }
    }

    fn area(&self) -> f64 {
        let [x, y, z] = std::array::from_fn(|k| (self.hi[k] - self.lo[k]).max(0.0));
        x * y + y * z + z * x
    }
}

fn middle(corners: &[[f64; 3]; 3], axis: usize) -> f64 {
    let Bounds { lo, hi } = Bounds::of(corners);
    0.5 * (lo[axis] + hi[axis])
}

fn build(triangles: &mut [(u32, [[f64; 3]; 3])], first: usize, depth: u32) -> Node {
    let (mut bounds, mut middles) = (Bounds::EMPTY, Bounds::EMPTY);
    for (_, corners) in triangles.iter() {
        bounds = bounds.union(&Bounds::of(corners));
        let point = [0, 1, 2].map(|axis| middle(corners, axis));
        middles = middles.union(&Bounds { lo: point, hi: point });
    }
    let count = triangles.len();
    if count <= LEAF {
        return Node::Leaf { bounds, first, count };
    }
    let extent = |axis: usize| middles.hi[axis] - middles.lo[axis];
    let axis = (0..3).fold(0, |best, k| if extent(k) > extent(best) { k } else { best });
    let weighed = if depth < WEIGHED_DEPTH && extent(axis) > 0.0 {
        partition_by_area(triangles, axis, middles.lo[axis], extent(axis))
    } else {
        None
    };
    let split = weighed.unwrap_or_else(|| {
        let half = count / 2;
        let key = |t: &(u32, [[f64; 3]; 3])| middle(&t.1, axis);
        triangles.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)));
        half
    });
    let (left, right) = triangles.split_at_mut(split);
    let mut a = || build(left, first, depth + 1);
    let mut b = || build(right, first + split, depth + 1);
    let children = if count > PARALLEL { rayon::join(a, b) } else { (a(), b()) };
    Node::Inner { bounds, children: Box::new(children.into()) }
}

/// Sorts the triangles to the two sides of the cheapest of a few planes; `None` when no plane
/// separates them.
fn partition_by_area(
    triangles: &mut [(u32, [[f64; 3]; 3])],
    axis: usize,
    start: f64,
    extent: f64,
) -> Option<usize> {
    let bin = |corners: &[[f64; 3]; 3]| {
        let at = (middle(corners, axis) - start) / extent;
        ((at * BINS as f64) as usize).min(BINS - 1)
    };
    let mut bins = [(0usize, Bounds::EMPTY); BINS];
    for (_, corners) in triangles.iter() {
        let (count, bounds) = &mut bins[bin(corners)];
        *count += 1;
        *bounds = bounds.union(&Bounds::of(corners));
    }
    let cost = |part: &[(usize, Bounds)]| {
        let count: usize = part.iter().map(|bin| bin.0).sum();
        let bounds = part.iter().fold(Bounds::EMPTY, |all, bin| all.union(&bin.1));
        (count > 0).then(|| count as f64 * bounds.area())
    };
    let planes = (1..BINS).filter_map(|plane| {
        let (left, right) = bins.split_at(plane);
        Some((cost(left)? + cost(right)?, plane))
    });
    let (_, plane) = planes.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let mut split = 0;
    for i in 0..triangles.len() {
        if bin(&triangles[i].1) < plane {
            triangles.swap(i, split);
            split += 1;
        }
    }
    Some(split)
}
