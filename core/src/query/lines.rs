//! The counted cost of random rays, for comparison with what [`tree::stats`](crate::tree::stats) expects.
//!
//! Rays are drawn uniformly among the lines that meet the tree's bounds, once as lines that pass
//! through everything, which is what the surface area heuristic is about, and once up to their
//! closest hit. Sums are whole numbers, so no figure depends on how rays are distributed among
//! threads.

use crate::aabb::Aabb;
use crate::arithmetic::{Strict, sqrt};
use crate::query::intersect::{Limits, SceneScale};
use crate::query::traverse::{Observer, Query, Triangles, trace_observed};
use crate::ray::{QueryOptions, Ray};
use crate::tree::KdTreeView;
use crate::tree::stats::RayCost;
use core::ops::Range;

/// Uniform lines through a box, each a function of the seed and its number.
///
/// *Uniform* means the measure of lines that no motion of space changes: an element of a surface is
/// met by `cos(angle) dA dw` of them, w being the solid angle of their directions. Under it, and
/// under no other, the lines that meet a convex body are in proportion to its surface area (Cauchy and
/// Crofton; Santalo 1976), so that `A(inner) / A(outer)` is exactly the part of the lines
/// through a box that also meet a box inside it: the assumption of the surface area heuristic. Lines
/// drawn otherwise, such as from a point on the surface in a direction uniform over the hemisphere,
/// favour the rim.
///
/// Drawn by the formula: every line enters the box once, at a point uniform on its surface, in a
/// direction with density cos(angle) about the inner normal. That direction is the normal plus a
/// uniform unit vector. Nothing is rejected for missing the box, and flat boxes serve as well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lines {
    bounds: Aabb,
    seed: u64,
    /// Areas of the faces across x, y and z.
    faces: [f64; 3],
}

impl Lines {
    /// The lines through these bounds; `None` where the bounds are empty or have no area.
    pub fn through(bounds: &Aabb, seed: u64) -> Option<Lines> {
        if bounds.is_empty() {
            return None;
        }
        let [x, y, z] = [0, 1, 2].map(|k| f64::from(bounds.hi[k]) - f64::from(bounds.lo[k]));
        let faces = [y * z, z * x, x * y];
        let some = faces.iter().sum::<f64>() > 0.0;
        some.then_some(Lines { bounds: *bounds, seed, faces })
    }

    /// The line of this number: a ray that starts where the line enters the box.
    pub fn line(&self, number: u64) -> Ray {
        let mut draws = Draws::new(self.seed, number);
        let upper = draws.unit() < 0.5;
        let mut place = draws.unit() * self.faces.iter().sum::<f64>();
        let mut axis = 0;
        // Rounding never leads past the last face that has an area.
        for next in 1..3 {
            if place >= self.faces[axis] && self.faces[next..].iter().any(|&area| area > 0.0) {
                place -= self.faces[axis];
                axis = next;
            }
        }
        let mut origin = [0.0; 3];
        for k in 0..3 {
            let (lo, hi) = (self.bounds.lo[k], self.bounds.hi[k]);
            let within = f64::from(lo) + draws.unit() * (f64::from(hi) - f64::from(lo));
            origin[k] = (within as f32).clamp(lo, hi);
        }
        origin[axis] = if upper { self.bounds.hi[axis] } else { self.bounds.lo[axis] };
        let mut direction = draws.direction();
        direction[axis] += if upper { -1.0 } else { 1.0 };
        Ray::new(origin, direction.map(|d| d as f32))
    }
}

/// Pseudorandom numbers: SplitMix64 (Steele, Lea and Flood 2014).
struct Draws(u64);

impl Draws {
    fn new(seed: u64, number: u64) -> Draws {
        Draws(mix(mix(seed) ^ number))
    }

