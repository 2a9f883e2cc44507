//! Sets of rays: four by the rules of the harness that `scripts/measure_peers.sh` starts, and the rays of a path tracer. In `f64` by
//! + - * / and roots, rounded once.

use splitplane_core::aabb::Aabb;
use splitplane_core::error::QueryError;
use splitplane_core::ray::Ray;
use splitplane_core::scene::SceneHit;

/// Those of the harness, then those of a path tracer.
pub(crate) const SETS: [&str; 6] =
    ["primary", "shadow", "bounce", "chords", "paths", "path-shadows"];
/// Bounces of a path at most.
const DEPTH: usize = 4;
/// Pixels on a side, and the root of the number of chords.
const SIDE: usize = 1024;
const FAR: f32 = 1e30;
pub(crate) type Vector = [f64; 3];

/// Camera and light.
struct View {
    eye: Vector,
    forward: Vector,
    half: f64,
    light: Vector,
    centre: Vector,
    diagonal: f64,
}

/// Rays of one scene.
pub(crate) struct Sets {
    /// The harness's, in the order of [`SETS`].
    pub harness: [Vec<Ray>; 4],
    /// A path tracer's bounces, and the shadow rays of where they end.
    pub paths: [Vec<Ray>; 2],
}

/// The sets. Paths begin at those camera rays with a hit that `chosen` keeps. `interior` says that the camera stands within the scene, `seen` what rays hit, and `face` which
/// triangle a hit is on.
///
/// # Errors
/// Where a query fails.
pub(crate) fn sets(
    bounds: &Aabb,
    interior: bool,
    chosen: impl Fn(&[Ray]) -> Vec<Ray>,
    seen: impl Fn(&[Ray]) -> Result<Vec<SceneHit>, QueryError>,
    face: impl Fn(&SceneHit) -> [Vector; 3],
) -> Result<Sets, QueryError> {
    let (lo, hi) = (wide(bounds.lo), wide(bounds.hi));
    let (centre, size) = (scaled(add(lo, hi), 0.5), sub(hi, lo));
    let diagonal = dot(size, size).sqrt();
    let eye = add(centre, scaled(unit([0.6, 0.35, 0.72]), 1.2 * diagonal));
    let mut view = View {
        eye,
        forward: unit(sub(centre, eye)),
        half: 0.414_213_562_373_095_03,
        light: add(centre, scaled([0.3, 0.9, 0.4], diagonal)),
        centre,
        diagonal,
    };
    if interior {
        view.move_inside(lo, size, &seen, &face)?;
    }
    let primary = view.primary(SIDE);
    let hits = seen(&primary)?;
    let [shadow, bounce] = view.secondary(&face, &primary, &hits);
    let struck = primary.iter().zip(&hits).filter(|(_, hit)| hit.is_hit());
    let struck: Vec<Ray> = struck.map(|(ray, _)| *ray).collect();
    let paths = view.paths(&chosen(&struck), seen, face)?;
    Ok(Sets { harness: [primary, shadow, bounce, view.chords()], paths })
}

impl View {
    /// The first place that sees some way and some detail, and the first light that reaches a fair part of it.
    fn move_inside(
        &mut self,
        lo: Vector,
        size: Vector,
        seen: impl Fn(&[Ray]) -> Result<Vec<SceneHit>, QueryError>,
        face: impl Fn(&SceneHit) -> [Vector; 3],
    ) -> Result<(), QueryError> {
        let middle = [self.centre[0], lo[1] + 0.4 * size[1], self.centre[2]];
        (self.eye, self.forward, self.half) = (middle, [1.0, 0.0, 0.0], 0.767_326_987_978_960_2);
        let places = [0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65, 0.3, 0.7, 0.25, 0.75, 0.2, 0.8];
        let first = (self.eye, self.forward);
        let ways = [(0, 1.0), (0, -1.0), (2, 1.0), (2, -1.0)];
        let tries = ways.into_iter().flat_map(|way| places.map(|place| (way, place)));
        let mut found = false;
        for ((axis, sign), place) in tries {
            (self.eye, self.forward) = (middle, [0.0; 3]);
            self.eye[axis] = lo[axis] + place * size[axis];
            self.forward[axis] = sign;
            let hits = seen(&self.primary(64))?;
            let mut t: Vec<f32> = hits.iter().map(|hit| hit.t).collect();
            t.sort_by(f32::total_cmp);
            let mut triangles: Vec<u32> = hits.iter().map(|hit| hit.triangle).collect();
            triangles.sort_unstable();
            triangles.dedup();
            let far = f64::from(t[t.len() / 2]);
            found = (0.1 * self.diagonal..f64::INFINITY).contains(&far) && triangles.len() >= 300;
            if found {
                break;
            }
        }
        if !found {
            (self.eye, self.forward) = first;
        }
        let rays = self.primary(64);
        let hits = seen(&rays)?;
        self.light = [self.eye[0], lo[1] + 0.85 * size[1], self.eye[2]];
        for step in 0..12 {
            let (height, before) = (0.85 - 0.05 * f64::from(step), self.light);
            self.light[1] = lo[1] + height * size[1];
            let [shadow, _] = self.secondary(&face, &rays, &hits);
            let dark = seen(&shadow)?.iter().filter(|hit| hit.is_hit()).count();
            if dark as f64 <= 0.75 * shadow.len() as f64 {
                break;
            }
            self.light = before;
        }
        Ok(())
    }

