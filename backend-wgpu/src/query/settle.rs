//! Exact answers made of what the device is certain of: the last digits, and rays it left undecided.

use rayon::prelude::*;
use splitplane_core::certify::UNDECIDED_HIT;
use splitplane_core::exact::{self, ExactRay, meet};
use splitplane_core::ray::{Hit, QueryOptions, Ray, Undecided};
use splitplane_core::traverse::Query;
use splitplane_core::tree::KdTreeView;
use splitplane_core::triangle::Triangle;

use super::record::UNFINISHED;

/// Rays of a task.
const TASK: usize = 1 << 12;

/// What is in host memory of a scene.
#[derive(Clone, Copy)]
pub(super) struct HostScene<'a> {
    pub(super) tree: KdTreeView<'a>,
    pub(super) triangles: &'a [Triangle],
}

impl HostScene<'_> {
    /// Makes the hits of a device exact. Of a hit that is certain only the triangle is kept; distance
    /// and weights are computed from it. Other rays are traced again, or left marked, as the options
    /// say. Gives the places of undecided rays, in ascending order.
    pub(super) fn settle(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions,
    ) -> Vec<usize> {
        let task = |(first, (rays, hits)): (usize, (&[Ray], &mut [Hit]))| {
            let mut undecided = Vec::new();
            for (place, (ray, hit)) in rays.iter().zip(hits).enumerate() {
                if hit.triangle == Hit::MISS.triangle || hit.triangle == UNFINISHED {
                    continue;
                }
                if let Some(exact) = self.of_triangle(ray, hit.triangle, options) {
                    *hit = exact;
                    continue;
                }
                undecided.push(first * TASK + place);
                *hit = match options.undecided {
                    Undecided::Redo => self.trace(ray, options, Query::Closest),
                    Undecided::Flag => Hit { triangle: UNDECIDED_HIT, ..Hit::MISS },
                };
            }
            undecided
        };
        let tasks = rays.par_chunks(TASK).zip(hits.par_chunks_mut(TASK)).enumerate();
        tasks.map(task).collect::<Vec<_>>().concat()
    }

    /// Traces the rays at these places again, on the CPU: whether they hit anything.
    pub(super) fn settle_any(
        &self,
        rays: &[Ray],
        places: &[usize],
        occluded: &mut [bool],
        options: &QueryOptions,
    ) {
        let again = |&place: &usize| self.trace(&rays[place], options, Query::Any).is_hit();
        let answers: Vec<bool> = places.par_iter().map(again).collect();
        for (&place, answer) in places.iter().zip(answers) {
            occluded[place] = answer;
        }
    }

    /// Where a ray meets a triangle that a device named. `None` where it names none, and where the ray
    /// does not meet it: such a device is not to be believed.
    fn of_triangle(&self, ray: &Ray, triangle: u32, options: &QueryOptions) -> Option<Hit> {
        let corners = self.triangles.get(triangle as usize)?;
        let met = meet(&ExactRay::new(ray)?, corners, options.culling)?;
        met.is_within_limits().then(|| met.hit(triangle))
    }

    fn trace(&self, ray: &Ray, options: &QueryOptions, query: Query) -> Hit {
        exact::trace(&self.tree, self.triangles, ray, options, query, &mut ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::aabb::Aabb;
    use splitplane_core::config::BuildConfig;
    use splitplane_core::node::KdNode;
    use splitplane_core::tree::KdTree;

    /// One triangle, one leaf.
    fn scene() -> (KdTree, [Triangle; 1]) {
        let triangles = [[[0.0, 0.0, 1.0], [3.0, 0.0, 1.0], [0.0, 3.0, 1.0]]];
        let tree = KdTree {
            nodes: vec![KdNode::leaf(0, 1)],
            references: vec![0],
            bounds: Aabb::of_points(&triangles[0]),
            triangles: 1,
            config: BuildConfig::default(),
        };
        (tree, triangles)
    }

    #[test]
    fn what_a_device_says_wrongly_is_undecided() {
        let (tree, triangles) = scene();
        let scene = HostScene { tree: tree.view(), triangles: &triangles };
        let at = |x| Ray::new([x, 1.0, 0.0], [0.0, 0.0, 1.0]);
        // Met, beside, met, unfinished, met, met.
        let rays = [at(1.0), at(2.5), at(0.5), at(0.5), at(1.0), at(0.5).with_limits(1.5, 2.0)];
        let said = |triangle| Hit { t: 7.0, triangle, u: 7.0, v: 7.0 };
        let device = [0, 0, UNDECIDED_HIT, UNFINISHED, 5, 0].map(said);
        for undecided in [Undecided::Redo, Undecided::Flag] {
            let options = QueryOptions { undecided, ..QueryOptions::default() };
            let mut hits = device;
            assert_eq!(scene.settle(&rays, &mut hits, &options), [1, 2, 4, 5]);
            let expected = |ray| exact::closest_hit(&tree.view(), &triangles[..], ray, &options);
            assert_eq!(hits[0].some(), expected(&rays[0]));
            assert_eq!(hits[3].triangle, UNFINISHED);
            for place in [1, 2, 4, 5] {
                match undecided {
                    Undecided::Redo => assert_eq!(hits[place].some(), expected(&rays[place])),
                    Undecided::Flag => assert_eq!(hits[place].triangle, UNDECIDED_HIT),
                }
            }
        }
    }
}
