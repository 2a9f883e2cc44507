//! The rays.

use super::{Shape, Surface, between, cross, minus, squared_distance, weighted, winding};
use crate::aim::aimed;
use crate::random::Random;
use splitplane_core::aabb::Aabb;
use splitplane_core::ray::{Culling, QueryOptions, Ray};

/// How rays run along a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// In the plane of a triangle: origin and target are both sums of its corners.
    InPlane,
    /// On the line of an edge, from before it, within it or behind it.
    AlongEdge,
    /// From a corner, or from before it, through another.
    CornerToCorner,
    /// From a point of an edge, or from before it, through a point of another.
    EdgeToEdge,
    /// In the plane of a triangle through one of its corners, where others meet it edge on.
    EdgeOn,
    /// Along an axis, mostly in planes along axes that corners lie in.
    AxisParallel,
    /// To a point within a triangle, at a small angle to its plane: from before it, above an edge or above
    /// itself, so that it is seen as thin as rounding allows, from the side or lengthwise.
    Skimming,
    /// From inside a closed surface, past its own faces; [`Surface`]s that are not closed have none.
    Inside,
}

impl Kind {
    /// All of them.
    pub const ALL: [Kind; 8] = [
        Kind::InPlane,
        Kind::AlongEdge,
        Kind::CornerToCorner,
        Kind::EdgeToEdge,
        Kind::EdgeOn,
        Kind::AxisParallel,
        Kind::Skimming,
        Kind::Inside,
    ];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Kind::InPlane => "in-plane",
            Kind::AlongEdge => "along-edge",
            Kind::CornerToCorner => "corner-to-corner",
            Kind::EdgeToEdge => "edge-to-edge",
            Kind::EdgeOn => "edge-on",
            Kind::AxisParallel => "axis-parallel",
            Kind::Skimming => "skimming",
            Kind::Inside => "inside",
        }
    }
}

/// Rays that are asked together.
#[derive(Clone, Debug)]
pub struct Volley {
    /// How they run.
    pub kind: Kind,
    /// The rays: single ones, and bundles of 32 and 64 that differ by little.
    pub rays: Vec<Ray>,
    /// What is asked besides.
    pub options: QueryOptions<'static>,
}

impl Volley {
    /// Whether every ray must hit: none gets out of a closed surface.
    pub fn is_held(&self) -> bool {
        self.kind == Kind::Inside
    }
}

/// How far origins inside lie from all triangles at least, in extents of the surface.
pub(super) const CLEARANCE: f64 = 0.01;
/// Origins inside that are kept for a surface.
const ORIGINS: usize = 24;

/// A maker of rays for one surface.
pub struct Grazer {
    triangles: Vec<[[f32; 3]; 3]>,
    corners: Vec<[[f64; 3]; 3]>,
    /// See [`Surface::own`].
    own: usize,
    extent: f64,
    /// The surface's bounds.
    low: [f64; 3],
    high: [f64; 3],
    /// Origins inside, and a triangle in whose plane each of them lies, or that it is far from.
    inside: Vec<([f32; 3], usize)>,
    random: Random,
}

impl Grazer {
    /// A maker; equal seeds give equal rays.
    pub fn new(surface: &Surface, seed: u64) -> Grazer {
        let (triangles, corners) = (surface.scene.triangles(), surface.corners());
        let bounds = Aabb::of_points(triangles.as_flattened());
        let mut grazer = Grazer {
            triangles,
            corners,
            own: surface.own,
            extent: surface.extent,
            low: bounds.lo.map(f64::from),
            high: bounds.hi.map(f64::from),
            inside: Vec::new(),
            random: Random::new(seed),
        };
        if surface.shape.is_closed() {
            grazer.look_inside(surface.shape);
        }
        grazer
    }

    /// The kinds of rays there are for this surface.
    pub fn kinds(&self) -> impl Iterator<Item = Kind> + use<> {
        let closed = !self.inside.is_empty();
        Kind::ALL.into_iter().filter(move |&kind| closed || kind != Kind::Inside)
    }

    /// So many rays of one kind, about half of them in bundles.
    pub fn volley(&mut self, kind: Kind, count: usize) -> Volley {
        let mut rays = Vec::with_capacity(count);
        while rays.len() < count {
            if self.random.below(64) == 0 {
                self.bundle(kind, &mut rays);
            } else {
                rays.push(self.ray(kind));
            }
        }
        rays.truncate(count);
        let mut options = QueryOptions::default();
        if kind != Kind::Inside {
            match self.random.below(12) {
                0 => options.culling = Culling::Back,
                1 => options.culling = Culling::Front,
                2 => options.ignore = Some(self.random.below(self.triangles.len()) as u32),
                _ => {}
            }
        }
        Volley { kind, rays, options }
    }

