//! Closest points, overlaps, casts and nearest points of meshes of any floats: what all triangles and all points give, one after the other,
//! without a tree, and what fractions of whole numbers say of it.

mod scene;

use crate::build_tree::{arrays, options};
use crate::source::Source;
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::snap;
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::points::build::PointOptions;
use splitplane_core::points::nearest::{NearestOptions, Neighbour};
use splitplane_core::points::tree::Axes;
use splitplane_core::query::cast::{Cast, CastOptions, CastSearch, Impact};
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions, slack};
use splitplane_core::query::overlap::{OverlapOptions, Plane, Volume};
use splitplane_core::ray::{Accuracy, Ray};
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_cpu::{CpuBackend, CpuPointTree};
use splitplane_test_support::{near, overlap, rational};

thread_local! {
    static BACKEND: CpuBackend = CpuBackend::new();
}

/// Queries of a batch: more than are under way at a time.
const BATCH: usize = 40;

/// Bytes as a mesh, a configuration and queries, for the CPU backend.
pub fn run(data: &[u8]) {
    crate::single_thread();
    run_on(data, |tree| tree, |scene| scene);
}

/// The same, with the tree and the scene given through functions that may add a fault.
pub fn run_on(
    data: &[u8],
    fault: impl Fn(Box<dyn Accelerator>) -> Box<dyn Accelerator>,
    scene_fault: impl Fn(Box<dyn SceneAccelerator>) -> Box<dyn SceneAccelerator>,
) {
    let source = &mut Source::new(data);
    let options = options(source);
    let soup = source.once_in(3);
    let (positions, indices) = arrays(source, soup);
    let triangles: Vec<Triangle>;
    let mesh = if soup {
        triangles = positions.as_chunks::<3>().0.to_vec();
        Mesh::soup(&triangles)
    } else {
        Mesh::indexed(&positions, &indices)
    };
    // What is refused is the business of `build_tree`.
    let Ok(mesh) = mesh else { return };
    let options = BuildOptions { max_memory: None, ..options };
    let Ok(tree) = BACKEND.with(|backend| backend.build(&mesh, &options)) else { return };
    let own = Own::new(&mesh, source);
    let tree = fault(tree);
    own.closest_points(&mesh, tree.as_ref(), source);
    own.overlaps(tree.as_ref(), source);
    own.casts(tree.as_ref(), source);
    nearest(&positions, source);
    BACKEND.with(|backend| scene::check(&own, &mesh, backend, scene_fault, source));
}

/// A mesh's triangles that count, and the box around them.
struct Own {
    triangles: Vec<(u32, Triangle)>,
    bounds: Aabb,
    /// A triangle that one query after the other ignores.
    ignore: Option<u32>,
}

impl Own {
    fn new(mesh: &Mesh<'_>, source: &mut Source<'_>) -> Own {
        let all = (0..mesh.len()).map(|index| (index as u32, prepare(&mesh.triangle(index))));
        let triangles: Vec<(u32, Triangle)> = all
            .filter(|(_, triangle)| triangle.kept)
            .map(|(index, own)| (index, own.corners))
            .collect();
        let corners: Vec<[f32; 3]> = triangles.iter().flat_map(|own| own.1).collect();
        let bounds = Aabb::of_points(&corners);
        let ignore = source.once_in(4).then(|| source.below(mesh.len() + 2) as u32);
        Own { triangles, bounds, ignore }
    }

    fn counted(&self) -> impl Iterator<Item = &(u32, Triangle)> {
        self.triangles.iter().filter(|own| self.ignore != Some(own.0))
    }

    /// Anywhere, a corner, the middle of an edge, or within a triangle.
    fn point(&self, source: &mut Source<'_>) -> [f32; 3] {
        if self.triangles.is_empty() || source.once_in(3) {
            return [(); 3].map(|()| source.number());
        }
        let (_, [a, b, c]) = self.triangles[source.below(self.triangles.len())];
        match source.below(4) {
            0 | 1 => a,
            2 => [0, 1, 2].map(|k| 0.5 * a[k] + 0.5 * b[k]),
            _ => [0, 1, 2].map(|k| 0.25 * a[k] + 0.5 * b[k] + 0.25 * c[k]),
        }
    }

