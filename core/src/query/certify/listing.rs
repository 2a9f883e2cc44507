//! The triangles that a ray may cross, for queries that need all of them: what a device finds and the CPU
//! then decides.

use core::ops::ControlFlow;

use super::screen::{is_as_given, screen};
use crate::arithmetic::Arithmetic;
use crate::query::intersect::{PreparedRay, SceneScale};
use crate::query::traverse::{InnerRay, Triangles};
use crate::query::walk::{Leaf, walk};
use crate::ray::{QueryOptions, Ray};
use crate::tree::KdTreeView;

/// Calls `found` for every triangle that the ray may meet or [cross](crate::exact::cross) between its limits, as
/// often as it has references where the ray passes: at least all that [`exact`](crate::exact) finds, from a side that
/// counts, and but few others. So it does for triangles that hold the origin, whatever plane they are in, if 0 is within the
/// limits. Returns whether that can be told of the ray; if not, nothing was found.
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
pub fn list<A: Arithmetic>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions<'_>,
    mut found: impl FnMut(u32),
) -> bool {
    let Some(prepared) = PreparedRay::new::<A>(ray, scene) else { return true };
    if !is_as_given(ray, &prepared) {
        return false;
    }
    let Some(interval) = prepared.enter::<A>(&scene.bounds) else { return true };
    let visit = |Leaf { first, count, .. }: Leaf<f32>| {
        for &triangle in tree.leaf(first, count) {
            let corners = triangles.corners(triangle);
            if options.ignore != Some(triangle)
                && screen::<A>(&prepared, &corners, options.culling, f32::INFINITY).is_some()
            {
                found(triangle);
            }
        }
        ControlFlow::Continue(f32::INFINITY)
    };
    walk(tree.nodes, &InnerRay::<A>::new(&prepared), interval, &mut { visit });
    true
}