    fn primary(&self, side: usize) -> Vec<Ray> {
        let right = unit(cross(self.forward, [0.0, 1.0, 0.0]));
        let up = cross(right, self.forward);
        let of = |pixel: usize| {
            let at = |i: usize| 2.0 * (i as f64 + 0.5) / side as f64 - 1.0;
            let (x, y) = (at(pixel % side) * self.half, -at(pixel / side) * self.half);
            let along = unit(add(self.forward, add(scaled(right, x), scaled(up, y))));
            narrow(self.eye, along).with_limits(0.0, FAR)
        };
        (0..side * side).map(of).collect()
    }

    /// From what rays hit, moved off it: to the light, and off the surface, cosine-weighted.
    fn secondary(
        &self,
        face: impl Fn(&SceneHit) -> [Vector; 3],
        rays: &[Ray],
        hits: &[SceneHit],
    ) -> [Vec<Ray>; 2] {
        let (mut shadow, mut bounce) = (Vec::new(), Vec::new());
        for (number, (ray, hit)) in rays.iter().zip(hits).enumerate() {
            if hit.is_hit() {
                let [towards, off] = self.off_hit(face(hit), ray, hit, (42, number as u64));
                shadow.push(towards);
                bounce.push(off);
            }
        }
        [shadow, bounce]
    }

    /// The rays of a path tracer that works in waves: the first bounces of all paths, then all second ones, and so on, paths in the order of their
    /// camera rays. Who leaves the scene ends. Surfaces are diffuse; from wherever a bounce ends a shadow ray goes to the light, in the same order.
    fn paths(
        &self,
        camera: &[Ray],
        seen: impl Fn(&[Ray]) -> Result<Vec<SceneHit>, QueryError>,
        face: impl Fn(&SceneHit) -> [Vector; 3],
    ) -> Result<[Vec<Ray>; 2], QueryError> {
        let (mut bounces, mut shadows) = (Vec::new(), Vec::new());
        let mut numbers: Vec<u64> = (0..).take(camera.len()).collect();
        let mut rays = camera.to_vec();
        for depth in 0..=DEPTH {
            let hits = seen(&rays)?;
            let (mut next, mut alive) = (Vec::new(), Vec::new());
            for ((ray, hit), number) in rays.iter().zip(&hits).zip(numbers) {
                if hit.is_hit() {
                    let random = (42 + depth as u64, number);
                    let [towards, off] = self.off_hit(face(hit), ray, hit, random);
                    if depth > 0 {
                        shadows.push(towards);
                    }
                    next.push(off);
                    alive.push(number);
                }
            }
            if depth < DEPTH {
                bounces.extend_from_slice(&next);
            }
            (rays, numbers) = (next, alive);
        }
        Ok([bounces, shadows])
    }

    /// From a hit on a face: to the light, and off the surface with these random numbers (seed and stream).
    fn off_hit(
        &self,
        [a, b, c]: [Vector; 3],
        ray: &Ray,
        hit: &SceneHit,
        (seed, stream): (u64, u64),
    ) -> [Ray; 2] {
        let mut normal = unit(cross(sub(b, a), sub(c, a)));
        let along = wide(ray.direction);
        if dot(normal, along) > 0.0 {
            normal = scaled(normal, -1.0);
        }
        let point = add(wide(ray.origin), scaled(along, f64::from(hit.t)));
        let start = add(point, scaled(normal, 1e-4 * self.diagonal)).map(|x| x as f32);
        let to_light = sub(self.light, wide(start));
        let distance = dot(to_light, to_light).sqrt();
        let towards = narrow(wide(start), scaled(to_light, 1.0 / distance));
        let (x, y) = Random::new(seed, stream).in_disk();
        let z = (1.0 - x * x - y * y).max(1e-6).sqrt();
        let leans = |axis: &usize| normal[*axis].abs();
        let least = (0..3).min_by(|i, j| leans(i).total_cmp(&leans(j))).unwrap_or(0);
        let mut axis = [0.0; 3];
        axis[least] = 1.0;
        let tangent = unit(cross(normal, axis));
        let other = cross(normal, tangent);
        let off = add(scaled(normal, z), add(scaled(tangent, x), scaled(other, y)));
        [
            towards.with_limits(0.0, (distance * 0.9999) as f32),
            narrow(wide(start), unit(off)).with_limits(0.0, FAR),
        ]
    }

