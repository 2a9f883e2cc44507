//! The reference traversal: closest hit and any hit in one loop, without allocation. Faster
//! traversals are held to its answers.

use crate::arithmetic::{Arithmetic, Strict};
use crate::config::MAX_DEPTH;
use crate::exact;
use crate::intersect::{PreparedRay, SceneScale, moeller_trumbore, watertight};
use crate::node::{KdNode, NodeKind};
use crate::ray::{Accuracy, Hit, QueryOptions, Ray};
use crate::tree::KdTreeView;
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

/// What a query asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Query {
    /// The hit of least `(t, triangle)`.
    Closest,
    /// Any hit.
    Any,
}

/// The closest hit of a ray.
///
/// `tree` must be valid (see [`crate::validate`]).
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

/// Is told what a traversal does.
pub trait Observer {
    /// A node was visited, interior or leaf.
    fn node(&mut self);
    /// A triangle was tested.
    fn triangle(&mut self);
    /// The node just visited is a leaf with so many references. Gives whether its triangles are to
    /// be tested; where no leaf's are, the ray passes through everything.
    #[inline(always)]
    fn leaf(&mut self, _references: u32) -> bool {
        true
    }
}

/// Takes no notice.
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

/// The one loop, in any arithmetic; for accuracy `exact` that of [`exact::trace`], which is in `f64`. Front to
/// back; both children are visited when the plane lies
/// within its error of the interval; triangles are tested against the whole ray; it stops when the
/// next entry lies beyond the best hit and its error.
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
    let mut best = Hit::MISS;
    let Some(prepared) = PreparedRay::new::<A>(ray, scene) else { return best };
    let Some((mut enter, mut exit)) = prepared.enter::<A>(&scene.bounds) else { return best };
    let mut stop = f32::INFINITY;
    let mut stack = [(0u32, 0.0f32, 0.0f32); MAX_DEPTH as usize + 1];
    let mut top = 0;
    let mut node = 0u32;
    loop {
        observer.node();
        match tree.nodes[node as usize].kind() {
            NodeKind::Interior { axis, split, right } => {
                let (least, greatest) = prepared.plane_interval::<A>(axis.index(), split);
                let backwards = prepared.direction[axis.index()] < 0.0;
                let (near, far) = if backwards { (right, node + 1) } else { (node + 1, right) };
                if greatest < enter {
                    node = far;
                } else if least > exit {
                    node = near;
                } else {
                    stack[top] = (far, if least > enter { least } else { enter }, exit);
                    top += 1;
                    node = near;
                    if greatest < exit {
                        exit = greatest;
                    }
                }
                continue;
            }
            NodeKind::Leaf { first, count } => {
                let tested = if observer.leaf(count) { tree.leaf(first, count) } else { &[] };
                for &triangle in tested {
                    if options.ignore == Some(triangle) {
                        continue;
                    }
                    observer.triangle();
                    let corners = triangles.corners(triangle);
                    let candidate = match options.accuracy {
                        Accuracy::Fast => {
                            moeller_trumbore::<A>(&prepared, &corners, options.culling)
                        }
                        _ => watertight::<A>(&prepared, &corners, options.culling),
                    };
                    let Some(candidate) = candidate else { continue };
                    let Some(t) = prepared.outer_t::<A>(candidate.t) else { continue };
                    let hit = Hit { t, triangle, u: candidate.u, v: candidate.v };
                    if query == Query::Any {
                        return hit;
                    }
                    if hit.precedes(&best) {
                        best = hit;
                        stop = prepared.stop_after(candidate.t, t);
                    }
                }
            }
        }
        loop {
            if top == 0 {
                return best;
            }
            top -= 1;
            (node, enter, exit) = stack[top];
            if enter <= stop {
                break;
            }
        }
    }
}

/// Bytes of the traversal's stack, for those who embed it on small machines.
pub const STACK_BYTES: usize = (MAX_DEPTH as usize + 1) * 12;

const _: () = assert!(size_of::<KdNode>() == 8);
