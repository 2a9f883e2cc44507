//! Which answers to a ray are right in a scene of many objects: from all triangles as their transforms place them, in `f64`, and
//! the bound that `docs/design/scenes.md` derives for a transform's roundings.
//!
//! An instance sees the ray a little moved. So a ray that passes a triangle's edge by less than the bound may hit it or not, and
//! one that passes all edges by more may not.

use std::collections::{BTreeMap, BTreeSet};

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::scene::BuiltScene;
use splitplane_core::ray::Ray;
use splitplane_core::scene::{
    GeometryId, Instance, InstanceId, ObjectSpace, Scene, SceneHit, Transform, WorldBox,
};
use splitplane_test_support::objects;

type V3 = [f64; 3];

fn minus(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// An instance in the world.
pub(crate) struct Object {
    pub(crate) name: InstanceId,
    pub(crate) instance: Instance,
    /// Corners of all triangles.
    pub(crate) triangles: Vec<[V3; 3]>,
    /// The first triangle with the same corners, such as where two boxes of one mesh touch.
    firsts: Vec<u32>,
    /// The geometry's box, in its own space.
    pub(crate) bounds: Aabb,
    /// How far the ray may be moved on an axis, apart from what grows with its origin.
    near: f64,
    /// What it is moved by per unit of the origin's greatest component.
    reach: f64,
    /// An earlier instance has the same geometry in the same place, and is the answer wherever this one could be.
    hidden: bool,
}

impl Object {
    /// How far the instance may see a ray from where it is.
    pub(crate) fn bound(&self, ray: &Ray) -> f64 {
        let from = ray.origin.iter().fold(0.0, |m: f64, &x| m.max(f64::from(x).abs()));
        // On each of three axes.
        3f64.sqrt() * (self.near + self.reach * from)
    }
}

/// A ray with what is asked of it for every triangle.
struct Line<'a> {
    ray: &'a Ray,
    from: V3,
    along: V3,
    length: f64,
    /// Unit vectors across the ray.
    across: [V3; 2],
}

impl Line<'_> {
    fn new(ray: &Ray) -> Line<'_> {
        let along = ray.direction.map(f64::from);
        let length = dot(along, along).sqrt();
        let least = (0..3).min_by(|&a, &b| along[a].abs().total_cmp(&along[b].abs())).unwrap();
        let mut axis = [0.0; 3];
        axis[least] = 1.0;
        let first = cross(along, axis);
        let first = first.map(|x| x / dot(first, first).sqrt());
        let second = cross(along, first).map(|x| x / length);
        Line { ray, from: ray.origin.map(f64::from), along, length, across: [first, second] }
    }
}

/// What a ray may find on a triangle: ranges of the hit's numbers.
struct Found {
    /// However the ray is moved within the bound, it hits.
    surely: bool,
    t: [f64; 2],
    weights: [[f64; 2]; 2],
}

