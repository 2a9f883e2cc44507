//! Completes a device's certain answers to exact ones: the last digits, and the rays that it left
//! undecided.

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU64};

use rayon::prelude::*;
use splitplane_core::error::{QueryError, refused};
use splitplane_core::exact::{ExactRay, meet};
use splitplane_core::query::traverse::{Query, exact};
use splitplane_core::ray::{Hit, QueryOptions, Ray, Undecided};
use splitplane_core::tree::KdTreeView;
use splitplane_core::triangle::Triangle;
use splitplane_core::watch::{Progress, Stage, Watch};
use splitplane_float_state::Standard;

use super::layout::UNFINISHED;

/// Rays of a task.
const TASK: usize = 1 << 12;

/// Calls a watch on behalf of the device and of the host's threads, from one at a time; `done`
/// counts the rays that both have finished.
pub(super) struct Asking<'w> {
    watch: Option<&'w dyn Watch>,
    turn: Mutex<()>,
    done: AtomicU64,
    total: u64,
    over: AtomicBool,
}

impl<'w> Asking<'w> {
    pub(super) fn new(watch: Option<&'w dyn Watch>, rays: usize) -> Asking<'w> {
        Asking {
            watch,
            turn: Mutex::new(()),
            done: AtomicU64::new(0),
            total: rays as u64,
            over: AtomicBool::new(false),
        }
    }

    /// Itself, for the device, if there is a watch.
    pub(super) fn watch(&self) -> Option<&dyn Watch> {
        self.watch.is_some().then_some(self)
    }

    /// Adds to the number of rays that are done.
    pub(super) fn advance(&self, rays: usize) {
        self.done.fetch_add(rays as u64, Relaxed);
    }

    /// Calls the watch, unless another thread does. True when the work is cancelled.
    pub(super) fn is_over(&self) -> bool {
        let Some(watch) = self.watch else { return false };
        match self.turn.try_lock() {
            Ok(_turn) if !self.over.load(Relaxed) => {
                let done = self.done.load(Relaxed);
                let progress = Progress { stage: Stage::Rays, done, total: self.total };
                if watch.progress(&progress).is_break() {
                    self.over.store(true, Relaxed);
                }
            }
            // The watch has panicked on another thread, which passes the panic on to the caller.
            Err(std::sync::TryLockError::Poisoned(_)) => self.over.store(true, Relaxed),
            _ => {}
        }
        self.over.load(Relaxed)
    }

    /// Calls the watch.
    ///
    /// # Errors
    /// [`QueryError::Cancelled`] when the work is cancelled.
    pub(super) fn check(&self) -> Result<(), QueryError> {
        if self.is_over() { Err(self.cancelled()) } else { Ok(()) }
    }

    /// The error of a part of the work as that of the whole.
    pub(super) fn of_whole(&self, error: QueryError) -> QueryError {
        match error {
            QueryError::Cancelled { .. } => self.cancelled(),
            error => error,
        }
    }

    /// The error of work that the watch cancelled.
    pub(super) fn cancelled(&self) -> QueryError {
        QueryError::Cancelled { done: self.done.load(Relaxed), total: self.total }
    }
}

impl Watch for Asking<'_> {
    /// For the device, which knows only about its part.
    fn progress(&self, _progress: &Progress) -> ControlFlow<()> {
        if self.is_over() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// The part of a scene that is in host memory.
#[derive(Clone, Copy)]
pub(super) struct HostScene<'a> {
    pub(super) tree: KdTreeView<'a>,
    pub(super) triangles: &'a [Triangle],
}

impl HostScene<'_> {
    /// Makes the hits of a device exact. Of a hit that is certain only the triangle is kept;
    /// distance and weights are computed from it. Other rays are traced again, or left marked, as
    /// the options say. Returns the indices of undecided rays, in ascending order. `asking` may end
    /// it at any ray that is traced again; then the answers are undefined.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] where the system has no memory for the indices.
    pub(super) fn settle(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
        asking: &Asking<'_>,
    ) -> Result<Vec<usize>, QueryError> {
        let mut parts: Vec<Vec<usize>> = list(rays.len().div_ceil(TASK))?;
        parts.resize_with(rays.len().div_ceil(TASK), Vec::new);
        let task = |(first, ((rays, hits), undecided)): (usize, (_, &mut Vec<usize>))| {
            let _state = Standard::set();
            let (rays, hits): (&[Ray], &mut [Hit]) = (rays, hits);
            for (place, (ray, hit)) in rays.iter().zip(hits).enumerate() {
                if hit.triangle == Hit::MISS.triangle || hit.triangle == UNFINISHED {
                    continue;
                }
                if let Some(exact) = self.of_triangle(ray, hit.triangle, options) {
                    *hit = exact;
                    continue;
                }
                undecided.try_reserve(1).map_err(|_| no_room_for(undecided.len() + 1))?;
                undecided.push(first * TASK + place);
                *hit = match options.undecided {
                    Undecided::Flag => Hit { triangle: Hit::UNDECIDED, ..Hit::MISS },
                    _ if asking.is_over() => break,
                    _ => self.trace(ray, options, Query::Closest),
                };
            }
            asking.is_over();
            Ok::<(), QueryError>(())
        };
        let tasks = rays.par_chunks(TASK).zip(hits.par_chunks_mut(TASK)).zip(&mut parts);
        tasks.enumerate().try_for_each(task)?;
        let mut undecided = list(parts.iter().map(Vec::len).sum())?;
        parts.iter().for_each(|part| undecided.extend_from_slice(part));
        Ok(undecided)
    }

