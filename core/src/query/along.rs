//! Custom queries along a ray: the leaves that it passes, nearest first.

use core::ops::ControlFlow;

use crate::exact::ExactRay;
use crate::query::traverse::exact::Walker;
use crate::query::walk::{Leaf, walk};
use crate::ray::Ray;
#[cfg(feature = "alloc")]
use crate::tree::KdTree;
use crate::tree::KdTreeView;

/// A leaf that a ray passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeafAlong<'a> {
    /// Its place among the nodes of the tree.
    pub node: u32,
    /// The triangles that have a part in its cell, by their index in the mesh, in ascending order; none for empty
    /// space. A triangle is in all leaves that it has a part in, so it may come again.
    pub triangles: &'a [u32],
    /// Where the ray enters the cell, in units of the ray's direction.
    pub t_enter: f64,
    /// Where the ray leaves it; not less than `t_enter`.
    pub t_exit: f64,
}

impl KdTreeView<'_> {
    /// Hands the leaves that a ray passes to `visit`, nearest first. `visit` returns the `t` beyond which it
    /// needs no more leaves, infinity to leave the ray's end unchanged, or breaks off.
    ///
    /// *Which leaves.* Every leaf, empty ones too, whose closed cell the ray meets between its
    /// limits, be it in a corner, along an edge or within a face; and perhaps leaves that it misses
    /// by less than a part in 2^48 of the distance. A shortened ray skips leaves that begin beyond
    /// its end. The least of all returned ends is the ray's end. Leaves that begin exactly there
    /// are visited, since they may hold ties. A ray that hits nothing (see [`Ray`]) passes no leaf,
    /// and neither does one in a tree without triangles.
    ///
    /// *Intervals.* From `t_enter` to `t_exit` lies all of the ray that is in the cell and within its limits. They
    /// are too long by no more than a part in 2^48 of each end. They are not cut where `visit` has shortened
    /// the ray.
    ///
    /// *Order.* At every split plane the leaves on the side that the ray comes from precede those
    /// on the other. So, up to rounding, no leaf begins before an earlier one, except where the ray
    /// runs within a split plane: the leaves below it precede those above it, each side near to
    /// far.
    ///
    /// *Tests.* [`exact::meet`](crate::exact::meet) and [`exact::cross`](crate::exact::cross) test a triangle
    /// without rounding in their decisions; they take the [`ExactRay`] of the ray and [snapped
    /// corners](crate::triangle::prepare).
    ///
    /// *Triangles* reach beyond their leaves, so a hit found in a leaf may lie beyond its `t_exit`.
    /// A search for the nearest hit returns the `t` of the best so far, and does not break off at
    /// the first.
    ///
    /// Nothing is allocated. As directions of rays, components below 2^-126 count as 0.
    ///
    /// The tree must be valid (see [`tree::validate`](crate::tree::validate)), as built trees and those read from files are.
    ///
    /// # Panics
    /// With a tree that is not valid it may panic, or not end.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// # use splitplane_core::aabb::Aabb;
    /// # use splitplane_core::config::BuildConfig;
    /// # use splitplane_core::tree::node::Axis;
    /// # use splitplane_core::tree::node::KdNode;
    /// use splitplane_core::{ray::Ray, tree::KdTreeView};
    ///
    /// // How much of a ray runs through space that some triangle is in.
    /// fn crowded(tree: &KdTreeView, ray: &Ray) -> f64 {
    ///     let mut length = 0.0;
    ///     tree.visit_along(ray, |leaf| {
    ///         if !leaf.triangles.is_empty() {
    ///             length += leaf.t_exit - leaf.t_enter;
    ///         }
    ///         ControlFlow::Continue(f64::INFINITY)
    ///     });
    ///     length
    /// }
    /// # let tree = KdTreeView {
    /// #     nodes: &[KdNode::interior(Axis::X, 1.0, 2), KdNode::leaf(0, 1), KdNode::leaf(1, 0)],
    /// #     references: &[0],
    /// #     bounds: Aabb { lo: [0.0; 3], hi: [4.0, 1.0, 1.0] },
    /// #     triangles: 1,
    /// #     config: BuildConfig::default(),
    /// # };
    /// # let length = crowded(&tree, &Ray::new([-1.0, 0.5, 0.5], [0.5, 0.0, 0.0]));
    /// # assert!((length - 2.0).abs() < 1e-9);
    /// ```
    #[inline]
    pub fn visit_along(
        &self,
        ray: &Ray,
        mut visit: impl FnMut(LeafAlong<'_>) -> ControlFlow<(), f64>,
    ) {
        let Some(ray) = ExactRay::new(ray) else { return };
        if self.bounds.is_empty() {
            return;
        }
        let walker = Walker::new(&ray);
        let Some(interval) = walker.enter(&self.bounds, &ray) else { return };
        let mut end = f64::INFINITY;
        walk(self.nodes, &walker, interval, &mut |leaf: Leaf<f64>| {
            let Leaf { node, first, count, enter, exit } = leaf;
            let triangles = self.leaf(first, count);
            let given = visit(LeafAlong { node, triangles, t_enter: enter, t_exit: exit })?;
            // Not for a NaN.
            if given < end {
                end = given;
            }
            ControlFlow::Continue(end)
        });
    }
}

#[cfg(feature = "alloc")]
impl KdTree {
    /// Shorthand for [`KdTreeView::visit_along`] of the view.
    #[inline]
    pub fn visit_along(&self, ray: &Ray, visit: impl FnMut(LeafAlong<'_>) -> ControlFlow<(), f64>) {
        self.view().visit_along(ray, visit);
    }
}
