//! The bounding volume hierarchy that takes its turn in every round of a sweep, beside the trees.

use super::bvh::Measured;
use super::interval::Interval;
use super::rays::RaySets;
use super::rounds::{OUTLIER, WARM_MS, far_above, ns_by_round};
use super::row::{Aims, Sets, Trace};
use crate::hierarchy::{self, Corners, Hierarchy};
use crate::paper::median;
use crate::paper::timing::timed;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, Ray};

/// A hierarchy at work, and what it has taken so far.
pub(super) struct Beside {
    triangles: Vec<Corners>,
    threads: usize,
    /// Most rays of a timed set.
    most: usize,
    build_ms: Vec<f64>,
    refit_ms: Vec<f64>,
    ns: [Vec<f64>; 4],
    rays: [usize; 4],
    judged: u64,
    otherwise: u64,
}

impl Beside {
    /// Over the triangles of a mesh that are finite, as the trees are.
    pub(super) fn new(mesh: &Mesh<'_>, threads: usize, most: usize) -> Beside {
        let finite = |corners: &Corners| corners.as_flattened().iter().all(|x| x.is_finite());
        let triangles = (0..mesh.len()).map(|index| mesh.triangle(index)).filter(finite).collect();
        Beside {
            triangles,
            threads,
            most,
            build_ms: Vec::new(),
            refit_ms: Vec::new(),
            ns: Default::default(),
            rays: [0; 4],
            judged: 0,
            otherwise: 0,
        }
    }

    /// Builds, refits and traces once; gives the hierarchy.
    pub(super) fn round(&mut self, sets: &RaySets, counts: bool) -> Hierarchy {
        let build = || Hierarchy::build(&self.triangles);
        let (mut built, mut build_ms) = timed(build);
        if build_ms < WARM_MS {
            // As the trees, so that it does not matter what ran before.
            drop(built);
            (built, build_ms) = timed(build);
        }
        let ((), refit_ms) = timed(|| built.refit(&self.triangles));
        for (set, rays) in sets.each().into_iter().enumerate() {
            let rays = &rays[..rays.len().min(self.most)];
            let ms = match set {
                Sets::<()>::SHADOW => timed(|| drop(built.occluded(rays))).1,
                _ => timed(|| drop(built.closest(rays))).1,
            };
            self.rays[set] = rays.len();
            if counts && !rays.is_empty() {
                self.ns[set].push(1e6 * ms / rays.len() as f64);
            }
        }
        if counts {
            self.build_ms.push(build_ms);
            self.refit_ms.push(refit_ms);
        }
        built
    }

    /// Counts the rays that hit where the exact answer is a miss, and the other way round.
    pub(super) fn judge(
        &mut self,
        built: &Hierarchy,
        rays: &Aims<Vec<Ray>>,
        exact: &Aims<Vec<Hit>>,
    ) {
        for (rays, exact) in rays.each().into_iter().zip(exact.each()) {
            let hits = built.occluded(rays);
            let otherwise = hits.iter().zip(exact).filter(|(hit, exact)| **hit != exact.is_hit());
            self.judged += rays.len() as u64;
            self.otherwise += otherwise.count() as u64;
        }
    }

    /// Measures rounds again in which a time was far above the median, twice at most.
    pub(super) fn look_again(&mut self, sets: &RaySets) {
        for _ in 0..2 {
            let round = [&self.build_ms, &self.refit_ms]
                .into_iter()
                .chain(&self.ns)
                .find_map(|times| far_above(times, OUTLIER));
            let Some(round) = round else { return };
            let own = [&mut self.build_ms, &mut self.refit_ms].into_iter().chain(&mut self.ns);
            for times in own.filter(|times| !times.is_empty()) {
                times.remove(round);
            }
            self.round(sets, true);
        }
    }

    /// What was measured.
    pub(super) fn measured(self) -> Measured {
        let by_round = ns_by_round(&self.ns);
        let Beside { build_ms, refit_ms, ns, rays, .. } = self;
        let [build_interval, refit_interval] = [&build_ms, &refit_ms].map(|ms| Interval::of(ms));
        let mut own = rays.into_iter();
        let trace = ns.map(|times| Trace {
            rays: own.next().unwrap_or(0),
            least_ns: times.iter().copied().reduce(f64::min),
            ns: (!times.is_empty()).then(|| median(times)),
        });
        Measured {
            name: hierarchy::NAME.to_owned(),
            threads: self.threads,
            build_ms: median(build_ms),
            build_interval,
            refit_ms: median(refit_ms),
            refit_interval,
            trace: Sets::of(trace),
            ns_interval: Interval::of(&by_round),
            ns_per_ray: median(by_round),
            judged: self.judged,
            otherwise: self.otherwise,
        }
    }
}