    /// One ray.
    pub fn ray(&mut self, kind: Kind) -> Ray {
        let ray = self.plain(kind);
        self.altered(kind, ray)
    }

    /// 32 or 64 rays that differ by little: from one origin within a plane, side by side, or by ulps.
    fn bundle(&mut self, kind: Kind, rays: &mut Vec<Ray>) {
        let base = self.ray(kind);
        let count = if self.random.below(2) == 0 { 32 } else { 64 };
        let step = 10f64.powf(self.random.between(-8.0, -2.0));
        let [a, b, c] = self.random.pick(&self.corners);
        let across = if self.random.below(2) == 0 { minus(b, a) } else { minus(c, b) };
        let long = |x: [f64; 3]| super::length(x).max(1e-30);
        let size = long(base.direction.map(f64::from)) / long(across);
        let how = self.random.below(3);
        for i in 0..count {
            let mut ray = base;
            let along = step * (f64::from(i) - f64::from(count) / 2.0);
            let moved =
                |x: [f32; 3], by: f64| [0, 1, 2].map(|k| (f64::from(x[k]) + by * across[k]) as f32);
            match how {
                0 => ray.direction = moved(base.direction, along * size),
                // From inside only by so little that they stay there.
                1 if kind != Kind::Inside => ray.origin = moved(base.origin, along),
                _ => ray = self.shaken(ray, 4),
            }
            rays.push(ray);
        }
    }

    fn plain(&mut self, kind: Kind) -> Ray {
        let index = self.random.below(self.triangles.len());
        match kind {
            Kind::InPlane => {
                let origin = self.in_plane(index, 3.0);
                let target = self.target(index);
                self.sent(origin, target)
            }
            Kind::AlongEdge => {
                let [a, b] = self.edge(index);
                let s = self.step();
                let origin = if self.random.below(4) == 0 { a } else { between(a, b, s) };
                let way = minus(b, a);
                let sign = self.random.pick(&[1.0, -1.0]);
                let origin = rounded(origin);
                // The difference of the corners, as it is, or from the rounded origin to one of them.
                if self.random.below(2) == 0 {
                    return Ray::new(origin, way.map(|x| (sign * x) as f32));
                }
                let target = self.random.pick(&[a, b]);
                self.sent(origin, target)
            }
            Kind::CornerToCorner => {
                let other = self.random.below(self.triangles.len());
                let (p, q) = (self.corner(index), self.corner(other));
                let back = if self.random.below(2) == 0 { 0.0 } else { self.step() };
                self.sent(rounded(between(p, q, -back.abs())), q)
            }
            Kind::EdgeToEdge => {
                let other = self.random.below(self.triangles.len());
                let (p, q) = (self.on_edge(index), self.on_edge(other));
                let back = if self.random.below(2) == 0 { 0.0 } else { self.step() };
                self.sent(rounded(between(p, q, -back.abs())), q)
            }
            Kind::EdgeOn => {
                let corner = self.random.below(3);
                let hub = self.corners[index][corner];
                let rim = self.on_edge(index);
                let s = self.random.between(-3.0, 3.0);
                self.sent(rounded(between(hub, rim, s)), hub)
            }
            Kind::AxisParallel => self.axis_parallel(),
            Kind::Skimming => self.skimming(index),
            Kind::Inside => {
                let (origin, triangle) = self.random.pick(&self.inside);
                let target = match self.random.below(16) {
                    0 => self.target(index),
                    1 => {
                        // Along the triangle, without meeting it.
                        let corner = self.corner(triangle);
                        let face = weighted(&self.corners[triangle], self.random.barycentric());
                        let way = minus(face, corner);
                        [0, 1, 2].map(|k| f64::from(origin[k]) + way[k])
                    }
                    2..5 => self.target(triangle),
                    // What is behind the edge is met by the neighbour alone.
                    _ => self.on_edge(triangle),
                };
                self.sent(origin, target)
            }
        }
    }

    /// A ray from the origin to the target, of any length.
    fn sent(&mut self, origin: [f32; 3], target: [f64; 3]) -> Ray {
        let ray = aimed(origin, target);
        let factor = match self.random.below(6) {
            0 => 1.0 / super::length(ray.direction.map(f64::from)).max(1e-30),
            1 => self.random.between(0.1, 30.0),
            _ => return ray,
        };
        let direction = ray.direction.map(|x| (f64::from(x) * factor) as f32);
        Ray { direction, ..ray }
    }

