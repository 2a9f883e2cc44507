//! The tree over a set of shapes, and rays through it.

use alloc::sync::Arc;
use alloc::vec::Vec;

use super::shape::{SHAPE_SLACK, ShapeRay, Shapes};
use crate::aabb::Aabb;
use crate::arithmetic::Strict;
use crate::error::BuildError;
use crate::query::traverse::{Observer, Query};
use crate::ray::{Culling, Hit, QueryOptions, Ray};
use crate::scene::description::GeometryMesh;
use crate::scene::hit::MAX_INSTANCES;
use crate::scene::top_build::top_tree_bytes;
use crate::scene::top_tree::TopTree;
use crate::scene::top_walk::{TopRay, TopStack, WIDEST_STACK};
use crate::scene::world_box::{WorldBox, above, below};
use crate::tree::digest::Digest;

/// Roundings of the test of a box, of the origin and of the box.
const TEST: f64 = 12.0 / (1u64 << 24) as f64;
/// Covers what is flushed.
const LEAST: f64 = 1.0 / (1u64 << 57) as f64;
/// Boxes with a greater coordinate are everywhere.
const GREATEST: f64 = (1u64 << 38) as f64;

/// A set of shapes, with the tree over it: the least (t, primitive) of a ray's hits, or any.
#[derive(Debug)]
pub struct ShapeTree {
    arrays: Arc<GeometryMesh>,
    tree: TopTree,
    bounds: Aabb,
    dropped: u32,
}

impl ShapeTree {
    /// Builds the tree over the shapes of a geometry.
    ///
    /// # Errors
    /// More primitives than can be named, or no memory; `max_memory` is what the build may hold.
    pub fn build(
        arrays: &Arc<GeometryMesh>,
        max_memory: Option<u64>,
    ) -> Result<ShapeTree, BuildError> {
        let none = Shapes::Spheres(Vec::new());
        let shapes = arrays.shapes().unwrap_or(&none);
        let count = shapes.len();
        if count >= MAX_INSTANCES {
            return Err(BuildError::TooLarge { nodes: count as u64, references: count as u64 });
        }
        let needed = top_tree_bytes(count, count) + (count * size_of::<(u32, WorldBox)>()) as u64;
        if let Some(limit) = max_memory.filter(|&limit| needed > limit) {
            return Err(BuildError::OutOfMemory { needed, limit });
        }
        let refused = || BuildError::OutOfMemory { needed, limit: needed };
        let mut boxes: Vec<(u32, WorldBox)> = Vec::new();
        boxes.try_reserve_exact(count).map_err(|_| refused())?;
        let mut bounds = Aabb::EMPTY;
        for primitive in 0..count as u32 {
            if let Some(own) = shapes.bounds(primitive) {
                bounds = bounds.union(&own);
                boxes.push((primitive, widened(&own)));
            }
        }
        let dropped = (count - boxes.len()) as u32;
        let tree = TopTree::build(count, boxes.into_iter()).ok_or_else(refused)?;
        Ok(ShapeTree { arrays: Arc::clone(arrays), tree, bounds, dropped })
    }

    /// The shapes.
    pub fn shapes(&self) -> &Shapes {
        const NONE: &Shapes = &Shapes::Spheres(Vec::new());
        self.arrays.shapes().unwrap_or(NONE)
    }

    /// The tree over their boxes.
    pub fn tree(&self) -> &TopTree {
        &self.tree
    }

    /// The box of all primitives that count, without slack.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Primitives that are left out: numbers that are not finite, or a radius that is not more than 0.
    pub const fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Names the set.
    pub fn digest(&self) -> Digest {
        self.shapes().digest()
    }

    /// The hit of least (t, primitive) of those that `keep` keeps, or any of them.
    #[inline]
    pub fn trace(
        &self,
        ray: &Ray,
        options: &QueryOptions<'_>,
        query: Query,
        keep: impl FnMut(&Hit) -> bool,
    ) -> Hit {
        self.trace_observed(ray, options, query, &mut (), keep)
    }

