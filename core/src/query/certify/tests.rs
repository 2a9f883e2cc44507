//! Certain answers are right: against `crate::exact`, triangle by triangle and ray by ray, and with
//! injected faults.

use alloc::vec;
use alloc::vec::Vec;
use core::cmp::Ordering;

use super::*;
use crate::aabb::Aabb;
use crate::arithmetic::{Hostile, Strict, power_of_two};
use crate::config::BuildConfig;
use crate::exact::{ExactRay, meet};
use crate::query::all_hits::{AllHitsOptions, all_hits};
use crate::query::inside::{DIRECTION, boundary_rays};
use crate::query::intersect::Limits;
use crate::query::traverse::exact;
use crate::tree::KdTree;
use crate::tree::node::KdNode;
use crate::triangle::prepare;

/// A small generator: numbers of the given kind.
struct Numbers(u32);

impl Numbers {
    fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        self.0 ^ self.0 >> 16
    }

    /// From -1 to 1; halves from -4 to 4, where much is degenerate; neighbours of 1; of any
    /// magnitude that is in range.
    fn float(&mut self, kind: u32) -> f32 {
        let unit = (self.bits() >> 8) as f32 / 8_388_608.0 - 1.0;
        let bits = self.bits();
        match kind % 4 {
            0 => unit,
            1 => (bits % 17) as f32 * 0.5 - 4.0,
            2 => f32::from_bits(1.0f32.to_bits() + bits % 16),
            _ => scale(unit, (bits % 60) as i32 - 30),
        }
    }

    fn point(&mut self, kind: u32) -> [f32; 3] {
        core::array::from_fn(|_| self.float(kind))
    }

    /// Triangles, some of them twice, in another order, or beside one another in a plane.
    fn triangles(&mut self, kind: u32, count: usize) -> Vec<Triangle> {
        let mut all: Vec<Triangle> = Vec::new();
        while all.len() < count {
            let [a, b, c] = core::array::from_fn(|_| self.point(kind));
            let before = all.last().copied().unwrap_or([a, b, c]);
            all.push(match self.bits() % 8 {
                0 => before,
                1 => [before[1], before[2], before[0]],
                2 => [before[2], before[1], c],
                3 => {
                    let level = |p: [f32; 3]| [before[0][0], p[1], p[2]];
                    [level(a), level(b), level(c)]
                }
                _ => [a, b, c],
            });
        }
        all.retain(|corners| prepare(corners).kept);
        all
    }

    /// Rays at random, at corners, at edges, at points of triangles, along axes, with limits of all kinds.
    fn ray(&mut self, kind: u32, triangles: &[Triangle]) -> Ray {
        let origin = self.point(kind);
        let corners = triangles[self.bits() as usize % triangles.len()];
        let weight = self.float(0).abs();
        let mixed = |a: f32, b: f32| a + weight * (b - a);
        let edge = core::array::from_fn(|k| mixed(corners[0][k], corners[1][k]));
        let inside: [f32; 3] = core::array::from_fn(|k| 0.5 * (edge[k] + corners[2][k]));
        let towards = |p: [f32; 3]| core::array::from_fn(|k| p[k] - origin[k]);
        let direction = match self.bits() % 6 {
            0 => self.point(kind),
            1 => towards(corners[self.bits() as usize % 3]),
            2 => towards(edge),
            3 => towards(inside),
            4 => towards(corners[0]).map(|x: f32| if x.abs() < 0.7 { 0.0 } else { x }),
            _ => core::array::from_fn(|k| if k == self.0 as usize % 3 { 1.0 } else { 0.0 }),
        };
        let ray = Ray::new(origin, direction);
        match self.bits() % 4 {
            0 => ray.with_limits(-1.0, 1.0),
            1 => ray.with_limits(f32::MIN_POSITIVE, f32::MAX),
            2 => Ray { origin: inside, ..ray },
            _ => ray,
        }
    }
}

/// Triangles under one leaf, and what queries know of them.
struct Scene {
    tree: KdTree,
    triangles: Vec<Triangle>,
    scale: SceneScale,
}

impl Scene {
    fn new(triangles: Vec<Triangle>) -> Scene {
        let bounds = Aabb::of_points(triangles.as_flattened());
        let limits = triangles.iter().fold(Limits::NONE, |l, t| l.union(Limits::of(t)));
        let count = triangles.len() as u32;
        let tree = KdTree {
            nodes: vec![KdNode::leaf(0, count)],
            references: (0..count).collect(),
            bounds,
            triangles: count,
            config: BuildConfig::default(),
        };
        Scene { tree, scale: SceneScale::new(bounds, &limits), triangles }
    }