impl Found {
    /// `None` for a triangle that the line passes by more than the bound, or which lies outside the ray's limits.
    fn new(line: &Line<'_>, bound: f64, corners: &[V3; 3]) -> Option<Found> {
        let off = corners.map(|p| minus(p, line.from));
        // The triangle as seen along the ray, which goes through 0, and where along it the corners are.
        let seen = off.map(|p| line.across.map(|axis| dot(p, axis)));
        let depth = off.map(|p| dot(p, line.along) / line.length.powi(2));
        let mut areas = [0.0; 3];
        let mut edges = [0.0; 3];
        let mut distance = f64::INFINITY;
        for k in 0..3 {
            let (a, b) = (seen[(k + 1) % 3], seen[(k + 2) % 3]);
            let edge = [b[0] - a[0], b[1] - a[1]];
            let squared = edge[0] * edge[0] + edge[1] * edge[1];
            let place = -(a[0] * edge[0] + a[1] * edge[1]) / squared;
            let place = if squared > 0.0 { place.clamp(0.0, 1.0) } else { 0.0 };
            distance = distance.min((a[0] + place * edge[0]).hypot(a[1] + place * edge[1]));
            areas[k] = a[0] * b[1] - a[1] * b[0];
            edges[k] = squared.sqrt();
        }
        let area: f64 = areas.iter().sum();
        let inside = area != 0.0 && areas.iter().all(|own| own / area > 0.0);
        if !inside && distance > bound {
            return None;
        }
        let aside = bound / line.length;
        let lo = depth.iter().fold(f64::INFINITY, |m, &t| m.min(t)) - aside;
        let hi = depth.iter().fold(f64::NEG_INFINITY, |m, &t| m.max(t)) + aside;
        let (mut t, mut weights) = ([lo, hi], [[0.0, 1.0]; 2]);
        if area != 0.0 {
            let plane = (0..3).map(|k| areas[k] * depth[k]).sum::<f64>() / area;
            let normal = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0]));
            let slack = aside * dot(normal, normal).sqrt() / area.abs();
            t = [lo.max(plane - slack), hi.min(plane + slack)];
            // Weights are off by as much as the point is, as seen along the ray, and by their own roundings.
            weights = [1, 2].map(|k| {
                let slack = bound * edges[k] / area.abs() + 2f64.powi(-16);
                [areas[k] / area - slack, areas[k] / area + slack]
            });
        }
        // The point that is found is up to 2^-14 of `t` along the ray from where `t` says.
        let own = |t: f64| t.abs() / 16_384.0 + 2f64.powi(-126);
        t = [t[0] - own(t[0]), t[1] + own(t[1])];
        let limits = [line.ray.t_min, line.ray.t_max].map(f64::from);
        if t[1] < limits[0] || t[0] > limits[1] {
            return None;
        }
        let within = t[0] >= limits[0] && t[1] <= limits[1];
        Some(Found { surely: inside && distance > bound && within, t, weights })
    }

    fn is(&self, hit: &SceneHit) -> bool {
        let within = |x: f32, range: [f64; 2]| (range[0]..=range[1]).contains(&f64::from(x));
        within(hit.t, self.t) && within(hit.u, self.weights[0]) && within(hit.v, self.weights[1])
    }
}

/// All objects of a scene, as their transforms place them.
pub(crate) struct World {
    pub objects: Vec<Object>,
}

impl World {
    /// `None` where the bound does not hold for an instance: its box would be everywhere.
    pub(crate) fn new(scene: &Scene, built: &BuiltScene) -> Option<World> {
        let mut objects: Vec<Object> = Vec::new();
        for (name, instance) in scene.instances() {
            let own = scene.geometry(instance.geometry).ok()?;
            let mesh = own.mesh();
            let transform = &instance.transform;
            let placed = |i| mesh.triangle(i).map(|p| in_world(transform, p));
            let triangles: Vec<[V3; 3]> = (0..mesh.len()).map(placed).collect();
            let mut seen = BTreeMap::new();
            let first = |(i, corners): (usize, &[V3; 3])| {
                let mut key = corners.map(|p| p.map(f64::to_bits));
                key.sort_unstable();
                *seen.entry(key).or_insert(i as u32)
            };
            let firsts = triangles.iter().enumerate().map(first).collect();
            let (mut near, mut reach) = (0.0, 0.0);
            let placement = built.placement(name)?;
            let bounds = placement.bounds;
            // The box of the turned box is wider than that by the bound.
            if let Some(wide) = WorldBox::new(transform, &space(transform), &bounds, None) {
                if wide == WorldBox::EVERYWHERE {
                    return None;
                }
                let mut tight = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
                for corner in 0..8 {
                    let p = [0, 1, 2].map(|k| [bounds.lo, bounds.hi][corner >> k & 1][k]);
                    for (k, x) in in_world(transform, p).into_iter().enumerate() {
                        tight[0][k] = tight[0][k].min(x);
                        tight[1][k] = tight[1][k].max(x);
                    }
                }
                for k in 0..3 {
                    let (lo, hi) = (f64::from(wide.bounds.lo[k]), f64::from(wide.bounds.hi[k]));
                    near = f64::max(near, (tight[0][k] - lo).max(hi - tight[1][k]));
                }
                reach = f64::from(wide.reach);
            }
            let same = |other: &Object| {
                let other = &other.instance;
                (other.geometry, other.transform) == (instance.geometry, instance.transform)
            };
            let hidden = objects.iter().any(same);
            let instance = *instance;
            objects.push(Object { name, instance, triangles, firsts, bounds, near, reach, hidden });
        }
        Some(World { objects })
    }