    /// Between two points of the sphere about the scene.
    fn chords(&self) -> Vec<Ray> {
        let of = |number: usize| {
            let mut random = Random::new(43, number as u64);
            let mut point = || add(self.centre, scaled(random.on_sphere(), 0.5 * self.diagonal));
            let (a, b) = (point(), point());
            narrow(a, unit(sub(b, a))).with_limits(0.0, FAR)
        };
        (0..SIDE * SIDE).map(of).collect()
    }
}

/// PCG-XSH-RR 64/32, a stream for each ray.
pub(crate) struct Random {
    state: u64,
    step: u64,
}

impl Random {
    pub(crate) fn new(seed: u64, stream: u64) -> Random {
        let mut random = Random { state: 0, step: stream << 1 | 1 };
        random.next();
        random.state = random.state.wrapping_add(seed);
        random.next();
        random
    }

    fn next(&mut self) -> u32 {
        let state = self.state;
        self.state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(self.step);
        ((((state >> 18) ^ state) >> 27) as u32).rotate_right((state >> 59) as u32)
    }

    /// From -1 to 1.
    pub(crate) fn signed(&mut self) -> f64 {
        f64::from(self.next() >> 8) * (1.0 / 8_388_608.0) - 1.0
    }

    fn on_sphere(&mut self) -> Vector {
        loop {
            let point = [self.signed(), self.signed(), self.signed()];
            let square = dot(point, point);
            if square > 1e-4 && square <= 1.0 {
                return scaled(point, 1.0 / square.sqrt());
            }
        }
    }

    pub(crate) fn in_disk(&mut self) -> (f64, f64) {
        loop {
            let (x, y) = (self.signed(), self.signed());
            if x * x + y * y <= 1.0 {
                return (x, y);
            }
        }
    }
}

fn narrow(origin: Vector, direction: Vector) -> Ray {
    Ray::new(origin.map(|x| x as f32), direction.map(|x| x as f32))
}

pub(crate) fn wide(v: [f32; 3]) -> Vector {
    v.map(f64::from)
}

pub(crate) fn add(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + b[i])
}

pub(crate) fn sub(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] - b[i])
}

pub(crate) fn scaled(v: Vector, by: f64) -> Vector {
    v.map(|x| x * by)
}

pub(crate) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(v: Vector) -> Vector {
    scaled(v, 1.0 / dot(v, v).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first numbers of the published demonstration, seed 42 and sequence 54.
    #[test]
    fn random_numbers_are_the_published_ones() {
        let mut random = Random::new(42, 54);
        let drawn: [u32; 4] = std::array::from_fn(|_| random.next());
        assert_eq!(drawn, [0xa15c_02b7, 0x7b47_f409, 0xba1d_3330, 0x83d2_f293]);
    }

    /// A floor and a ceiling, wide enough that most paths stay between them for a while.
    fn between(rays: &[Ray]) -> Vec<SceneHit> {
        let of = |ray: &Ray| {
            let (y, dy) = (ray.origin[1], ray.direction[1]);
            let t = if dy > 0.0 { (1.0 - y) / dy } else { -y / dy };
            let side = u32::from(dy > 0.0);
            let wide = (0..3).all(|i| (ray.origin[i] + t * ray.direction[i]).abs() < 50.0);
            let mut hit = SceneHit::MISS;
            if dy != 0.0 && t > 0.0 && wide {
                (hit.t, hit.triangle, hit.instance) = (t, side, 0);
            }
            hit
        };
        rays.iter().map(of).collect()
    }

    #[test]
    fn paths_follow_their_own_hits() {
        let bounds = Aabb { lo: [-50.0, 0.0, -50.0], hi: [50.0, 1.0, 50.0] };
        let face = |hit: &SceneHit| {
            let y = f64::from(hit.triangle);
            [[0.0, y, 0.0], [1.0, y, 0.0], [0.0, y, 1.0]]
        };
        let few = |rays: &[Ray]| rays.iter().take(500).copied().collect();
        let seen = |rays: &[Ray]| Ok(between(rays));
        let [bounces, shadows] = sets(&bounds, false, few, seen, face).unwrap().paths;
        // Each bounce that ends on a surface has a shadow ray from near there, in the same order.
        let hits = between(&bounces);
        let ends = bounces.iter().zip(&hits).filter(|(_, hit)| hit.is_hit());
        let ends: Vec<_> = ends.collect();
        assert_eq!(ends.len(), shadows.len());
        assert!(bounces.len() > 1000 && shadows.len() > 800, "{}", bounces.len());
        for ((ray, hit), shadow) in ends.into_iter().zip(&shadows) {
            let end: [f32; 3] = std::array::from_fn(|i| ray.origin[i] + hit.t * ray.direction[i]);
            assert!((0..3).all(|i| (end[i] - shadow.origin[i]).abs() < 0.02));
        }
        // A later bounce starts where a shadow ray does, and leaves the surface that it starts on.
        assert!(bounces.iter().all(|ray| (ray.origin[1] < 0.5) == (ray.direction[1] > 0.0)));
        let later = bounces.iter().filter(|ray| shadows.iter().any(|to| to.origin == ray.origin));
        assert!(later.count() > 500);
    }
}