    fn certain<A: Arithmetic>(
        &self,
        ray: &Ray,
        options: &QueryOptions<'_>,
        query: Query,
        same: impl Fn(&Triangle, &Triangle) -> bool,
    ) -> Hit {
        let (tree, triangles) = (self.tree.view(), &self.triangles[..]);
        trace_with::<A>(&tree, triangles, &self.scale, ray, options, query, same)
    }

    fn exact(&self, ray: &Ray, options: &QueryOptions<'_>) -> Hit {
        let (tree, triangles) = (self.tree.view(), &self.triangles[..]);
        exact::closest_hit(&tree, triangles, ray, options).unwrap_or(Hit::MISS)
    }
}

/// The outcomes of many rays.
#[derive(Debug, Default)]
struct Tally {
    rays: u32,
    hits: u32,
    undecided: u32,
    wrong: u32,
}

/// Compares decided rays with the exact traversal, closest hit and any hit.
fn tally<A: Arithmetic>(rounds: u32, same: impl Fn(&Triangle, &Triangle) -> bool + Copy) -> Tally {
    let mut tally = Tally::default();
    for round in 0..rounds {
        let mut numbers = Numbers(round);
        let scene = Scene::new(numbers.triangles(round, 12));
        let culling = [Culling::None, Culling::None, Culling::Back, Culling::Front];
        let ignore = (round % 7 == 0).then_some(3);
        let options = QueryOptions {
            culling: culling[round as usize / 4 % 4],
            ignore,
            ..QueryOptions::default()
        };
        for _ in 0..30 {
            let ray = numbers.ray(round, &scene.triangles);
            let expected = scene.exact(&ray, &options);
            let found = scene.certain::<A>(&ray, &options, Query::Closest, same);
            tally.rays += 1;
            tally.hits += u32::from(expected.is_hit());
            if found.triangle == Hit::UNDECIDED {
                tally.undecided += 1;
                // No hit lies before anything undecided.
                tally.wrong += u32::from(expected.is_hit() && expected.t < found.t);
            } else {
                tally.wrong += u32::from(found.triangle != expected.triangle);
            }
            let any = scene.certain::<A>(&ray, &options, Query::Any, same);
            let told = any.triangle != Hit::UNDECIDED;
            tally.wrong += u32::from(told && any.is_hit() != expected.is_hit());
        }
    }
    tally
}

#[test]
fn decided_rays_have_the_exact_hit() {
    for tally in [tally::<Strict>(1_200, in_one_plane), tally::<Hostile>(1_200, in_one_plane)] {
        assert_eq!(tally.wrong, 0, "{tally:?}");
        assert!(tally.hits * 3 > tally.rays, "{tally:?}");
        // Most are aimed at corners, edges and duplicates.
        assert!(tally.undecided > 100 && tally.undecided * 2 < tally.rays, "{tally:?}");
    }
}

/// Arithmetic that errs by 2^-15 where the bounds count on 2^-24: bounds too small by so much.
#[derive(Clone, Copy, Debug)]
struct Sloppy;

fn coarse(x: f32) -> f32 {
    f32::from_bits(x.to_bits() & !0x1ff)
}

impl Arithmetic for Sloppy {
    fn product(a: f32, b: f32) -> f32 {
        coarse(a * b)
    }
    fn sum(a: f32, b: f32) -> f32 {
        coarse(a + b)
    }
    fn difference(a: f32, b: f32) -> f32 {
        coarse(a - b)
    }
    fn quotient(a: f32, b: f32) -> f32 {
        coarse(a / b)
    }
    fn two_product(a: f32, b: f32) -> (f32, f32) {
        Strict::two_product(a, b)
    }
    fn free_mul(a: f32, b: f32) -> f32 {
        a * b
    }
    fn free_mul_add(a: f32, b: f32, c: f32) -> f32 {
        a * b + c
    }
    fn free_sub(a: f32, b: f32) -> f32 {
        a - b
    }
    fn free_reciprocal(a: f32) -> f32 {
        1.0 / a
    }
}

#[test]
fn planted_faults_are_seen() {
    assert!(tally::<Sloppy>(200, in_one_plane).wrong > 10);
}

