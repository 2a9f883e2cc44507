//! Visits along a ray, compared with all leaves of a tree, one by one, in whole numbers: which
//! leaves a ray meets, from where to where, and in which order.

use core::ops::ControlFlow;

use crate::common::tree_of;
use splitplane_core::aabb::Aabb;
use splitplane_core::config::Preset;
use splitplane_core::exact::ExactRay;
use splitplane_core::query::along::LeafAlong;
use splitplane_core::query::traverse::exact::Best;
use splitplane_core::query::traverse::{Query, Triangles};
use splitplane_core::ray::{Culling, Hit, QueryOptions, Ray};
use splitplane_core::tree::KdTree;
use splitplane_core::tree::node::NodeKind;
use splitplane_test_support::oracle::Oracle;
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};

const FAR: f64 = f64::INFINITY;

/// A leaf, found by recursion.
struct Cell {
    node: u32,
    bounds: Aabb,
    triangles: Vec<u32>,
    /// The split planes above it: axis, position, whether it is on the upper side.
    path: Vec<(usize, f32, bool)>,
}

fn cells(tree: &KdTree, node: u32, bounds: Aabb, path: &[(usize, f32, bool)], out: &mut Vec<Cell>) {
    match tree.nodes[node as usize].kind() {
        NodeKind::Leaf { first, count } => {
            let triangles = tree.references[first as usize..][..count as usize].to_vec();
            out.push(Cell { node, bounds, triangles, path: path.to_vec() });
        }
        NodeKind::Interior { axis, split, right } => {
            for (child, upper) in [(node + 1, false), (right, true)] {
                let mut part = bounds;
                let side = if upper { &mut part.lo } else { &mut part.hi };
                side[axis.index()] = split;
                let path: Vec<_> =
                    path.iter().copied().chain([(axis.index(), split, upper)]).collect();
                cells(tree, child, part, &path, out);
            }
        }
    }
}

/// A float in units of 2^-64, if it is a whole number of them and not too large.
fn whole(x: f32) -> Option<i128> {
    let scaled = f64::from(x) * 2f64.powi(64);
    (scaled.fract() == 0.0 && scaled.abs() < 2f64.powi(80)).then_some(scaled as i128)
}

/// A quotient, its denominator above 0: a distance in units of the direction, which is in units of 2^-10.
#[derive(Clone, Copy, Debug)]
struct Fraction(i128, i128);

impl Fraction {
    fn less(self, other: Fraction) -> bool {
        self.0 * other.1 < other.0 * self.1
    }

    fn float(self) -> f64 {
        self.0 as f64 / self.1 as f64 / 2f64.powi(54)
    }
}

/// The part of a ray in a closed box, in whole numbers; with the slack of `f64` it may also be next to it.
fn interval(cell: &Aabb, ray: &Ray) -> Option<(Fraction, Fraction)> {
    let at = |t: f32| Fraction((f64::from(t) * 2f64.powi(54)) as i128, 1);
    let (mut enter, mut exit) = (at(ray.t_min), at(ray.t_max.min(1024.0)));
    for axis in 0..3 {
        let [lo, hi, origin] =
            [cell.lo, cell.hi, ray.origin].map(|p| whole(p[axis]).expect("a coordinate in range"));
        let direction = (ray.direction[axis] * 1024.0) as i128;
        if direction == 0 {
            if origin < lo || hi < origin {
                return None;
            }
            continue;
        }
        let end = |plane: i128| {
            let sign = direction.signum();
            Fraction((plane - origin) * sign, direction * sign)
        };
        let [near, far] = if direction > 0 { [end(lo), end(hi)] } else { [end(hi), end(lo)] };
        enter = if enter.less(near) { near } else { enter };
        exit = if far.less(exit) { far } else { exit };
    }
    Some((enter, exit))
}

/// Scenes with degenerate, coplanar and odd meshes, and trees that the whole numbers can hold.
fn trees() -> Vec<(Scene, KdTree, Vec<Cell>)> {
    let mut trees = Vec::new();
    for scene in scenes::awkward() {
        for preset in [Preset::Fast, Preset::Balanced, Preset::Best] {
            let tree = tree_of(&scene, preset);
            let mut leaves = Vec::new();
            cells(&tree, 0, tree.bounds, &[], &mut leaves);
            let in_range = |cell: &Cell| {
                let Aabb { lo, hi } = cell.bounds;
                lo.iter().chain(&hi).all(|&x| x.abs() < 100.0 && whole(x).is_some())
            };
            if !tree.bounds.is_empty() && leaves.iter().all(in_range) {
                trees.push((scene.clone(), tree, leaves));
            }
        }
    }
    assert!(trees.len() > 40, "{}", trees.len());
    assert!(trees.iter().any(|(_, tree, _)| tree.bounds.half_extent(2) == 0.0), "a flat one");
    trees
}

