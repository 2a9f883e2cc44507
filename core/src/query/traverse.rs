//! The reference traversal: closest hit and any hit by one search, without allocation. Faster
//! traversals must give the same answers.

pub mod exact;

use core::marker::PhantomData;
use core::ops::ControlFlow;

use crate::arithmetic::{Arithmetic, Strict};
use crate::config::MAX_DEPTH;
use crate::query::intersect::{PreparedRay, SceneScale, moeller_trumbore, watertight};
use crate::query::walk::{Leaf, Visitor, WalkRay, walk};
use crate::ray::{Accuracy, Hit, QueryOptions, Ray};
use crate::tree::KdTreeView;
use crate::tree::node::KdNode;
use crate::triangle::Triangle;

/// Where a traversal finds the triangles that references name: snapped corners by index.
pub trait Triangles {
    /// The corners of a triangle.
    fn corners(&self, triangle: u32) -> Triangle;
}

impl Triangles for [Triangle] {
    #[inline]
    fn corners(&self, triangle: u32) -> Triangle {
        self[triangle as usize]
    }
}

impl Triangles for crate::mesh::Mesh<'_> {
    #[inline]
    fn corners(&self, triangle: u32) -> Triangle {
        self.triangle(triangle as usize).map(|corner| corner.map(crate::arithmetic::snap))
    }
}

/// The kind of query.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Query {
    /// The hit of least `(t, triangle)`.
    Closest,
    /// Any hit.
    Any,
}

/// The closest hit of a ray.
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
pub fn closest_hit(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions<'_>,
) -> Option<Hit> {
    trace::<Strict>(tree, triangles, scene, ray, options, Query::Closest).some()
}

/// Whether a ray hits anything.
pub fn any_hit(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions<'_>,
) -> bool {
    trace::<Strict>(tree, triangles, scene, ray, options, Query::Any).is_hit()
}

/// The hit of least `(t, triangle)` of those that `keep` keeps, or any of them. A hit that is not kept costs its triangle's test and a call, which
/// may come again, since several leaves may name a triangle.
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
pub fn trace_kept(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions<'_>,
    query: Query,
    keep: impl FnMut(&Hit) -> bool,
) -> Hit {
    if options.accuracy == Accuracy::Exact {
        return exact::trace_kept(tree, triangles, ray, options, query, keep);
    }
    inner_trace::<Strict, _, _>(tree, triangles, scene, ray, options, query, (&mut (), keep))
}

/// Observes a traversal.
pub trait Observer {
    /// A node was visited, interior or leaf.
    fn node(&mut self);
    /// A triangle was tested.
    fn triangle(&mut self);
    /// The node just visited is a leaf with this many references. Returns whether its triangles are
    /// tested; where no leaf's are, the ray passes through everything.
    #[inline(always)]
    fn leaf(&mut self, _references: u32) -> bool {
        true
    }
}

/// Observes nothing.
impl Observer for () {
    #[inline(always)]
    fn node(&mut self) {}
    #[inline(always)]
    fn triangle(&mut self) {}
}

/// Counts what a traversal does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Nodes visited.
    pub nodes: u32,
    /// Triangles tested.
    pub triangles: u32,
}

impl Observer for Cost {
    fn node(&mut self) {
        self.nodes += 1;
    }
    fn triangle(&mut self) {
        self.triangles += 1;
    }
}

/// [`trace_observed`], unobserved.
pub fn trace<A: Arithmetic>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions<'_>,
    query: Query,
) -> Hit {
    trace_observed::<A, _>(tree, triangles, scene, ray, options, query, &mut ())
}

/// Traces one ray, in any arithmetic; for accuracy `exact` in that of [`exact::trace`], which is
/// `f64`. Triangles are tested against the whole ray, not the part in their leaf; the walk stops
/// when the next leaf begins beyond the best hit and its error.
pub fn trace_observed<A: Arithmetic, O: Observer>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions<'_>,
    query: Query,
    observer: &mut O,
) -> Hit {
    if options.accuracy == Accuracy::Exact {
        return exact::trace(tree, triangles, ray, options, query, observer);
    }
    inner_trace::<A, _, _>(tree, triangles, scene, ray, options, query, (observer, |_: &Hit| true))
}

#[inline(always)]
fn inner_trace<A: Arithmetic, O: Observer, K: FnMut(&Hit) -> bool>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions<'_>,
    query: Query,
    (observer, keep): (&mut O, K),
) -> Hit {
    let Some(ray) = PreparedRay::new::<A>(ray, scene) else { return Hit::MISS };
    let Some(interval) = ray.enter::<A>(&scene.bounds) else { return Hit::MISS };
    let ray = InnerRay::<A>::new(&ray);
    let best = Best { hit: Hit::MISS, stop: f32::INFINITY };
    let mut search = Search { tree, triangles, ray, options, query, observer, best, keep };
    walk(tree.nodes, &ray, interval, &mut search);
    search.best.hit
}

