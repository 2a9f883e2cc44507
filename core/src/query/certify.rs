//! What a device can be certain of: exact hits, decided in `f32` with bounds on every error, or
//! left undecided.
//!
//! A device has no `f64`. So a triangle is first sorted by the sheared edge functions of the
//! watertight test and a bound on their error, which decides nearly all; the rest by triple
//! products in double-float numbers, of about 46 bits. Distances are always double-float numbers.
//! What even these cannot decide, within their bounds, is *undecided*. A ray is *decided* when
//! nothing undecided lies at or before its hit. Decided rays have the triangle that
//! [`exact`](crate::exact) finds; the others are left to the CPU. The bounds are derived in
//! docs/design/exact.md.
//!
//! [`list`] finds the triangles that a ray may cross, for all hits; [`count`] those that it crosses for certain, for how many there
//! are and for points in a mesh. The CPU decides the rest.
//!
//! Generic over [`Arithmetic`]: a twin of the shaders' `screen.wgsl`, `certain.wgsl`, `certain_search.wgsl`, `list_search.wgsl` and
//! `count_search.wgsl`.

mod counting;
mod listing;
mod record;
mod screen;

use core::ops::ControlFlow;

use crate::aabb::{max, min};
use crate::arithmetic::{Arithmetic, DOUBLE_NOISE, Double, exponent, snap};
use crate::query::intersect::{PreparedRay, SceneScale, scale};
use crate::query::traverse::{InnerRay, Query, Triangles};
use crate::query::walk::{Leaf, walk};
use crate::ray::{Culling, Hit, QueryOptions, Ray};
use crate::tree::KdTreeView;
use crate::triangle::Triangle;

pub use counting::{Counted, MOST_COUNTED, count};
pub use listing::list;
pub use record::record;
use screen::{Screened, is_as_given, screen};

/// Products are taken to be at least this great where their errors are bounded, unless a factor is zero: what
/// flushing takes from any of them is below 2^-118, and this times 2^-40 is above.
const MAGNITUDE_LEAST: f32 = 2.117_582_4e-22; // 2^-72
/// Error of a distance, per unit of those of its parts over the denominator: 2, since the
/// denominator may be half of what is computed, and slack for roundings.
const SPREAD: f32 = 2.25;
/// Relative error of a quotient of doubles: 2^-43, and slack.
const QUOTIENT_NOISE: f32 = 4.547_473_5e-13; // 2^-41
/// Least error of a distance that is not exactly zero, for what flushing may take.
const DISTANCE_NOISE: f32 = 7.703_72e-34; // 2^-110
/// Error of a distance as a single float, and slack: 4 roundings.
const FLOAT_NOISE: f32 = 2.384_185_8e-7; // 2^-22
/// Distances from 2 to the power of this up are left undecided, so that nothing overflows.
const GREATEST_EXPONENT: i32 = 60;

/// A number that is known within an error. An error of zero means that the number is exactly zero.
#[derive(Clone, Copy, Debug)]
struct Known {
    value: Double,
    error: f32,
}

/// A cross product, and for each component the sum of the magnitudes of its terms.
struct Normal {
    parts: [Double; 3],
    magnitudes: [f32; 3],
}

/// A bound on the magnitude of a product that is 0 only where a factor is.
#[inline]
fn magnitude<A: Arithmetic>(a: f32, b: f32) -> f32 {
    if a == 0.0 || b == 0.0 { 0.0 } else { max(A::product(a.abs(), b.abs()), MAGNITUDE_LEAST) }
}

fn minus<A: Arithmetic>(p: &[f32; 3], q: &[f32; 3]) -> [Double; 3] {
    core::array::from_fn(|axis| Double::difference_of::<A>(p[axis], q[axis]))
}

fn cross<A: Arithmetic>(p: &[Double; 3], q: &[Double; 3]) -> Normal {
    cross_of_sizes::<A>(p, q, &p.map(|x| x.high), &q.map(|x| x.high))
}