    /// From 0 to 1, 1 excluded.
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        (mix(self.0) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A uniform direction of length 1, from a uniform point of the ball in four dimensions (Cook
    /// 1957), which takes no root. The chance that none of 64 points is in the ball is below 1e-10;
    /// the direction is then that of z.
    fn direction(&mut self) -> [f64; 3] {
        for _ in 0..64 {
            let [a, b, c, d] = [(); 4].map(|()| 2.0 * self.unit() - 1.0);
            let square = a * a + b * b + c * c + d * d;
            if (1e-12..1.0).contains(&square) {
                return [
                    2.0 * (b * d + a * c) / square,
                    2.0 * (c * d - a * b) / square,
                    (a * a + d * d - b * b - c * c) / square,
                ];
            }
        }
        [0.0, 0.0, 1.0]
    }
}

/// The finaliser of SplitMix64.
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Counts what one ray does, by kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Visits {
    /// Nodes visited, interior or leaf.
    pub nodes: u32,
    /// Leaves visited, the empty ones included.
    pub leaves: u32,
    /// Leaves without triangles visited.
    pub empty_leaves: u32,
    /// References of the leaves visited: triangles that are tested, or would be.
    pub tests: u32,
    /// Blocks of W of them.
    pub blocks: u32,
    block_width: u32,
    passes: bool,
}

impl Visits {
    /// Nothing yet. A ray that `passes` tests no triangle, and so ends at none.
    pub const fn new(block_width: u32, passes: bool) -> Visits {
        let (nodes, leaves, empty_leaves, tests, blocks) = (0, 0, 0, 0, 0);
        Visits { nodes, leaves, empty_leaves, tests, blocks, block_width, passes }
    }

    /// The counts in the order of [`RayCost::to_array`].
    const fn to_array(self) -> [u32; 5] {
        [self.nodes - self.leaves, self.leaves, self.empty_leaves, self.tests, self.blocks]
    }
}

impl Observer for Visits {
    fn node(&mut self) {
        self.nodes += 1;
    }

    fn triangle(&mut self) {}

    fn leaf(&mut self, references: u32) -> bool {
        self.leaves += 1;
        self.empty_leaves += u32::from(references == 0);
        self.tests += references;
        self.blocks += references.div_ceil(self.block_width);
        !self.passes
    }
}

/// Sums over rays: whole numbers, the same in any order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Rays.
    pub rays: u64,
    /// Rays that hit something; 0 for rays that pass through everything.
    pub hits: u64,
    sums: [u64; 5],
    squares: [u128; 5],
}

impl Tally {
    /// Counts a ray.
    pub fn add(&mut self, visits: &Visits, hit: bool) {
        self.rays += 1;
        self.hits += u64::from(hit);
        for (k, count) in visits.to_array().into_iter().enumerate() {
            self.sums[k] += u64::from(count);
            self.squares[k] += u128::from(count) * u128::from(count);
        }
    }

    /// The sums of both.
    #[must_use]
    pub fn union(mut self, other: Tally) -> Tally {
        self.rays += other.rays;
        self.hits += other.hits;
        for k in 0..5 {
            self.sums[k] += other.sums[k];
            self.squares[k] += other.squares[k];
        }
        self
    }

    /// The average over rays; zeros without rays.
    pub fn mean(&self) -> RayCost {
        let rays = self.rays.max(1) as f64;
        RayCost::from_array(self.sums.map(|sum| sum as f64 / rays))
    }

    /// The standard errors of [`Tally::mean`]: the root of the sample variance over the number of
    /// rays. Zeros for fewer than two rays, which do not determine it.
    pub fn standard_error(&self) -> RayCost {
        if self.rays < 2 {
            return RayCost::default();
        }
        let rays = u128::from(self.rays);
        let error = |k: usize| {
            // n times the sum of squares less the square of the sum, without cancellation.
            let sum = u128::from(self.sums[k]);
            let spread = rays.saturating_mul(self.squares[k]).saturating_sub(sum * sum);
            let n = self.rays as f64;
            sqrt(spread as f64 / (n * n * (n - 1.0)))
        };
        RayCost::from_array([0, 1, 2, 3, 4].map(error))
    }
}

/// The counts of the same lines, traced in two ways.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Measured {
    /// Passing through everything: what [`tree::stats::TreeStats::expected`](crate::tree::stats::TreeStats::expected) predicts, up to the
    /// width that the traversal gives to planes so that no ray is lost.
    pub passing: Tally,
    /// Up to the closest hit.
    pub closest: Tally,
}

impl Measured {
    /// The sums of both.
    #[must_use]
    pub fn union(self, other: Measured) -> Measured {
        Measured {
            passing: self.passing.union(other.passing),
            closest: self.closest.union(other.closest),
        }
    }
}