/// A prepared ray among planes, in inner `t`, in an arithmetic.
#[derive(Debug)]
pub struct InnerRay<'a, A> {
    ray: &'a PreparedRay,
    arithmetic: PhantomData<A>,
}

impl<A> Clone for InnerRay<'_, A> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<A> Copy for InnerRay<'_, A> {}

impl<'a, A: Arithmetic> InnerRay<'a, A> {
    /// The ray, as the walk needs it.
    #[inline]
    pub fn new(ray: &'a PreparedRay) -> InnerRay<'a, A> {
        InnerRay { ray, arithmetic: PhantomData }
    }
}

impl<A: Arithmetic> WalkRay for InnerRay<'_, A> {
    type T = f32;

    #[inline(always)]
    fn is_backwards(&self, axis: usize) -> bool {
        self.ray.direction[axis] < 0.0
    }

    #[inline(always)]
    fn plane_interval(&self, axis: usize, position: f32) -> (f32, f32) {
        self.ray.plane_interval::<A>(axis, position)
    }
}

/// The search for the hit of least `(t, triangle)`, or for any.
struct Search<'a, A, S: ?Sized, O, K> {
    tree: &'a KdTreeView<'a>,
    triangles: &'a S,
    ray: InnerRay<'a, A>,
    options: &'a QueryOptions<'a>,
    query: Query,
    observer: &'a mut O,
    best: Best,
    keep: K,
}

impl<A, S, O, K> Visitor<f32> for Search<'_, A, S, O, K>
where
    A: Arithmetic,
    S: Triangles + ?Sized,
    O: Observer,
    K: FnMut(&Hit) -> bool,
{
    #[inline(always)]
    fn node(&mut self) {
        self.observer.node();
    }

    #[inline(always)]
    fn leaf(&mut self, Leaf { first, count, .. }: Leaf<f32>) -> ControlFlow<(), f32> {
        let Search { tree, triangles, ray, options, query, observer, best, keep } = self;
        let tested = if observer.leaf(count) { tree.leaf(first, count) } else { &[] };
        best.test_kept::<A, O>(ray.ray, *triangles, tested, options, *query, observer, keep)
    }
}

/// The best hit so far.
pub(crate) struct Best {
    pub(crate) hit: Hit,
    /// Inner `t` beyond which no leaf can have a better one.
    pub(crate) stop: f32,
}

impl Best {
    /// Tests the triangles of a leaf. Ends the walk with the first hit where any will do.
    #[cfg(feature = "alloc")]
    #[inline(always)]
    pub(crate) fn test<A: Arithmetic, O: Observer>(
        &mut self,
        ray: &PreparedRay,
        triangles: &(impl Triangles + ?Sized),
        tested: &[u32],
        options: &QueryOptions<'_>,
        query: Query,
        observer: &mut O,
    ) -> ControlFlow<(), f32> {
        self.test_kept::<A, O>(ray, triangles, tested, options, query, observer, &mut |_| true)
    }

    /// The same for the hits that `keep` keeps. It is asked only for those that would be better than the best.
    #[inline(always)]
    #[allow(
        clippy::too_many_arguments,
        reason = "what a leaf's test needs of a traversal, each part on its own"
    )]
    pub(crate) fn test_kept<A: Arithmetic, O: Observer>(
        &mut self,
        ray: &PreparedRay,
        triangles: &(impl Triangles + ?Sized),
        tested: &[u32],
        options: &QueryOptions<'_>,
        query: Query,
        observer: &mut O,
        keep: &mut impl FnMut(&Hit) -> bool,
    ) -> ControlFlow<(), f32> {
        for &triangle in tested {
            if options.ignore == Some(triangle) {
                continue;
            }
            observer.triangle();
            let culling = options.culling;
            let candidate = match options.accuracy {
                Accuracy::Fast => moeller_trumbore::<A>(ray, &triangles.corners(triangle), culling),
                _ => watertight::<A>(ray, &triangles.corners(triangle), culling),
            };
            let Some(candidate) = candidate else { continue };
            let Some(t) = ray.outer_t::<A>(candidate.t) else { continue };
            let hit = Hit { t, triangle, u: candidate.u, v: candidate.v };
            if query == Query::Any {
                if !keep(&hit) {
                    continue;
                }
                self.hit = hit;
                return ControlFlow::Break(());
            }
            if hit.precedes(&self.hit) && keep(&hit) {
                self.hit = hit;
                self.stop = ray.stop_after(candidate.t, t);
            }
        }
        ControlFlow::Continue(self.stop)
    }
}

/// Bytes of the traversal's stack, for use on small machines.
pub const STACK_BYTES: usize = (MAX_DEPTH as usize + 1) * 12;

const _: () = assert!(size_of::<KdNode>() == 8);