/// The same of vectors that may be less than the terms that they are sums of: `p_sizes` and `q_sizes` are those.
fn cross_of_sizes<A: Arithmetic>(
    p: &[Double; 3],
    q: &[Double; 3],
    p_sizes: &[f32; 3],
    q_sizes: &[f32; 3],
) -> Normal {
    let ends = |axis: usize| ((axis + 1) % 3, (axis + 2) % 3);
    let parts = core::array::from_fn(|axis| {
        let (i, j) = ends(axis);
        p[i].times::<A>(q[j]).minus::<A>(p[j].times::<A>(q[i]))
    });
    let magnitudes = core::array::from_fn(|axis| {
        let (i, j) = ends(axis);
        let one = magnitude::<A>(p_sizes[i], q_sizes[j]);
        A::sum(one, magnitude::<A>(p_sizes[j], q_sizes[i]))
    });
    Normal { parts, magnitudes }
}

fn dot<A: Arithmetic>(normal: &Normal, other: &[Double; 3]) -> Known {
    let Normal { parts, magnitudes } = normal;
    let terms: [Double; 3] = core::array::from_fn(|k| parts[k].times::<A>(other[k]));
    let value = terms[0].plus::<A>(terms[1]).plus::<A>(terms[2]);
    let sizes: [f32; 3] = core::array::from_fn(|k| magnitude::<A>(magnitudes[k], other[k].high));
    let size = A::sum(A::sum(sizes[0], sizes[1]), sizes[2]);
    Known { value, error: A::product(size, DOUBLE_NOISE) }
}

/// A triangle that is certainly met, between the ray's limits.
#[derive(Clone, Copy, Debug)]
pub struct Certain {
    /// Inner `t`.
    pub t: Double,
    /// The exact `t` differs from it by no more than this. Zero only where both are zero.
    pub error: f32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third corner.
    pub v: f32,
}

impl Certain {
    /// A float that is no more than the exact `t`.
    #[inline]
    fn least<A: Arithmetic>(&self) -> f32 {
        let float = A::product(self.t.high.abs(), FLOAT_NOISE);
        A::difference(A::difference(self.t.high, self.error), float)
    }

    /// A float that is no less than the exact `t`.
    #[inline]
    fn greatest<A: Arithmetic>(&self) -> f32 {
        let float = A::product(self.t.high.abs(), FLOAT_NOISE);
        A::sum(A::sum(self.t.high, self.error), float)
    }
}

/// What is certain about a ray and a triangle.
#[derive(Clone, Copy, Debug)]
pub enum Verdict {
    /// Not met between the limits, or not of interest.
    Not,
    /// Met between the limits.
    Met(Certain),
    /// Perhaps met, and if so then no nearer than at this inner `t`.
    InDoubt(f32),
}

/// What is certain about a ray and a triangle (snapped corners) of a scene that is not wide.
/// Triangles farther than `farthest`, an inner `t`, need not be decided.
#[inline]
pub fn examine<A: Arithmetic>(
    ray: &PreparedRay,
    triangle: &Triangle,
    culling: Culling,
    farthest: f32,
) -> Verdict {
    match screen::<A>(ray, triangle, culling, farthest) {
        Some(Screened { flat, edges, margin, nearest }) => {
            decide::<A>(ray, triangle, culling, farthest, &flat, edges, margin, nearest)
        }
        None => Verdict::Not,
    }
}

/// The rest of the test, for the few triangles whose edges may enclose the ray: the edges that are
/// still undecided, and the distance.
#[allow(clippy::too_many_arguments, reason = "all of it is at hand in registers")]
fn decide<A: Arithmetic>(
    ray: &PreparedRay,
    triangle: &Triangle,
    culling: Culling,
    farthest: f32,
    flat: &[[f32; 2]; 3],
    mut edges: [f32; 3],
    margin: f32,
    nearest: f32,
) -> Verdict {
    let signs = signs_of_edges::<A>(ray, triangle, flat, &mut edges, margin);
    let Signs { positive, negative, open } = signs;
    let some = positive || negative || open;
    if (positive && negative) || signs.is_culled(culling) || !some {
        return Verdict::Not;
    }
    distance_of::<A>(ray, triangle, farthest, edges, nearest, open)
}