    /// The ray with what may happen to any: a few ulps, and limits.
    fn altered(&mut self, kind: Kind, mut ray: Ray) -> Ray {
        if self.random.below(2) == 0 {
            ray = self.shaken(ray, 4);
        }
        if kind == Kind::Inside {
            return ray;
        }
        match self.random.below(16) {
            0 | 1 => ray.with_limits(0.0, 1.0),
            2 => ray.with_limits(1.0, f32::INFINITY),
            3 => ray.with_limits(1f32.next_down(), 1f32.next_up()),
            4 => ray.with_limits(self.random.unit() as f32, f32::INFINITY),
            5 => ray.with_limits(f32::NEG_INFINITY, f32::INFINITY),
            6 => ray.with_limits(-0.5, self.random.between(0.0, 2.0) as f32),
            _ => ray,
        }
    }

    /// The ray moved by up to so many ulps in origin, direction or both. Zeros stay.
    fn shaken(&mut self, mut ray: Ray, most: usize) -> Ray {
        let what = self.random.below(3);
        let mut shake = |x: &mut f32| {
            let ulps = self.random.below(2 * most + 1) as i32 - most as i32;
            if x.is_normal() {
                let moved = f32::from_bits(x.to_bits().wrapping_add_signed(ulps));
                *x = if moved.is_normal() { moved } else { *x };
            }
        };
        if what != 0 {
            ray.origin.iter_mut().for_each(&mut shake);
        }
        if what != 1 {
            ray.direction.iter_mut().for_each(&mut shake);
        }
        ray
    }

    /// A step along a line: often one that leaves no rounding.
    fn step(&mut self) -> f64 {
        match self.random.below(2) {
            0 => self.random.pick(&[-2.0, -1.0, -0.5, 0.25, 0.5, 0.75, 1.5, 2.0, 4.0]),
            _ => self.random.between(-4.0, 4.0),
        }
    }

    fn corner(&mut self, triangle: usize) -> [f64; 3] {
        self.random.pick(&self.corners[triangle])
    }

    fn edge(&mut self, triangle: usize) -> [[f64; 3]; 2] {
        let first = self.random.below(3);
        [0, 1].map(|k| self.corners[triangle][(first + k) % 3])
    }

    fn on_edge(&mut self, triangle: usize) -> [f64; 3] {
        let [a, b] = self.edge(triangle);
        let s = if self.random.below(4) == 0 { 0.5 } else { self.random.unit() };
        between(a, b, s)
    }

    /// A point of a triangle's plane, up to so many times its size away.
    fn in_plane(&mut self, triangle: usize, most: f64) -> [f32; 3] {
        let [u, v] = [(); 2].map(|()| {
            let x = self.random.between(-most, most);
            if self.random.below(4) == 0 { (x * 4.0).round() / 4.0 } else { x }
        });
        rounded(weighted(&self.corners[triangle], [1.0 - u - v, u, v]))
    }

    /// A point to aim at in the plane of a triangle.
    fn target(&mut self, triangle: usize) -> [f64; 3] {
        match self.random.below(8) {
            0..4 => self.on_edge(triangle),
            4 | 5 => self.corner(triangle),
            6 => weighted(&self.corners[triangle], self.random.barycentric()),
            _ => self.in_plane(triangle, 2.0).map(f64::from),
        }
    }

    fn skimming(&mut self, index: usize) -> Ray {
        let corners = self.corners[index];
        let [a, b, c] = corners;
        let from = match self.random.below(4) {
            0 => self.on_edge(index),
            1 => weighted(&corners, self.random.barycentric()),
            2 => {
                // Through the triangle lengthwise.
                let s = self.step();
                let middle = weighted(&corners, [1.0 / 3.0; 3]);
                between(self.corner(index), middle, s)
            }
            _ => self.in_plane(index, 3.0).map(f64::from),
        };
        let normal = cross(minus(b, a), minus(c, a));
        let size = super::length(minus(b, a)).max(super::length(minus(c, a)));
        let height = size * 2f64.powf(self.random.between(-26.0, -2.0));
        let up = height * self.random.pick(&[1.0, -1.0]) / super::length(normal).max(1e-300);
        let target = weighted(&corners, self.random.barycentric());
        self.sent(rounded([0, 1, 2].map(|k| from[k] + up * normal[k])), target)
    }