/// Traces the lines of these numbers by the reference traversal and counts what they do. `scene` is
/// [`scene_scale`] of the same tree; the tree must be valid (see [`tree::validate`](crate::tree::validate)).
pub fn trace_lines(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    scene: &SceneScale,
    lines: &Lines,
    numbers: Range<u64>,
    options: &QueryOptions<'_>,
) -> Measured {
    let mut measured = Measured::default();
    for ray in numbers.map(|number| lines.line(number)) {
        for (passes, tally) in [(true, &mut measured.passing), (false, &mut measured.closest)] {
            let mut visits = Visits::new(tree.config.block_width, passes);
            let (query, seen) = (Query::Closest, &mut visits);
            let hit =
                trace_observed::<Strict, _>(tree, triangles, scene, &ray, options, query, seen);
            tally.add(&visits, hit.is_hit());
        }
    }
    measured
}

/// The data of the triangles that a tree refers to, as queries need it.
pub fn scene_scale(tree: &KdTreeView<'_>, triangles: &(impl Triangles + ?Sized)) -> SceneScale {
    let corners = tree.references.iter().map(|&triangle| triangles.corners(triangle));
    let limits = corners.fold(Limits::NONE, |limits, c| limits.union(Limits::of(&c)));
    SceneScale::new(tree.bounds, &limits)
}

#[cfg(test)]
mod tests {
    use core::ops::Range;

    use super::*;
    use crate::config::BuildConfig;
    use crate::tree::node::{Axis, KdNode};
    use crate::triangle::Triangle;

    /// A cube cut in two at x = 1, a wall in the upper half.
    const NODES: [KdNode; 3] =
        [KdNode::interior(Axis::X, 1.0, 2), KdNode::leaf(0, 0), KdNode::leaf(0, 2)];
    const WALL: [Triangle; 2] = [
        [[1.5, 0.0, 0.0], [1.5, 4.0, 0.0], [1.5, 0.0, 4.0]],
        [[2.0, 4.0, 4.0], [2.0, 4.0, 0.0], [2.0, 0.0, 4.0]],
    ];