/// Of which signs edge functions are for certain, and whether one is neither positive nor negative for certain, nor zero.
#[derive(Clone, Copy, Debug)]
struct Signs {
    positive: bool,
    negative: bool,
    open: bool,
}

impl Signs {
    /// Whether the side that the ray comes from does not count.
    fn is_culled(&self, culling: Culling) -> bool {
        match culling {
            Culling::None => false,
            Culling::Back => self.negative,
            Culling::Front => self.positive,
        }
    }
}

/// The signs of the edge functions, which become what is known of them.
fn signs_of_edges<A: Arithmetic>(
    ray: &PreparedRay,
    triangle: &Triangle,
    flat: &[[f32; 2]; 3],
    edges: &mut [f32; 3],
    margin: f32,
) -> Signs {
    let widths = flat.map(|[x, y]| max(x.abs(), y.abs()));
    let (mut positive, mut negative, mut open) = (false, false, false);
    for (weight, [p, q]) in edges.iter_mut().zip([[2, 1], [0, 2], [1, 0]]) {
        let ends = [&triangle[p], &triangle[q]];
        let (value, error) = decide_edge::<A>(ray, *weight, margin, ends, widths[q] < widths[p]);
        positive |= value > error;
        negative |= value < -error;
        open |= error != 0.0 && value.abs() <= error;
        *weight = value;
    }
    Signs { positive, negative, open }
}

/// The verdict on a triangle whose edges may enclose the ray, by the distance; `open` where it is in doubt whether they do.
fn distance_of<A: Arithmetic>(
    ray: &PreparedRay,
    triangle: &Triangle,
    farthest: f32,
    edges: [f32; 3],
    nearest: f32,
    open: bool,
) -> Verdict {
    let direction = ray.direction.map(Double::from_float);
    let [a, b, c] = triangle;
    let normal = cross::<A>(&minus::<A>(b, a), &minus::<A>(c, a));
    let denominator = dot::<A>(&normal, &direction);
    if denominator.error == 0.0 {
        // The ray lies in the triangle's plane, or beside it.
        return Verdict::Not;
    }
    let (speed, doubled) = (denominator.value.high.abs(), A::product(2.0, denominator.error));
    if speed <= doubled {
        return Verdict::InDoubt(nearest);
    }
    let numerator = dot::<A>(&normal, &minus::<A>(a, &ray.origin));
    let Some((t, error)) = quotient::<A>(&numerator, &denominator) else {
        return Verdict::InDoubt(nearest);
    };
    let det = A::sum(A::sum(edges[0], edges[1]), edges[2]);
    let met = Certain {
        t,
        error,
        u: snap(A::quotient(edges[1], det)),
        v: snap(A::quotient(edges[2], det)),
    };
    let least = max(met.least::<A>(), nearest);
    if least > farthest {
        return Verdict::Not;
    }
    let (after, before) = (compare_limit::<A>(ray, &met, 0), compare_limit::<A>(ray, &met, 1));
    if after == Compared::Less || before == Compared::Greater {
        Verdict::Not
    } else if open || after == Compared::Open || before == Compared::Open {
        Verdict::InDoubt(least)
    } else {
        Verdict::Met(met)
    }
}

