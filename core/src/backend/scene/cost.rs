//! What a ray costs in a scene: for pictures of costs.

use super::block::{Asked, seen_by};
use super::built::BuiltScene;
use crate::arithmetic::Strict;
use crate::query::traverse::{Cost, Query, trace_observed};
use crate::ray::Ray;
use crate::scene::{InstanceId, SceneHit, SceneOptions, TopRay, TopStack, WIDEST_STACK};

impl BuiltScene {
    /// What the reference traversal does for one ray: nodes of the kd-trees of all geometries that it enters, and triangles and shapes that
    /// are tested. Nodes of the trees over instances and over shapes, which are not kd-trees, are not counted, nor is what an opacity mask or
    /// a filter makes it search once more. Returns the closest hit too. Ignores the options' watch.
    pub fn cost_of(&self, ray: &Ray, options: &SceneOptions<'_>) -> (SceneHit, Cost) {
        let mut stack = [TopStack::default(); WIDEST_STACK];
        let (mut best, mut cost) = (SceneHit::MISS, Cost::default());
        let Some(top_ray) = TopRay::new(ray) else { return (best, cost) };
        let mut top = self.top.begin(&mut stack);
        loop {
            let t_max = ray.t_max.min(best.t);
            let Some(name) = self.top.next(&top_ray, t_max, &mut stack, &mut top) else {
                return (best, cost);
            };
            let instance = InstanceId(name);
            let Some(placement) = self.placement(instance) else { continue };
            let Some(asked) = Asked::of(instance, placement, options) else { continue };
            let geometry = placement.instance.geometry;
            let Some(built) = self.geometry(geometry) else { continue };
            let query = &options.of_geometry(asked.culling, asked.ignore, None);
            let seen = seen_by(placement, ray, &best);
            let mut hit = match built.shapes() {
                Some(shapes) => {
                    shapes.trace_observed(&seen, query, Query::Closest, &mut cost, |_| true)
                }
                None => {
                    let (tree, mesh) = (built.accelerator().tree().view(), built.mesh().mesh());
                    let scale = built.scale();
                    trace_observed::<Strict, _>(
                        &tree,
                        &mesh,
                        scale,
                        &seen,
                        query,
                        Query::Closest,
                        &mut cost,
                    )
                }
            };
            if let Some(kept) = built.kept(geometry, instance, options) {
                hit = kept.next(built, &seen, hit, (query, Query::Closest), &mut 0);
            }
            let found = SceneHit::of(&hit, geometry, instance);
            if found.is_hit() && found.precedes(&best) {
                best = found;
            }
        }
    }
}