/// Rays from corners, faces and anywhere, along axes, diagonals and anything, whose numbers are in range. Many
/// run within split planes, along edges of cells and through their corners, in the planes of triangles.
fn rays(tree: &KdTree, leaves: &[Cell], random: &mut Random, count: usize) -> Vec<Ray> {
    let short = |x: f32| (x * 1048576.0).round() / 1048576.0;
    let ray = |_| {
        let cell = &leaves[random.below(leaves.len())].bounds;
        let mut origin = [0.0f32; 3];
        for axis in 0..3 {
            let (lo, hi) = (cell.lo[axis], cell.hi[axis]);
            let all = [tree.bounds.lo[axis], tree.bounds.hi[axis]];
            let between = short(lo + (hi - lo) * random.unit() as f32);
            origin[axis] = random.pick(&[lo, hi, between, between, all[0], all[1]]);
        }
        let kind = random.below(3);
        let mut direction = [0.0f32; 3];
        while direction == [0.0; 3] {
            direction = [(); 3].map(|()| match kind {
                0 => random.pick(&[-1.0, 0.0, 0.0, 1.0]),
                1 => random.pick(&[-1.0, 0.0, 1.0, 2.0, 0.5]),
                _ => (random.signed() * 1024.0).round() / 1024.0,
            });
        }
        // Back along the direction, so that many begin outside; without rounding.
        let back = random.pick(&[0.0f32, 0.0, 1.0, 4.0]);
        for axis in 0..3 {
            let moved = origin[axis] - back * direction[axis];
            let exact = f64::from(origin[axis]) - f64::from(back * direction[axis]);
            origin[axis] = if f64::from(moved) == exact { moved } else { short(moved) };
        }
        let limits = random.pick(&[[0.0, f32::INFINITY], [0.25, 1.5], [-2.0, 2.0], [1.0, 1.0]]);
        Ray::new(origin, direction).with_limits(limits[0], limits[1])
    };
    (0..count).map(ray).filter(|ray| ray.origin.iter().all(|&x| whole(x).is_some())).collect()
}

/// Nodes and intervals of the leaves that are visited.
fn visited(tree: &KdTree, ray: &Ray) -> Vec<(u32, f64, f64)> {
    let mut list = Vec::new();
    tree.visit_along(ray, |leaf| {
        list.push((leaf.node, leaf.t_enter, leaf.t_exit));
        ControlFlow::Continue(FAR)
    });
    list
}

#[test]
fn all_leaves_on_the_way_are_visited_near_to_far() {
    let mut random = Random::new(1);
    let (mut met, mut in_planes, mut touched) = (0, 0, 0);
    for (scene, tree, leaves) in &trees() {
        for ray in rays(tree, leaves, &mut random, 60) {
            let found = visited(tree, &ray);
            let name = || format!("{} {ray:?}", scene.name);
            // Whether a split plane holds the ray.
            let holds = |&(axis, split, _): &(usize, f32, bool)| {
                ray.direction[axis] == 0.0 && ray.origin[axis] == split
            };
            // Each side of a plane before the other, as the direction has it: no two leaves are
            // ordered otherwise.
            let mut order: Vec<&Cell> = leaves.iter().collect();
            order.sort_by_key(|cell| {
                let side =
                    |&(axis, _, upper): &(usize, f32, bool)| upper != (ray.direction[axis] < 0.0);
                cell.path.iter().map(side).collect::<Vec<bool>>()
            });
            let mut latest = Fraction(i128::from(i64::MIN), 1);
            let mut next = found.iter().peekable();
            for cell in order {
                let exactly = interval(&cell.bounds, &ray);
                let Some(&(_, t_enter, t_exit)) = next.next_if(|found| found.0 == cell.node) else {
                    let missed = exactly.is_none_or(|(enter, exit)| exit.less(enter));
                    assert!(missed, "{}: {:?}", name(), cell.bounds);
                    continue;
                };
                let (enter, exit) = exactly.unwrap_or_else(|| panic!("{}: beside it", name()));
                let (first, last) = (enter.float(), exit.float());
                let slack = first.abs().max(last.abs()) * 2f64.powi(-48);
                assert!(t_enter <= t_exit && first <= last + slack, "{}", name());
                assert!(t_enter <= first && first <= t_enter + slack, "{} {first}", name());
                if last < 1024.0 {
                    assert!(last <= t_exit && t_exit <= last + slack, "{} {last}", name());
                }
                let in_plane = cell.path.iter().any(holds);
                in_planes += u32::from(in_plane);
                if !exit.less(enter) && !leaves.iter().any(|cell| cell.path.iter().any(holds)) {
                    assert!(!enter.less(latest), "{}", name());
                    latest = enter;
                }
                met += 1;
                touched += u32::from(!enter.less(exit));
            }
            assert_eq!(next.next(), None, "{}: a leaf that is not there, or out of order", name());
        }
    }
    assert!(met > 10_000 && in_planes > 1_500 && touched > 1_500, "{met} {in_planes} {touched}");
}