    fn tree() -> KdTreeView<'static> {
        KdTreeView {
            nodes: &NODES,
            references: &[0, 1],
            bounds: Aabb { lo: [0.0; 3], hi: [2.0, 4.0, 4.0] },
            triangles: 2,
            config: BuildConfig { block_width: 1, ..Default::default() },
        }
    }

    fn visits(origin: [f32; 3], direction: [f32; 3], passes: bool) -> ([u32; 5], bool) {
        let (tree, mut visits) = (tree(), Visits::new(1, passes));
        let scene = scene_scale(&tree, &WALL[..]);
        let ray = Ray::new(origin, direction);
        let hit = trace_observed::<Strict, _>(
            &tree,
            &WALL[..],
            &scene,
            &ray,
            &QueryOptions::default(),
            Query::Closest,
            &mut visits,
        );
        (visits.to_array(), hit.is_hit())
    }

    #[test]
    fn directions_have_length_one_and_no_bias() {
        let (mut sum, mut squares) = ([0.0; 3], [0.0; 3]);
        for number in 0..4_000 {
            let direction = Draws::new(5, number).direction();
            let square: f64 = direction.iter().map(|d| d * d).sum();
            assert!((square - 1.0).abs() < 1e-9, "{direction:?}");
            for k in 0..3 {
                sum[k] += direction[k] / 4_000.0;
                squares[k] += direction[k] * direction[k] / 4_000.0;
            }
        }
        // Five times the standard deviations, 0.0091 and 0.0047.
        assert!(sum.iter().all(|mean| mean.abs() < 0.046), "{sum:?}");
        assert!(squares.iter().all(|mean| (mean - 1.0 / 3.0).abs() < 0.024), "{squares:?}");
    }

    #[test]
    fn sums_of_parts_are_sums_of_all() {
        let visit = |ray: u32| {
            let mut visits = Visits::new(4, false);
            (0..4 + ray % 5).for_each(|_| visits.node());
            (0..=ray % 3).for_each(|leaf| {
                visits.leaf(ray * leaf % 11);
            });
            visits
        };
        let tally = |rays: Range<u32>| {
            let mut tally = Tally::default();
            rays.for_each(|ray| tally.add(&visit(ray), ray % 3 == 1));
            tally
        };
        let all = tally(0..50);
        assert_eq!(all, tally(0..17).union(tally(17..50)));
        assert_eq!((all.rays, all.hits), (50, 17));
    }

    #[test]
    fn rays_are_counted_by_kind() {
        let (low, along_x, along_y) = ([0.0, 1.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        assert_eq!(visits(low, along_x, true), ([1, 2, 1, 2, 2], false));
        assert_eq!(visits(low, along_x, false), ([1, 2, 1, 2, 2], true));
        // Within one half: the other is not visited.
        assert_eq!(visits([0.5, 0.0, 1.0], along_y, true), ([1, 1, 1, 0, 0], false));
        assert_eq!(visits([1.2, 0.0, 1.0], along_y, true), ([1, 1, 0, 2, 2], false));
        // From the wall's side the empty half comes after the hit, and only the passing ray sees
        // it.
        let (high, back) = ([2.0, 1.0, 1.0], [-1.0, 0.0, 0.0]);
        assert_eq!(visits(high, back, true), ([1, 2, 1, 2, 2], false));
        assert_eq!(visits(high, back, false), ([1, 1, 0, 2, 2], true));
        // Beside the bounds.
        assert_eq!(visits([0.5, 9.0, 1.0], along_y, true), ([0; 5], false));
    }

    #[test]
    fn means_and_their_errors() {
        let mut tally = Tally::default();
        for nodes in [2, 4, 4, 4, 5, 5, 7, 9] {
            let visits = Visits { nodes, ..Visits::new(1, true) };
            tally.add(&visits, nodes > 4);
        }
        assert_eq!((tally.rays, tally.hits, tally.mean().interior), (8, 4, 5.0));
        // The squares of the differences to 5 sum to 32.
        let error = tally.standard_error().interior;
        assert!((error * error - 32.0 / 7.0 / 8.0).abs() < 1e-12, "{error}");
        assert_eq!(tally.standard_error().leaves, 0.0);
        let both = tally.union(tally);
        assert_eq!((both.rays, both.mean()), (16, tally.mean()));
        assert_eq!(Tally::default().mean(), RayCost::default());
    }

    #[test]
    fn lines_enter_the_box_through_every_face() {
        let bounds = Aabb { lo: [-1.0, 2.0, 3.0], hi: [1.0, 2.5, 7.0] };
        let lines = Lines::through(&bounds, 1).unwrap();
        let mut entered = [0u32; 6];
        for ray in (0..40_000).map(|number| lines.line(number)) {
            assert!(bounds.contains(&Aabb { lo: ray.origin, hi: ray.origin }), "{ray:?}");
            let face = (0..6).find(|face| {
                let (axis, upper) = (face / 2, face % 2 == 1);
                let side = if upper { bounds.hi[axis] } else { bounds.lo[axis] };
                let inwards = ray.direction[axis] * if upper { -1.0 } else { 1.0 };
                ray.origin[axis] == side && inwards >= 0.0
            });
            entered[face.expect("a ray starts on a face and goes in")] += 1;
        }
        // Faces of 2, 8 and 1 twice: of 22 in all.
        for (face, part) in [2.0, 2.0, 8.0, 8.0, 1.0, 1.0].into_iter().enumerate() {
            let (mean, found) = (40_000.0 * part / 22.0, f64::from(entered[face]));
            assert!((found - mean).abs() < 5.0 * sqrt(mean), "{entered:?}");
        }
    }

    #[test]
    fn boxes_without_area_have_no_lines_and_flat_ones_have() {
        assert_eq!(Lines::through(&Aabb::EMPTY, 1), None);
        let (point, edge) = (Aabb { lo: [1.0; 3], hi: [1.0; 3] }, [1.0, 2.0, 1.0]);
        assert_eq!(Lines::through(&point, 1), None);
        assert_eq!(Lines::through(&Aabb { hi: edge, ..point }, 1), None);
        for axis in 0..3 {
            let mut hi = [3.0; 3];
            hi[axis] = 1.0;
            let lines = Lines::through(&Aabb { lo: [1.0; 3], hi }, 1).unwrap();
            assert!((0..1000).all(|number| lines.line(number).origin[axis] == 1.0));
        }
    }

    /// The first number of the published generator with seed 0.
    #[test]
    fn the_generator_is_the_published_one() {
        assert_eq!(mix(0x9e37_79b9_7f4a_7c15), 0xe220_a839_7b1d_cdaf);
    }
}