/// Two planes that cross at a slope of 2^-20, met next to where they cross.
#[test]
fn close_triangles_are_told_apart_or_left_open() {
    let slope = power_of_two(-20);
    let level = [[-1.0, -1.0, 0.0], [3.0, -1.0, 0.0], [-1.0, 3.0, 0.0]];
    let tilted = level.map(|[x, y, _]: [f32; 3]| [x, y, slope * x]);
    let scene = Scene::new(vec![level, tilted]);
    let options = QueryOptions::default();
    let (mut open, mut wrong, mut wrong_with_fault) = (0, 0, 0);
    for power in 4..40 {
        let ray = Ray::new([power_of_two(-power), 0.125, 1.0], [0.0, 0.0, -1.0]);
        assert_eq!(scene.exact(&ray, &options).triangle, 1);
        let found = scene.certain::<Strict>(&ray, &options, Query::Closest, in_one_plane);
        open += u32::from(found.triangle == Hit::UNDECIDED);
        wrong += u32::from(found.triangle == 0);
        // All that lies close together taken for one plane.
        let fault = scene.certain::<Strict>(&ray, &options, Query::Closest, |_, _| true);
        wrong_with_fault += u32::from(fault.triangle == 0);
    }
    assert_eq!((wrong, wrong_with_fault), (0, open));
    assert!((15..25).contains(&open), "{open}");
}

/// Taking undecided triangles for misses loses hits.
#[test]
fn doubt_cannot_be_ignored() {
    let (mut lost, mut doubts) = (0, 0);
    for round in 0..2_000 {
        let mut numbers = Numbers(round);
        let triangles = numbers.triangles(round, 4);
        if triangles.is_empty() {
            continue;
        }
        let scene = Scene::new(triangles);
        let ray = numbers.ray(round, &scene.triangles);
        let (Some(exact), Some(prepared)) =
            (ExactRay::new(&ray), PreparedRay::new::<Strict>(&ray, &scene.scale))
        else {
            continue;
        };
        if !is_as_given(&ray, &prepared) {
            continue;
        }
        for corners in &scene.triangles {
            let met = meet(&exact, corners, Culling::None);
            let within = met.is_some_and(|met| met.is_within_limits());
            match examine::<Strict>(&prepared, corners, Culling::None, f32::INFINITY) {
                Verdict::Not => assert!(!within, "{ray:?} {corners:?}"),
                Verdict::InDoubt(least) => {
                    doubts += 1;
                    lost += u32::from(within);
                    let inner = scale(least, -prepared.exponent);
                    assert!(!within || met.unwrap().compare_limit(inner) != Ordering::Less);
                }
                Verdict::Met(certain) => {
                    assert!(within, "{ray:?} {corners:?}");
                    let unit = f64::from(power_of_two(-prepared.exponent));
                    let t = (f64::from(certain.t.high) + f64::from(certain.t.low)) * unit;
                    let error = f64::from(certain.error) * unit;
                    // The exact distance is within f64's own interval of it.
                    let (least, most) = met.unwrap().t_interval();
                    assert!(t - error <= most && t + error >= least, "{ray:?} {corners:?}");
                }
            }
        }
    }
    assert!(lost > 20 && doubts > lost, "{lost} of {doubts}");
}

/// Rays that are moved, or out of range, are left to others at once.
#[test]
fn far_and_extreme_rays_are_undecided() {
    let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let at = |factor: f32, ray: Ray| {
        let scene = Scene::new(vec![triangle.map(|p| p.map(|x| x * factor))]);
        let options = QueryOptions::default();
        let hit = scene.certain::<Strict>(&ray, &options, Query::Closest, in_one_plane);
        assert!(scene.exact(&ray, &options).is_hit());
        hit.triangle
    };
    let ray = |height: f32| Ray::new([0.25, 0.25, height], [0.0, 0.0, -1.0]);
    assert_eq!(at(1.0, ray(1.0)), 0);
    assert_eq!(at(1.0, ray(1e5)), Hit::UNDECIDED);
    assert_eq!(at(1.0, Ray { direction: [1e-36, 0.0, -1.0], ..ray(1.0) }), Hit::UNDECIDED);
    assert_eq!(at(1.0, Ray { origin: [0.25, 1e-30, 1.0], ..ray(1.0) }), Hit::UNDECIDED);
    assert_eq!(at(1e30, Ray { origin: [2e29, 2e29, 1e30], ..ray(1.0) }), Hit::UNDECIDED);
}