/// An edge function and its error: as sheared where that is decided, else by the triple product of
/// the direction and the two corners, with the edge itself in place of one of them: it is far
/// shorter than the distance to it, and so is the error. The other should be the one that the ray
/// passes nearer, so that zeros stay zeros. In the units of the sheared ones, in which its last
/// digits do not count.
fn decide_edge<A: Arithmetic>(
    ray: &PreparedRay,
    sheared: f32,
    margin: f32,
    [p, q]: [&[f32; 3]; 2],
    from_second: bool,
) -> (f32, f32) {
    if sheared.abs() > margin {
        return (sheared, margin);
    }
    let normal = if from_second {
        cross::<A>(&minus::<A>(p, q), &minus::<A>(q, &ray.origin))
    } else {
        cross::<A>(&minus::<A>(p, &ray.origin), &minus::<A>(q, p))
    };
    let known = dot::<A>(&normal, &ray.direction.map(Double::from_float));
    let unit = ray.shear[2].abs();
    (A::product(known.value.high, unit), A::product(known.error, unit))
}

/// The quotient of two known numbers, the second to within half of itself; `None` where it is
/// out of range.
fn quotient<A: Arithmetic>(numerator: &Known, denominator: &Known) -> Option<(Double, f32)> {
    if numerator.error == 0.0 {
        return Some((Double::from_float(0.0), 0.0));
    }
    let (n, d) = (numerator.value, denominator.value);
    let first = A::quotient(n.high, d.high);
    let parts = A::sum(numerator.error, A::product(denominator.error, first.abs()));
    let spread = A::quotient(A::product(parts, SPREAD), d.high.abs());
    if exponent(first) >= GREATEST_EXPONENT || exponent(spread) >= GREATEST_EXPONENT {
        return None;
    }
    let rest = n.minus::<A>(d.times::<A>(Double::from_float(first)));
    let second = A::quotient(rest.high, d.high);
    let t = Double::from_float(first).plus::<A>(Double::from_float(second));
    let rounding = A::sum(A::product(first.abs(), QUOTIENT_NOISE), DISTANCE_NOISE);
    Some((t, A::sum(spread, rounding)))
}

/// How two numbers compare, as far as is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Compared {
    Less,
    Equal,
    Greater,
    Open,
}

/// How the distance of a hit compares with the ray's lower (0) or upper (1) limit.
fn compare_limit<A: Arithmetic>(ray: &PreparedRay, met: &Certain, which: usize) -> Compared {
    if met.error == 0.0 {
        let limit = ray.limits[which];
        return if limit > 0.0 {
            Compared::Less
        } else if limit < 0.0 {
            Compared::Greater
        } else {
            Compared::Equal
        };
    }
    // The inner limits of a ray that was not moved are the given ones, except for clamping far
    // beyond all distances, and flushing, which the error covers.
    let limit = if which == 0 { ray.t_min } else { ray.t_max };
    let beyond = met.t.minus::<A>(Double::from_float(limit)).high;
    sign_of(beyond, met.error)
}

fn sign_of(difference: f32, error: f32) -> Compared {
    if difference > error {
        Compared::Greater
    } else if difference < -error {
        Compared::Less
    } else {
        Compared::Open
    }
}

/// How the distances of two hits compare. `same` tells whether two triangles lie in one plane for
/// certain.
fn compare_t<A: Arithmetic>(
    met: &Certain,
    other: &Certain,
    same: impl FnOnce() -> bool,
) -> Compared {
    let error = A::sum(met.error, other.error);
    let compared = sign_of(met.t.minus::<A>(other.t).high, error);
    if compared == Compared::Open && (error == 0.0 || same()) { Compared::Equal } else { compared }
}

/// Whether two triangles certainly lie in one plane: they have the same three corners, or all six
/// corners have one coordinate in common.
fn in_one_plane(a: &Triangle, b: &Triangle) -> bool {
    let same = a.iter().all(|p| b.contains(p));
    let level = (0..3).any(|axis| a.iter().chain(b).all(|p| p[axis] == a[0][axis]));
    same || level
}

/// What a traversal has found.
#[derive(Clone, Copy, Debug)]
struct Search {
    best: Option<(Certain, u32)>,
    /// Inner `t`: nothing undecided is nearer.
    doubt: f32,
    /// No leaf farther than this is of interest.
    stop: f32,
}