    fn axis_parallel(&mut self) -> Ray {
        let axis = self.random.below(3);
        let mut origin = [0, 1, 2].map(|k| {
            let triangle = self.random.below(self.triangles.len());
            self.random.pick(&self.triangles[triangle])[k]
        });
        if self.random.below(4) > 0 {
            // In the plane, or on the line, of one corner.
            let triangle = self.random.below(self.triangles.len());
            let corner = self.random.pick(&self.triangles[triangle]);
            let kept = self.random.below(3);
            for k in (0..3).filter(|&k| k != kept) {
                origin[k] = corner[k];
            }
        }
        let sign = self.random.pick(&[1.0, -1.0]);
        if self.random.below(2) == 0 {
            let way = sign * self.extent * self.random.between(1.0, 2.0);
            origin[axis] = (f64::from(origin[axis]) - way) as f32;
        }
        let mut direction = [(); 3].map(|()| self.random.pick(&[0.0, -0.0]));
        direction[axis] = (sign * self.extent) as f32;
        // Some lean within a plane along the axes.
        if self.random.below(3) == 0 {
            direction[(axis + 1) % 3] = (self.extent * self.random.between(-1.0, 1.0)) as f32;
        }
        Ray::new(origin, direction)
    }

    /// Finds origins inside, most of them in the planes of triangles where there are any: where edges point
    /// inwards, or surfaces stand in others.
    fn look_inside(&mut self, shape: Shape) {
        let convex = matches!(shape, Shape::LatLong | Shape::Icosphere | Shape::Box);
        let in_planes = if convex { 0 } else { 20 * ORIGINS };
        for attempt in 0..in_planes + 20 * ORIGINS {
            let wanted = if attempt < in_planes { ORIGINS * 3 / 4 } else { ORIGINS };
            if self.inside.len() >= wanted {
                continue;
            }
            let triangle = self.random.below(self.own);
            let origin = if attempt < in_planes {
                self.in_plane(triangle, 2.0)
            } else {
                // Somewhere between four corners.
                let [a, b, c, d] = [(); 4].map(|()| {
                    let other = self.random.below(self.own);
                    self.corner(other)
                });
                let middle = weighted(&[a, b, c], self.random.barycentric());
                rounded(between(middle, d, self.random.unit()))
            };
            if self.is_inside(origin.map(f64::from)) {
                self.inside.push((origin, triangle));
            }
        }
    }

    /// Whether surfaces go around a point that is at the [`CLEARANCE`] from all of them.
    fn is_inside(&self, point: [f64; 3]) -> bool {
        let clearance = CLEARANCE * self.extent;
        let within = (0..3).all(|k| self.low[k] < point[k] && point[k] < self.high[k]);
        let is_clear = |t| squared_distance(point, t) >= clearance * clearance;
        within && self.corners.iter().all(is_clear) && winding(point, &self.corners) != 0
    }
}

fn rounded(point: [f64; 3]) -> [f32; 3] {
    point.map(|x| x as f32)
}

#[cfg(test)]
mod tests {
    use super::super::{cross, dot, length};
    use super::*;

    /// Most rays in planes lie in the plane of a triangle but for rounding.
    #[test]
    fn rays_lie_in_planes() {
        for shape in [Shape::Soup, Shape::Box, Shape::Bumpy] {
            let surface = Surface::new(shape, 5);
            let mut grazer = Grazer::new(&surface, 1);
            let volley = grazer.volley(Kind::InPlane, 500);
            let within = volley.rays.iter().filter(|ray| {
                let (o, d) = (ray.origin.map(f64::from), ray.direction.map(f64::from));
                surface.corners().iter().any(|[a, b, c]| {
                    let normal = cross(minus(*b, *a), minus(*c, *a));
                    let apart = dot(normal, minus(o, *a)).abs() / length(normal);
                    let cosine = dot(normal, d).abs() / length(normal) / length(d);
                    apart < 1e-5 * surface.extent && cosine < 1e-5
                })
            });
            let within = within.count();
            assert!(within > 300, "{shape:?}: {within}");
        }
    }

    #[test]
    fn every_closed_surface_has_origins_inside() {
        for shape in Shape::ALL.into_iter().filter(|shape| shape.is_closed()) {
            for seed in 0..10 {
                let surface = Surface::new(shape, seed);
                let grazer = Grazer::new(&surface, 1);
                assert!(grazer.inside.len() > 4, "{shape:?} {seed}: {}", grazer.inside.len());
            }
        }
    }

    /// Surfaces whose edges point inwards have origins in the planes of triangles.
    #[test]
    fn origins_inside_lie_in_planes() {
        let mut count = 0;
        for seed in 0..20 {
            let surface = Surface::new(Shape::Bumpy, seed);
            let grazer = Grazer::new(&surface, 1);
            count += grazer
                .inside
                .iter()
                .filter(|(origin, triangle)| {
                    let [a, b, c] = grazer.corners[*triangle];
                    let normal = cross(minus(b, a), minus(c, a));
                    let apart = dot(normal, minus(origin.map(f64::from), a)).abs() / length(normal);
                    apart < 1e-4 * surface.extent
                })
                .count();
        }
        assert!(count > 100, "{count}");
    }
}