    /// Traces the rays at these places again, on the CPU: whether they hit anything. As for
    /// [`HostScene::settle`], `asking` may end it.
    ///
    /// # Errors
    /// As for [`HostScene::settle`].
    pub(super) fn settle_any(
        &self,
        rays: &[Ray],
        places: &[usize],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
        asking: &Asking<'_>,
    ) -> Result<(), QueryError> {
        let again = |&place: &usize| {
            let _state = Standard::set();
            !asking.is_over() && self.trace(&rays[place], options, Query::Any).is_hit()
        };
        let mut answers: Vec<bool> = list(places.len())?;
        places.par_iter().map(again).collect_into_vec(&mut answers);
        for (&place, answer) in places.iter().zip(answers) {
            occluded[place] = answer;
        }
        Ok(())
    }

    /// Where a ray meets a triangle that a device named. `None` where it names none, and where the
    /// ray does not meet it: the device's answer is then wrong and ignored.
    fn of_triangle(&self, ray: &Ray, triangle: u32, options: &QueryOptions<'_>) -> Option<Hit> {
        let corners = self.triangles.get(triangle as usize)?;
        let met = meet(&ExactRay::new(ray)?, corners, options.culling)?;
        met.is_within_limits().then(|| met.hit(triangle))
    }

    fn trace(&self, ray: &Ray, options: &QueryOptions<'_>, query: Query) -> Hit {
        exact::trace(&self.tree, self.triangles, ray, options, query, &mut ())
    }
}

/// An empty list with this capacity.
///
/// # Errors
/// [`QueryError::OutOfMemory`] where the system has no memory for it.
pub(super) fn list<T>(length: usize) -> Result<Vec<T>, QueryError> {
    let mut list = Vec::new();
    list.try_reserve_exact(length).map_err(|_| no_room_for(length))?;
    Ok(list)
}

/// The error where there is no memory for this many indices.
fn no_room_for(places: usize) -> QueryError {
    refused(places.saturating_mul(size_of::<usize>()) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::aabb::Aabb;
    use splitplane_core::config::BuildConfig;
    use splitplane_core::tree::KdTree;
    use splitplane_core::tree::node::KdNode;

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
        let device = [0, 0, Hit::UNDECIDED, UNFINISHED, 5, 0].map(said);
        for undecided in [Undecided::Redo, Undecided::Flag] {
            let options = QueryOptions { undecided, ..QueryOptions::default() };
            let mut hits = device;
            let unwatched = Asking::new(None, rays.len());
            let left = scene.settle(&rays, &mut hits, &options, &unwatched);
            assert_eq!(left.expect("memory"), [1, 2, 4, 5]);
            let expected = |ray| exact::closest_hit(&tree.view(), &triangles[..], ray, &options);
            assert_eq!(hits[0].some(), expected(&rays[0]));
            assert_eq!(hits[3].triangle, UNFINISHED);
            for place in [1, 2, 4, 5] {
                match undecided {
                    Undecided::Redo => assert_eq!(hits[place].some(), expected(&rays[place])),
                    _ => assert_eq!(hits[place].triangle, Hit::UNDECIDED),
                }
            }
        }
    }

    /// Ends the work at its third call.
    struct Third(AtomicU64);

    impl Watch for Third {
        fn progress(&self, progress: &Progress) -> ControlFlow<()> {
            assert_eq!((progress.done, progress.total), (5, 1_000), "none is done on its way");
            let call = self.0.fetch_add(1, Relaxed) + 1;
            assert!(call <= 3, "called after the end");
            if call == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        }
    }

    #[test]
    fn rays_that_are_traced_again_are_left_in_the_middle() {
        let (tree, triangles) = scene();
        let scene = HostScene { tree: tree.view(), triangles: &triangles };
        let rays = [Ray::new([0.5, 0.5, 0.0], [0.0, 0.0, 1.0]); 1_000];
        let marked = Hit { triangle: Hit::UNDECIDED, ..Hit::MISS };
        let options = QueryOptions::default();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let ended = QueryError::Cancelled { done: 5, total: 1_000 };
        pool.install(|| {
            let (watch, mut hits) = (Third(AtomicU64::new(0)), [marked; 1_000]);
            let asking = Asking::new(Some(&watch), 1_000);
            asking.advance(5);
            scene.settle(&rays, &mut hits, &options, &asking).unwrap();
            assert_eq!(asking.check(), Err(ended.clone()));
            assert_eq!(hits.iter().filter(|hit| hit.triangle == 0).count(), 2);
            let (watch, mut occluded) = (Third(AtomicU64::new(0)), [false; 1_000]);
            let asking = Asking::new(Some(&watch), 1_000);
            asking.advance(5);
            let places: Vec<usize> = (0..1_000).collect();
            scene.settle_any(&rays, &places, &mut occluded, &options, &asking).unwrap();
            assert_eq!(asking.check(), Err(ended.clone()));
            assert_eq!(occluded.iter().filter(|hit| **hit).count(), 2);
        });
    }
}