/// What is handed over are the references of the leaf.
#[test]
fn leaves_come_with_their_triangles() {
    let mut random = Random::new(2);
    for (_, tree, leaves) in &trees() {
        for ray in rays(tree, leaves, &mut random, 5) {
            tree.view().visit_along(&ray, |leaf| {
                let cell = leaves.iter().find(|cell| cell.node == leaf.node).expect("a leaf");
                assert_eq!(leaf.triangles, cell.triangles);
                ControlFlow::Continue(FAR)
            });
        }
    }
}

#[test]
fn a_shortened_ray_passes_what_begins_before_its_end_and_a_break_ends_it() {
    let mut random = Random::new(3);
    let (mut fewer, mut broken) = (0, 0);
    for (_, tree, leaves) in &trees() {
        for ray in rays(tree, leaves, &mut random, 20) {
            let all = visited(tree, &ray);
            let Some(&(_, first, _)) = all.first() else { continue };
            let (_, at, until) = random.pick(&all);
            for end in [at, until, first, first - 1.0] {
                let mut list = Vec::new();
                tree.visit_along(&ray, |leaf| {
                    list.push((leaf.node, leaf.t_enter, leaf.t_exit));
                    // It stays as short as it was.
                    ControlFlow::Continue(if list.len() == 1 {
                        end
                    } else {
                        random.pick(&[FAR, f64::NAN])
                    })
                });
                let expected = all.iter().enumerate().filter(|(i, leaf)| *i == 0 || leaf.1 <= end);
                assert_eq!(list, expected.map(|(_, leaf)| *leaf).collect::<Vec<_>>());
                fewer += u32::from(list.len() < all.len());
            }
            let stop = random.below(all.len());
            let mut list = Vec::new();
            tree.visit_along(&ray, |leaf| {
                list.push((leaf.node, leaf.t_enter, leaf.t_exit));
                if list.len() > stop { ControlFlow::Break(()) } else { ControlFlow::Continue(FAR) }
            });
            assert_eq!(list, all[..=stop]);
            broken += u32::from(stop + 1 < all.len());
        }
    }
    assert!(fewer > 1_000 && broken > 300, "{fewer} {broken}");
}

/// A closest-hit query of one's own, against an oracle that asks every triangle.
#[test]
fn the_nearest_hit_is_found() {
    let mut random = Random::new(4);
    let options = QueryOptions::default();
    let mut hits = 0;
    for (scene, tree, leaves) in &trees() {
        let (mesh, oracle) = (scene.mesh(), Oracle::new(&scene.mesh()));
        for ray in rays(tree, leaves, &mut random, 40) {
            let (exact, mut best) = (ExactRay::new(&ray).expect("a ray"), Best::default());
            tree.visit_along(&ray, |leaf: LeafAlong<'_>| {
                let mut stop = best.stop();
                for &triangle in leaf.triangles {
                    let corners = mesh.corners(triangle);
                    stop = best.test(&exact, &corners, triangle, Culling::None, Query::Closest);
                }
                ControlFlow::Continue(stop)
            });
            let expected = oracle.nearest(&ray, &options).map(|nearest| nearest.triangle);
            assert_eq!(best.hit().some().map(|hit: Hit| hit.triangle), expected, "{}", scene.name);
            hits += u32::from(expected.is_some());
        }
    }
    assert!(hits > 300, "{hits}");
}

#[test]
fn rays_that_hit_nothing_pass_no_leaf() {
    let tree = tree_of(&scenes::sphere(8, [0.0; 3], 1.0), Preset::Balanced);
    let none = tree_of(&scenes::none(), Preset::Balanced);
    let (o, d) = ([-3.0, 0.1, 0.2], [1.0, 0.0, 0.0]);
    assert!(!visited(&tree, &Ray::new(o, d)).is_empty());
    assert!(visited(&none, &Ray::new(o, d)).is_empty());
    for ray in [
        Ray::new(o, [0.0, f32::from_bits(1), -0.0]),
        Ray::new(o, [f32::NAN, 1.0, 0.0]),
        Ray::new([f32::INFINITY, 0.0, 0.0], d),
        Ray::new(o, d).with_limits(f32::NAN, 9.0),
        Ray::new(o, d).with_limits(4.5, 3.0),
        Ray::new(o, d).with_limits(5.0, 9.0),
        Ray::new([-3.0, 1.5, 0.0], d),
    ] {
        assert!(visited(&tree, &ray).is_empty(), "{ray:?}");
    }
}
