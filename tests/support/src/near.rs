//! What is near, by looking at everything: all triangles and all points one after the other, by the operations that the core states.

use splitplane_core::arithmetic::snap;
use splitplane_core::backend::scene::{
    SceneClosestPoint, SceneClosestPointOptions, closest_in_world,
};
use splitplane_core::mesh::Mesh;
use splitplane_core::points::nearest::Neighbour;
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions, of_triangle};
use splitplane_core::scene::{IgnoredTriangle, InstanceId, Scene};
use splitplane_core::triangle::prepare;

use crate::rational::{self, Rational};

/// Whether anything can be near: a point of floats, and a distance that something may be within.
fn asks<const N: usize>(point: [f32; N], max_distance: f32) -> bool {
    point.iter().all(|x| x.is_finite()) && max_distance >= 0.0
}

/// The closest point of a mesh.
pub fn closest_point(
    mesh: &Mesh<'_>,
    point: [f32; 3],
    options: &ClosestPointOptions<'_>,
) -> ClosestPoint {
    let mut best = ClosestPoint::NONE;
    if !asks(point, options.max_distance) {
        return best;
    }
    let at = point.map(|x| f64::from(snap(x)));
    let limit = f64::from(options.max_distance).powi(2);
    for index in 0..mesh.len() {
        let triangle = prepare(&mesh.triangle(index));
        if !triangle.kept || options.ignore == Some(index as u32) {
            continue;
        }
        let found = ClosestPoint { triangle: index as u32, ..of_triangle(at, &triangle.corners) };
        if found.distance_squared <= limit && found.precedes(&best) {
            best = found;
        }
    }
    best
}

/// The nearest triangle of a mesh in rational arithmetic: of several that are as near the lowest.
pub fn nearest_triangle(
    mesh: &Mesh<'_>,
    point: [f32; 3],
    options: &ClosestPointOptions<'_>,
) -> Option<u32> {
    if !asks(point, options.max_distance) {
        return None;
    }
    let limit = options.max_distance;
    let limit = limit.is_finite().then(|| rational::square(limit, false));
    let mut best: Option<(Rational, u32)> = None;
    for index in (0..mesh.len() as u32).filter(|&index| options.ignore != Some(index)) {
        let triangle = prepare(&mesh.triangle(index as usize));
        if triangle.kept {
            enter(&mut best, limit.as_ref(), index, || {
                rational::squared_distance(&triangle.corners, point)
            });
        }
    }
    best.map(|(_, triangle)| triangle)
}

/// Takes what is nearer than the best one so far: what comes first has the lower number.
fn enter<T>(
    best: &mut Option<(Rational, T)>,
    limit: Option<&Rational>,
    name: T,
    squared: impl FnOnce() -> Rational,
) {
    let own = squared();
    if limit.is_none_or(|limit| own <= *limit) && best.as_ref().is_none_or(|(best, _)| own < *best)
    {
        *best = Some((own, name));
    }
}

/// The nearest triangle of a scene of meshes in rational arithmetic: its instance and its index.
pub fn scene_nearest_triangle(
    scene: &Scene,
    point: [f32; 3],
    options: &SceneClosestPointOptions<'_>,
) -> Option<(InstanceId, u32)> {
    if !asks(point, options.max_distance) {
        return None;
    }
    let from = point.map(|x| f64::from(snap(x)));
    let limit = options.max_distance;
    let limit = limit.is_finite().then(|| rational::square(limit, true));
    let mut best: Option<(Rational, (InstanceId, u32))> = None;
    for (name, instance) in scene.instances() {
        if instance.mask & options.mask == 0 {
            continue;
        }
        let mesh = scene.geometry(instance.geometry).expect("an instance's geometry").mesh();
        for triangle in 0..mesh.len() as u32 {
            let prepared = prepare(&mesh.triangle(triangle as usize));
            let ignored = IgnoredTriangle { instance: name, triangle };
            let fits = closest_in_world(from, &instance.transform, &prepared.corners).is_some();
            if prepared.kept && fits && options.ignore != Some(ignored) {
                enter(&mut best, limit.as_ref(), (name, triangle), || {
                    rational::squared_distance_in_world(
                        &instance.transform,
                        &prepared.corners,
                        point,
                    )
                });
            }
        }
    }
    best.map(|(_, name)| name)
}

/// The closest point of a scene of meshes.
pub fn scene_closest_point(
    scene: &Scene,
    point: [f32; 3],
    options: &SceneClosestPointOptions<'_>,
) -> SceneClosestPoint {
    let mut best = SceneClosestPoint::NONE;
    if !asks(point, options.max_distance) {
        return best;
    }
    let from = point.map(|x| f64::from(snap(x)));
    let limit = f64::from(options.max_distance).powi(2);
    for (name, instance) in scene.instances() {
        if instance.mask & options.mask == 0 {
            continue;
        }
        let mesh = scene.geometry(instance.geometry).expect("an instance's geometry").mesh();
        for triangle in 0..mesh.len() {
            let prepared = prepare(&mesh.triangle(triangle));
            let ignored = IgnoredTriangle { instance: name, triangle: triangle as u32 };
            if !prepared.kept || options.ignore == Some(ignored) {
                continue;
            }
            let own = closest_in_world(from, &instance.transform, &prepared.corners);
            let Some(mut own) = own else { continue };
            own.triangle = triangle as u32;
            let own = SceneClosestPoint::of(&own, instance.geometry, name);
            if own.distance_squared <= limit && own.precedes(&best) {
                best = own;
            }
        }
    }
    best
}

/// A cloud's unit: the power of two at its greatest coordinate.
pub fn unit<const N: usize>(points: &[[f32; N]]) -> f64 {
    let finite = points.iter().filter(|point| point.iter().all(|x| x.is_finite()));
    let most = finite.flatten().fold(0.0f64, |most, &x| most.max(f64::from(x.abs())));
    most.log2().floor().clamp(-126.0, 126.0).exp2()
}

/// All points within a distance, in order of (distance, index).
pub fn neighbours<const N: usize>(
    points: &[[f32; N]],
    query: [f32; N],
    max_distance: f32,
) -> Vec<Neighbour> {
    if !asks(query, max_distance) {
        return Vec::new();
    }
    let unit = unit(points);
    let scaled = |x: f32| snap((f64::from(snap(x)) / unit) as f32);
    let square = |x: f32| snap(x * x);
    let reach = square(scaled(max_distance));
    let mut all: Vec<(f32, u32)> = Vec::new();
    for (index, point) in points.iter().enumerate() {
        if point.iter().all(|x| x.is_finite()) {
            let squares: Vec<f32> =
                (0..N).map(|axis| square(scaled(query[axis]) - scaled(point[axis]))).collect();
            let sum = squares[1..].iter().fold(squares[0], |sum, s| sum + s);
            all.extend((sum <= reach).then_some((sum, index as u32)));
        }
    }
    all.sort_by(|a, b| a.partial_cmp(b).expect("no NaN"));
    let record =
        |(squared, point)| Neighbour { distance_squared: f64::from(squared) * unit * unit, point };
    all.into_iter().map(record).collect()
}