/// How many triangles are crossed, or hold the origin, and how many of them a list lacks; and how many lists there are.
fn listed<A: Arithmetic>(rounds: u32) -> [u32; 3] {
    let [mut wanted, mut lacking, mut lists] = [0; 3];
    for round in 0..rounds {
        let mut numbers = Numbers(round);
        let triangles = numbers.triangles(round, 12);
        if triangles.is_empty() {
            continue;
        }
        let scene = Scene::new(triangles);
        let (tree, triangles) = (scene.tree.view(), &scene.triangles[..]);
        let culling = [Culling::None, Culling::Back, Culling::Front][round as usize / 4 % 3];
        let ignore = (round % 7 == 0).then_some(3);
        for _ in 0..20 {
            let mut ray = numbers.ray(round, triangles);
            if numbers.bits().is_multiple_of(4) {
                ray = Ray::new(ray.origin, DIRECTION);
            }
            let options = QueryOptions { culling, ignore, ..QueryOptions::default() };
            let mut found = Vec::new();
            if !list::<A>(&tree, triangles, &scene.scale, &ray, &options, |t| found.push(t)) {
                assert!(found.is_empty());
                continue;
            }
            lists += 1;
            let mut lacks = |triangle: u32| {
                wanted += 1;
                lacking += u32::from(!found.contains(&triangle));
            };
            let mut crossings = Vec::new();
            let all = AllHitsOptions { culling, ignore, ..AllHitsOptions::default() };
            all_hits(&tree, triangles, &ray, &all, &mut crossings).expect("memory");
            crossings.iter().for_each(|met| lacks(met.hit.triangle));
            let from_origin = ray.t_min <= 0.0 && ray.t_max >= 0.0;
            if culling == Culling::None && from_origin && ExactRay::new(&ray).is_some() {
                for along in boundary_rays(ray.origin) {
                    crossings.clear();
                    exact::visit(&tree, triangles, &along, &options, &mut (), |ray, corners, t| {
                        let met = meet(ray, corners, Culling::None);
                        if met.is_some_and(|met| met.is_within_limits()) {
                            lacks(t);
                        }
                        f64::INFINITY
                    });
                }
            }
        }
    }
    [wanted, lacking, lists]
}

#[test]
fn lists_have_all_that_is_crossed_and_all_that_holds_the_origin() {
    for [wanted, lacking, lists] in [listed::<Strict>(1_200), listed::<Hostile>(1_200)] {
        assert_eq!(lacking, 0);
        assert!(wanted > 15_000 && lists > 15_000, "{wanted} triangles, {lists} lists");
    }
    let [wanted, lacking, _] = listed::<Sloppy>(300);
    assert!(lacking > 10, "{lacking} of {wanted}");
}

/// Rays whose crossings were counted, those that were left, crossings counted, and counts that are not those of all hits, or of
/// a ray whose origin a triangle holds.
fn counts<A: Arithmetic>(rounds: u32) -> [u32; 4] {
    let [mut decided, mut left, mut crossed, mut wrong] = [0; 4];
    for round in 0..rounds {
        let mut numbers = Numbers(round);
        let triangles = numbers.triangles(round, if round % 64 == 0 { 120 } else { 12 });
        if triangles.is_empty() {
            continue;
        }
        let mut scene = Scene::new(triangles);
        // Each in two leaves, as it were.
        scene.tree.references.extend(0..scene.tree.triangles);
        scene.tree.nodes = vec![KdNode::leaf(0, 2 * scene.tree.triangles)];
        let (tree, triangles) = (scene.tree.view(), &scene.triangles[..]);
        let culling = [Culling::None, Culling::Back, Culling::Front][round as usize / 4 % 3];
        let ignore = (round % 7 == 0).then_some(3);
        for _ in 0..20 {
            let mut ray = numbers.ray(round, triangles);
            if numbers.bits().is_multiple_of(4) {
                ray = Ray::new(ray.origin, DIRECTION);
            }
            let options = QueryOptions { culling, ignore, ..QueryOptions::default() };
            let Counted::Crossed(found) =
                count::<A>(&tree, triangles, &scene.scale, &ray, &options)
            else {
                left += 1;
                continue;
            };
            (decided, crossed) = (decided + 1, crossed + found[0] + found[1]);
            let mut crossings = Vec::new();
            let all = AllHitsOptions { culling, ignore, ..AllHitsOptions::default() };
            all_hits(&tree, triangles, &ray, &all, &mut crossings).expect("memory");
            let front = crossings.iter().filter(|met| met.front).count();
            wrong += u32::from(found.map(|side| side as usize) != [front, crossings.len() - front]);
            // From the origin on.
            if culling == Culling::None && ray.t_min == 0.0 && ExactRay::new(&ray).is_some() {
                for along in boundary_rays(ray.origin) {
                    exact::visit(&tree, triangles, &along, &options, &mut (), |ray, corners, _| {
                        let met = meet(ray, corners, Culling::None);
                        wrong += u32::from(met.is_some_and(|met| met.is_within_limits()));
                        f64::INFINITY
                    });
                }
            }
        }
    }
    [decided, left, crossed, wrong]
}