    fn closest_points(&self, mesh: &Mesh<'_>, tree: &dyn Accelerator, source: &mut Source<'_>) {
        let points: Vec<[f32; 3]> = (0..1 + source.below(4)).map(|_| self.point(source)).collect();
        let max_distance = if source.once_in(3) { source.number() } else { f32::INFINITY };
        let options =
            ClosestPointOptions { max_distance, ignore: self.ignore, ..Default::default() };
        let batch: Vec<[f32; 3]> = points.iter().copied().cycle().take(BATCH).collect();
        let mut found = vec![ClosestPoint { triangle: 7, ..ClosestPoint::NONE }; BATCH];
        tree.closest_points(&batch, &mut found, &options).expect("equal lengths");
        for (point, found) in batch.iter().zip(&found) {
            assert_eq!(
                *found,
                near::closest_point(mesh, *point, &options),
                "{point:?} {options:?}"
            );
        }
        let exactly = ClosestPointOptions { accuracy: Accuracy::Exact, ..options };
        let mut exact = vec![ClosestPoint::NONE; points.len()];
        tree.closest_points(&points, &mut exact, &exactly).expect("equal lengths");
        for (point, own) in points.iter().zip(&exact) {
            let expected = near::nearest_triangle(mesh, *point, &exactly);
            assert_eq!(own.some().map(|own| own.triangle), expected, "{point:?} {exactly:?}");
        }
        let is_free = max_distance == f32::INFINITY;
        for (point, found) in points.iter().zip(&found).filter(|_| is_free) {
            let finite = point.iter().all(|x| x.is_finite());
            assert_eq!(found.is_some(), finite && self.counted().next().is_some(), "{point:?}");
            if let Some((_, corners)) = self.counted().find(|own| own.0 == found.triangle) {
                let point = prepare(&[*point; 3]).corners[0];
                let truth = rational::distance_squared(corners, point).sqrt();
                let computed = found.distance_squared.sqrt();
                let room = slack(point, &self.bounds);
                assert!(
                    (computed - truth).abs() <= room,
                    "{point:?}: {computed:e} is not {truth:e}, {corners:?}, {found:?}"
                );
            }
        }
    }

    fn overlaps(&self, tree: &dyn Accelerator, source: &mut Source<'_>) {
        let planes: Vec<Plane> = (0..source.below(6))
            .map(|_| Plane { normal: [(); 3].map(|()| source.finite()), offset: source.finite() })
            .collect();
        let mut volumes = vec![Volume::Planes(&planes)];
        for _ in 0..1 + source.below(5) {
            volumes.push(self.volume(source));
        }
        let options = OverlapOptions { ignore: self.ignore, ..OverlapOptions::default() };
        let found = tree.overlaps(&volumes, &options).expect("memory");
        let mut any = vec![false; volumes.len()];
        tree.overlaps_any(&volumes, &mut any, &options).expect("equal lengths");
        for (number, volume) in volumes.iter().enumerate() {
            let expected: Vec<u32> = match is_plain(volume) {
                true => {
                    let met = self.counted().filter(|own| overlap::meets(volume, &own.1));
                    met.map(|own| own.0).collect()
                }
                false => match odd_answer(volume) {
                    Some(true) => self.counted().map(|own| own.0).collect(),
                    Some(false) => Vec::new(),
                    None => found.of(number).to_vec(),
                },
            };
            assert_eq!(found.of(number), expected, "{volume:?}");
            assert_eq!(any[number], !expected.is_empty(), "{volume:?}");
        }
    }