    /// The same; the observer counts primitives as triangles, and no nodes.
    #[inline]
    pub fn trace_observed<O: Observer>(
        &self,
        ray: &Ray,
        options: &QueryOptions<'_>,
        query: Query,
        observer: &mut O,
        mut keep: impl FnMut(&Hit) -> bool,
    ) -> Hit {
        let mut best = Hit::MISS;
        let shapes = self.shapes();
        self.enter(ray, |ready, primitive| {
            observer.triangle();
            if options.ignore != Some(primitive) {
                shapes.intersect(primitive, ray, ready, |hit, front| {
                    if !is_culled(options.culling, front) && hit.precedes(&best) && keep(&hit) {
                        best = hit;
                    }
                });
            }
            if query == Query::Any && best.is_hit() { None } else { Some(best.t) }
        });
        best
    }

    /// Shows all hits of a ray, in any order, and whether each comes from the front.
    pub fn trace_all(
        &self,
        ray: &Ray,
        options: &QueryOptions<'_>,
        mut show: impl FnMut(Hit, bool),
    ) {
        let shapes = self.shapes();
        self.enter(ray, |ready, primitive| {
            if options.ignore != Some(primitive) {
                shapes.intersect(primitive, ray, ready, |hit, front| {
                    if !is_culled(options.culling, front) {
                        show(hit, front);
                    }
                });
            }
            Some(f32::INFINITY)
        });
    }

    /// Shows the primitives whose boxes a ray enters. `test` returns the `t` beyond which none is of interest any more, or `None` where the ray is
    /// done.
    #[inline]
    fn enter(&self, ray: &Ray, mut test: impl FnMut(&ShapeRay, u32) -> Option<f32>) {
        let (Some(top_ray), Some(ready)) = (TopRay::new(ray), ShapeRay::new::<Strict>(ray)) else {
            return;
        };
        let mut stack = [TopStack::default(); WIDEST_STACK];
        let (mut top, mut stop) = (self.tree.begin(&mut stack), ray.t_max);
        while let Some(primitive) = self.tree.next(&top_ray, stop, &mut stack, &mut top) {
            let Some(beyond) = test(&ready, primitive) else { return };
            stop = if beyond < stop { beyond } else { stop };
        }
    }

    /// Shows the primitives whose boxes are within the root of a squared distance of a point, nearest boxes first as far as a traversal by depth
    /// gets them so. `visit` returns the square of the distance that is still of interest.
    pub(crate) fn near(&self, point: [f64; 3], within: f64, mut visit: impl FnMut(u32) -> f64) {
        let shown = self.tree.near(point, within, |primitive| {
            Ok::<f64, core::convert::Infallible>(visit(primitive))
        });
        let Ok(()) = shown;
    }

    /// Bytes of the tree and of the shapes.
    pub fn bytes(&self) -> u64 {
        let shapes = match self.shapes() {
            Shapes::Spheres(all) => size_of_val(&all[..]),
            Shapes::Capsules(all) => size_of_val(&all[..]),
            Shapes::Own(_) => 0,
        };
        self.tree.bytes() + shapes as u64
    }
}

/// Whether hits from the front, or from the back, are ignored.
pub(crate) fn is_culled(culling: Culling, front: bool) -> bool {
    match culling {
        Culling::None => false,
        Culling::Back => !front,
        Culling::Front => front,
    }
}

/// The box that a ray enters wherever a hit may be: see `docs/design/scenes.md`.
fn widened(own: &Aabb) -> WorldBox {
    let (mut most, mut extent) = (0.0f64, 0.0f64);
    for axis in 0..3 {
        let (lo, hi) = (f64::from(own.lo[axis]), f64::from(own.hi[axis]));
        most = most.max(lo.abs()).max(hi.abs());
        extent = extent.max(hi - lo);
    }
    if most > GREATEST {
        return WorldBox::EVERYWHERE;
    }
    let slack = SHAPE_SLACK * (most + extent) + TEST * most + LEAST;
    let reach = above(SHAPE_SLACK + TEST);
    let bounds = Aabb {
        lo: own.lo.map(|x| below(f64::from(x) - slack)),
        hi: own.hi.map(|x| above(f64::from(x) + slack)),
    };
    WorldBox { bounds, reach }
}