impl Search {
    const START: Search = Search { best: None, doubt: f32::INFINITY, stop: f32::INFINITY };

    /// Records what is certain about a triangle.
    fn note<A: Arithmetic>(
        &mut self,
        verdict: Verdict,
        triangle: u32,
        same: impl FnOnce(u32) -> bool,
    ) {
        let met = match verdict {
            Verdict::Not => return,
            Verdict::InDoubt(least) => {
                self.doubt = min(self.doubt, least);
                return;
            }
            Verdict::Met(met) => met,
        };
        if let Some((best, index)) = &self.best {
            match compare_t::<A>(&met, best, || same(*index)) {
                Compared::Greater => return,
                Compared::Equal if triangle > *index => return,
                Compared::Open => {
                    self.doubt = min(self.doubt, min(met.least::<A>(), best.least::<A>()));
                    return;
                }
                Compared::Less | Compared::Equal => {}
            }
        }
        self.best = Some((met, triangle));
    }

    /// The record of what was found.
    fn hit<A: Arithmetic>(&self, ray: &PreparedRay) -> Hit {
        let outer = |t: f32| scale(t, -ray.exponent);
        match self.best {
            Some((met, triangle)) if met.greatest::<A>() < self.doubt => {
                Hit { t: outer(met.t.high), triangle, u: met.u, v: met.v }
            }
            None if self.doubt == f32::INFINITY => Hit::MISS,
            best => {
                let least = best.map_or(self.doubt, |(met, _)| min(self.doubt, met.least::<A>()));
                Hit { t: outer(least), triangle: Hit::UNDECIDED, u: 0.0, v: 0.0 }
            }
        }
    }
}

/// Traces one ray as a device does under accuracy `exact`: the exact hit but for the last bits of
/// `t` and the weights, a miss, or [`Hit::UNDECIDED`].
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
pub fn trace<A: Arithmetic>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions<'_>,
    query: Query,
) -> Hit {
    trace_with::<A>(tree, triangles, scene, ray, options, query, in_one_plane)
}

/// [`trace`], with another rule for triangles in one plane: tests inject wrong ones.
fn trace_with<A: Arithmetic>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions<'_>,
    query: Query,
    same: impl Fn(&Triangle, &Triangle) -> bool,
) -> Hit {
    let Some(prepared) = PreparedRay::new::<A>(ray, scene) else { return Hit::MISS };
    if !is_as_given(ray, &prepared) {
        return Hit { t: -f32::MAX, triangle: Hit::UNDECIDED, u: 0.0, v: 0.0 };
    }
    let Some(interval) = prepared.enter::<A>(&scene.bounds) else { return Hit::MISS };
    let walk_ray = InnerRay::<A>::new(&prepared);
    let mut search = Search::START;
    let visit = |Leaf { first, count, .. }: Leaf<f32>| {
        for &triangle in tree.leaf(first, count) {
            let known = search.best.is_some_and(|(_, index)| index == triangle);
            if known || options.ignore == Some(triangle) {
                continue;
            }
            let corners = triangles.corners(triangle);
            let verdict = examine::<A>(&prepared, &corners, options.culling, search.stop);
            search.note::<A>(verdict, triangle, |other| same(&corners, &triangles.corners(other)));
            if query == Query::Any && search.best.is_some() {
                // Whatever is undecided, this is hit.
                search.doubt = f32::INFINITY;
                return ControlFlow::Break(());
            }
            if query == Query::Closest {
                search.stop = search.doubt;
                if let Some((met, _)) = search.best {
                    let greatest = met.greatest::<A>();
                    let stop = prepared.stop_after(greatest, greatest);
                    search.stop = min(search.stop, stop);
                }
            }
        }
        ControlFlow::Continue(search.stop)
    };
    walk(tree.nodes, &walk_ray, interval, &mut { visit });
    search.hit::<A>(&prepared)
}

#[cfg(all(test, feature = "alloc"))]
mod tests;