    fn volume(&self, source: &mut Source<'_>) -> Volume<'static> {
        let [a, b, c] = [(); 3].map(|()| self.point(source));
        let radius = source.number();
        match source.below(5) {
            0 => Volume::Box(Aabb::of_points(&[a, b])),
            1 => Volume::Box(Aabb { lo: a, hi: b }),
            2 => Volume::Ball { centre: a, radius },
            3 => Volume::Capsule { from: a, to: b, radius },
            _ => Volume::Triangle([a, b, c]),
        }
    }

    fn casts(&self, tree: &dyn Accelerator, source: &mut Source<'_>) {
        let casts: Vec<Cast> = (0..1 + source.below(4)).map(|_| self.cast(source)).collect();
        let options = CastOptions { ignore: self.ignore, watch: None };
        let batch: Vec<Cast> = casts.iter().copied().cycle().take(BATCH).collect();
        let mut found = vec![Impact { t: 7.0, triangle: 7 }; BATCH];
        tree.impacts(&batch, &mut found, &options).expect("equal lengths");
        for (cast, found) in batch.iter().zip(&found) {
            let expected =
                CastSearch::new(cast, &self.bounds, &options).map_or(Impact::NONE, |mut search| {
                    for (triangle, corners) in &self.triangles {
                        search.test(corners, *triangle);
                    }
                    search.best()
                });
            assert_eq!(*found, expected, "{cast:?}");
        }
        for (cast, found) in casts.iter().zip(&found) {
            self.check_impact(cast, found);
        }
    }

    /// Where a ball is when it is said to touch it does, and on its way until then it touches nothing; with a radius that is off by
    /// what the documents say.
    fn check_impact(&self, cast: &Cast, found: &Impact) {
        let Cast { ray, axis, radius } = *cast;
        let finite = [ray.origin, ray.direction].as_flattened().iter().all(|x| x.is_finite());
        if axis != [0.0; 3] || !finite || !ray.t_min.is_finite() || !found.is_some() {
            return;
        }
        let at = |t: f32| {
            let way = |k: usize| f64::from(t) * f64::from(ray.direction[k]);
            [0, 1, 2].map(|k| (f64::from(ray.origin[k]) + way(k)) as f32)
        };
        let (start, end) = (at(ray.t_min), at(found.t));
        let numbers = [start, end, ray.origin, self.bounds.lo, self.bounds.hi, [radius; 3]];
        let most = numbers.as_flattened().iter().fold(0.0f32, |most, x| most.max(x.abs()));
        // Beyond these numbers squares of floats, and what is off by a part of them, are no floats.
        if !(1e-25..1e35).contains(&most) {
            return;
        }
        let error = most * 2.0f32.powi(-18);
        let own = self.counted().find(|own| own.0 == found.triangle);
        let own = own.expect("a triangle that counts").1;
        let touches = Volume::Ball { centre: end, radius: radius + error };
        assert!(overlap::meets(&touches, &own), "{cast:?} does not touch: {found:?}");
        if radius > error && found.t > ray.t_min {
            let way = Volume::Capsule { from: start, to: end, radius: radius - error };
            for (triangle, corners) in self.counted() {
                assert!(!overlap::meets(&way, corners), "{cast:?}: {found:?} after {triangle}");
            }
        }
    }

    fn cast(&self, source: &mut Source<'_>) -> Cast {
        let origin = self.point(source);
        let direction = match source.below(4) {
            0 => [(); 3].map(|()| source.number()),
            1 => [(); 3].map(|()| source.step()),
            _ => {
                let target = self.point(source);
                [0, 1, 2].map(|k| target[k] - origin[k])
            }
        };
        let mut ray = Ray::new(origin, direction);
        if source.once_in(4) {
            ray = ray.with_limits(source.number(), source.number());
        }
        let axis = if source.once_in(3) { [(); 3].map(|()| source.number()) } else { [0.0; 3] };
        let radius = if source.once_in(6) { source.number() } else { source.step().abs() };
        Cast { ray, axis, radius }
    }
}

/// True where all numbers are finite, and a box and a radius are what they must be.
fn is_plain(volume: &Volume<'_>) -> bool {
    let finite = |points: &[[f32; 3]]| points.as_flattened().iter().all(|x| x.is_finite());
    match *volume {
        Volume::Box(bounds) => finite(&[bounds.lo, bounds.hi]) && is_ordered(&bounds),
        Volume::Ball { centre, radius } => finite(&[centre, [radius; 3]]) && radius >= 0.0,
        Volume::Capsule { from, to, radius } => finite(&[from, to, [radius; 3]]) && radius >= 0.0,
        Volume::Triangle(corners) => finite(&corners),
        _ => true,
    }
}

/// Sides as they count: two that are smaller than normal numbers are one.
fn is_ordered(bounds: &Aabb) -> bool {
    (0..3).all(|k| snap(bounds.lo[k]) <= snap(bounds.hi[k]))
}

/// What an odd volume meets: everything, nothing, or `None` where that depends on its sides.
fn odd_answer(volume: &Volume<'_>) -> Option<bool> {
    let finite = |points: &[[f32; 3]]| points.as_flattened().iter().all(|x| x.is_finite());
    match *volume {
        Volume::Ball { centre, radius } => Some(finite(&[centre]) && radius == f32::INFINITY),
        Volume::Capsule { from, to, radius } => {
            Some(finite(&[from, to]) && radius == f32::INFINITY)
        }
        Volume::Box(bounds) => (!is_ordered(&bounds)).then_some(false),
        _ => Some(false),
    }
}

/// The nearest of the mesh's vertices.
fn nearest(points: &[[f32; 3]], source: &mut Source<'_>) {
    let axes = source.pick(&[Axes::Widest, Axes::Cycle]);
    let options = PointOptions { axes, ..PointOptions::default() };
    let tree = CpuPointTree::build(points, &options).expect("memory");
    let k = 1 + source.below(24);
    let max_distance = if source.once_in(3) { source.number() } else { f32::INFINITY };
    let odd = |point: u32| point % 2 == 1;
    let by_parity: &(dyn Fn(u32) -> bool + Sync) = &odd;
    let filter = source.once_in(3).then_some(by_parity);
    let options = NearestOptions { k, max_distance, filter, ..NearestOptions::default() };
    let queries: Vec<[f32; 3]> = (0..1 + source.below(4))
        .map(|_| match points.len() {
            0 => [0.5; 3],
            _ if source.once_in(2) => points[source.below(points.len())],
            _ => [(); 3].map(|()| source.number()),
        })
        .collect();
    let batch: Vec<[f32; 3]> = queries.iter().copied().cycle().take(BATCH).collect();
    let mut found = vec![Neighbour { distance_squared: -1.0, point: 7 }; BATCH * k];
    tree.nearest(&batch, &mut found, &options).expect("equal lengths");
    for (query, found) in batch.iter().zip(found.chunks(k)) {
        let mut expected = near::neighbours(points, *query, max_distance);
        expected.retain(|found| filter.is_none_or(|filter| filter(found.point)));
        assert_eq!(tree.within(*query, &options).expect("memory"), expected, "{query:?}");
        expected.resize(k.max(expected.len()), Neighbour::NONE);
        assert_eq!(found, &expected[..k], "{query:?} {options:?}");
    }
}
