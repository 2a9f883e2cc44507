//! One ray per call.

use super::block::{Asked, SceneAnswer, seen_by};
use super::built::BuiltScene;
use crate::query::traverse::Query;
use crate::ray::Ray;
use crate::scene::{InstanceId, SceneHit, SceneOptions, TopRay, TopStack, WIDEST_STACK};

impl BuiltScene {
    /// The answer to one ray: through the tree over the instances, and each geometry's own query of one ray. Ignores the options'
    /// watch.
    pub fn answer_one<T: SceneAnswer>(&self, ray: &Ray, options: &SceneOptions<'_>) -> T {
        let mut stack = [TopStack::default(); WIDEST_STACK];
        let mut answer = T::NONE;
        let Some(top_ray) = TopRay::new(ray) else { return answer };
        let mut top = self.top.begin(&mut stack);
        loop {
            let t_max = ray.t_max.min(answer.best().t);
            let Some(name) = self.top.next(&top_ray, t_max, &mut stack, &mut top) else {
                return answer;
            };
            let best = answer.best();
            if self.enter(InstanceId(name), ray, &best, options, &mut answer) {
                return answer;
            }
        }
    }

    /// The answer by all instances, one after the other, each for the whole ray, without the tree over
    /// them: what every other path is held to.
    pub fn answer_by_all<T: SceneAnswer>(&self, ray: &Ray, options: &SceneOptions<'_>) -> T {
        let mut answer = T::NONE;
        if TopRay::new(ray).is_some() {
            for (instance, _) in self.placements() {
                if self.enter(instance, ray, &SceneHit::MISS, options, &mut answer) {
                    break;
                }
            }
        }
        answer
    }

    /// Asks one instance, for hits that do not come after `best`. Returns whether the ray is done.
    fn enter<T: SceneAnswer>(
        &self,
        instance: InstanceId,
        ray: &Ray,
        best: &SceneHit,
        options: &SceneOptions<'_>,
        answer: &mut T,
    ) -> bool {
        let Some(placement) = self.placement(instance) else { return false };
        let Some(asked) = Asked::of(instance, placement, options) else { return false };
        let geometry = placement.instance.geometry;
        let Some(built) = self.geometry(geometry) else { return false };
        let query = &options.of_geometry(asked.culling, asked.ignore, None);
        let seen = seen_by(placement, ray, best);
        let kept = built.kept(geometry, instance, options);
        if T::QUERY == Query::Any && kept.is_none() {
            return built.accelerator().any_hit(&seen, query) && answer.take(SceneHit::MISS);
        }
        let Some(mut hit) = built.accelerator().closest_hit(&seen, query) else { return false };
        if let Some(kept) = kept {
            hit = kept.next(built, &seen, hit, (query, T::QUERY), &mut 0);
        }
        let found = SceneHit::of(&hit, geometry, instance);
        found.is_hit() && found.precedes(&answer.best()) && answer.take(found)
    }
}