#[test]
fn counts_are_those_of_all_hits() {
    for [decided, left, crossed, wrong] in [counts::<Strict>(1_200), counts::<Hostile>(1_200)] {
        assert_eq!(wrong, 0);
        assert!(decided > 10_000 && crossed > 3_000, "{decided}, {left} left, {crossed} crossed");
    }
    let [decided, _, _, wrong] = counts::<Sloppy>(300);
    assert!(wrong > 10, "{wrong} of {decided}");
}

/// As many as are known at most, and one more.
#[test]
fn what_is_counted_has_a_limit() {
    for (triangles, expected) in [
        (MOST_COUNTED as u32, Counted::Crossed([MOST_COUNTED as u32, 0])),
        (MOST_COUNTED as u32 + 1, Counted::Undecided),
    ] {
        let at = |z: u32| [[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]].map(|[x, y]| [x, y, z as f32]);
        let scene = Scene::new((0..triangles).map(at).collect());
        let ray = Ray::new([1.0, 1.0, 99.0], [0.0, 0.0, -1.0]);
        let options = QueryOptions::default();
        let (tree, triangles) = (scene.tree.view(), &scene.triangles[..]);
        let found = count::<Strict>(&tree, triangles, &scene.scale, &ray, &options);
        assert_eq!(found, expected);
    }
}

/// Records of rays whose triangle is certain: how many there are, how many are certain to the last bit, and how many of
/// those are not the exact hit's.
fn records<A: Arithmetic>(rounds: u32) -> [u32; 3] {
    let [mut hits, mut certain, mut wrong] = [0; 3];
    let options = QueryOptions::default();
    for round in 0..rounds {
        let mut numbers = Numbers(round);
        // Some are seen from so far off that they are small.
        let small = power_of_two(-(numbers.bits() as i32 & 15));
        let mut triangles = numbers.triangles(round, 6);
        if round % 3 == 0 {
            triangles = triangles.iter().map(|t| t.map(|p| p.map(|x| x * small))).collect();
        }
        triangles.retain(|corners| prepare(corners).kept);
        if triangles.is_empty() {
            continue;
        }
        let scene = Scene::new(triangles);
        for _ in 0..60 {
            let ray = numbers.ray(round, &scene.triangles);
            let found = scene.certain::<A>(&ray, &options, Query::Closest, in_one_plane);
            if !found.is_hit() {
                continue;
            }
            let corners = scene.triangles[found.triangle as usize];
            let exact = meet(&ExactRay::new(&ray).unwrap(), &corners, options.culling);
            // What a wrong arithmetic finds need not be met at all.
            let Some(exact) = exact.map(|met| met.hit(found.triangle)) else { continue };
            hits += 1;
            if let Some(record) = record::<A>(&ray, &corners, found.triangle) {
                certain += 1;
                let bits = |hit: Hit| [hit.t, hit.u, hit.v].map(f32::to_bits);
                wrong += u32::from(bits(record) != bits(exact));
            }
        }
    }
    [hits, certain, wrong]
}

#[test]
fn records_that_are_certain_are_the_exact_ones() {
    for [hits, certain, wrong] in [records::<Strict>(3_000), records::<Hostile>(1_000)] {
        assert_eq!(wrong, 0, "{hits} {certain}");
        // Those at corners and edges, or of whole coordinates, have weights of which the last bit is chance.
        assert!(certain * 10 > hits * 3 && certain > 5_000, "{hits} {certain}");
    }
    let [_, certain, wrong] = records::<Sloppy>(500);
    assert!(wrong > 10, "{certain}");
}