    fn object(&self, name: u32) -> Option<&Object> {
        self.objects.iter().find(|object| object.name.0 == name)
    }

    /// An instance and the first of its triangles that lies where that one does: which of them is nearer is a matter of roundings.
    pub(crate) fn surface(&self, (name, triangle): (u32, u32)) -> (u32, u32) {
        let first = self.object(name).and_then(|own| own.firsts.get(triangle as usize));
        (name, first.copied().unwrap_or(triangle))
    }

    /// Whether a hit is where its triangle is, within the bound, whatever else there is.
    pub(crate) fn is_on_its_triangle(&self, ray: &Ray, hit: &SceneHit) -> bool {
        let object = self.object(hit.instance);
        let Some(object) = object.filter(|own| own.instance.geometry == GeometryId(hit.geometry))
        else {
            return false;
        };
        let corners = object.triangles.get(hit.triangle as usize);
        let found = |corners| Found::new(&Line::new(ray), object.bound(ray), corners);
        corners.and_then(found).is_some_and(|found| found.is(hit))
    }

    /// Looks at all triangles. Whether the answer is right, and how many surfaces, or none of them, would be.
    pub(crate) fn judge(&self, ray: &Ray, hit: &SceneHit) -> (bool, usize) {
        let line = Line::new(ray);
        let mut found = Vec::new();
        for object in self.objects.iter().filter(|object| !object.hidden) {
            let bound = object.bound(ray);
            for (i, corners) in object.triangles.iter().enumerate() {
                let own = Found::new(&line, bound, corners);
                found.extend(own.map(|own| ((object.name.0, i as u32), own)));
            }
        }
        let sure = found.iter().filter(|(_, own)| own.surely);
        let farthest = sure.map(|(_, own)| own.t[1]).fold(f64::INFINITY, f64::min);
        found.retain(|(_, own)| own.t[0] <= farthest);
        let misses = farthest == f64::INFINITY;
        let is = |(name, own): &((u32, u32), Found)| {
            *name == (hit.instance, hit.triangle) && own.is(hit)
        };
        let right = if hit.is_hit() { found.iter().any(is) } else { misses };
        let surfaces: BTreeSet<_> = found.iter().map(|(name, _)| self.surface(*name)).collect();
        (right, surfaces.len() + usize::from(misses))
    }
}

fn in_world(transform: &Transform, point: [f32; 3]) -> V3 {
    objects::in_world(transform, point.map(f64::from))
}

/// The way into an object's space by the rule for the inverse of a matrix of three rows, on its own, so that a wrong way widens no bound.
fn space(transform: &Transform) -> ObjectSpace {
    let a = transform.map(|row| row.map(f64::from));
    let row = |k: usize| [a[k % 3][0], a[k % 3][1], a[k % 3][2]];
    // Columns of the adjugate.
    let columns = [0, 1, 2].map(|k| cross(row(k + 1), row(k + 2)));
    let determinant = dot(row(0), columns[0]);
    let inverse = [0, 1, 2].map(|k| {
        let own = columns.map(|column| column[k] / determinant);
        let from = -dot(own, a.map(|row| row[3]));
        [own[0] as f32, own[1] as f32, own[2] as f32, from as f32]
    });
    ObjectSpace { inverse, mirrored: determinant < 0.0 }
}
