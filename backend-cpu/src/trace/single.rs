//! One ray per call: the steps of [`super::stream`] without the other rays.

use core::hint::assert_unchecked;
use core::mem::MaybeUninit;

use splitplane_core::backend::QueryLayout;
use splitplane_core::query::intersect::SceneScale;
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray, Rays};

use super::batch::{Answers, RayBatch};
use super::block_test::BestHit;
use super::keep::{Keep, KeepAll};
use super::leaves::{IndexedLeaves, Leaves, PackedLeaves, WrittenLeaves};
use super::prepare_one::Readiness;
use super::ray_state::{RayState, ScalarOutcome};
use super::step::{Alone, RayTest, TestContext, TestLeaf, TraversalStack, ask_for_block};
use super::stream::Stream;
use super::{exact, reference};
use crate::layout::tree_layout::TreeLayout;
use crate::layout::wide::WideNodes;
use crate::layout::wide_node::{DONE, is_leaf};
use crate::memory::lengthen;
use crate::simd::{Compiled, Simd};

/// Entries of a stack that needs no allocation: enough for trees 29 nodes deep.
const ENTRIES: usize = 512;

/// One ray, and the tree through which it is traced.
#[derive(Clone, Copy)]
pub(crate) struct Single<'a> {
    pub layout: &'a TreeLayout,
    pub scene: &'a SceneScale,
    pub ray: &'a Ray,
    pub options: &'a QueryOptions<'a>,
    pub query: Query,
}

impl Compiled for Single<'_> {
    type Output = Hit;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Hit {
        let Single { layout, options, .. } = self;
        if layout.wide.lines().is_empty() {
            return Hit::MISS;
        }
        // SAFETY: the caller's contract; the stack has as many entries as the nodes need.
        unsafe {
            let is_usual = (options.accuracy == Accuracy::Watertight)
                & (layout.layout() == QueryLayout::Fast)
                & (layout.wide.depth() <= WideNodes::deepest(S::N, ENTRIES));
            if !is_usual {
                return S::call(Unusual(self));
            }
            if S::WRITES_OUT && layout.is_written() {
                return S::call(ThroughWritten(self));
            }
            // These are asked block by block even so: by count that takes less than leaves that are known to be shared.
            self.usual::<S, _>(PackedLeaves::new(layout))
        }
    }
}

/// One usual ray through blocks that have their corners written out, in a function of its own, as in
/// [`test_either`](super::block_test::test_either).
struct ThroughWritten<'a>(Single<'a>);

impl Compiled for ThroughWritten<'_> {
    type Output = Hit;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Hit {
        let single = self.0;
        // SAFETY: the caller's contract.
        unsafe { single.usual::<S, _>(WrittenLeaves::new(single.layout)) }
    }
}

/// One ray that is not as most are, or not through what most go through.
struct Unusual<'a>(Single<'a>);

impl Compiled for Unusual<'_> {
    type Output = Hit;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Hit {
        let single = self.0;
        let Single { scene, ray, options, query, .. } = single;
        let mut ray_state = RayState::none();
        // SAFETY: the caller's contract.
        unsafe {
            let mut readiness = match options.accuracy {
                Accuracy::Exact => Readiness::Special,
                _ => ray_state.prepare::<S>(ray, scene, query),
            };
            if let Readiness::Special = readiness
                && options.accuracy != Accuracy::Exact
            {
                match RayState::prepare_by_core(ray, scene, options.accuracy, query) {
                    Some(ScalarOutcome::Traced(moved)) => {
                        (ray_state, readiness) = (moved, Readiness::Ready);
                    }
                    Some(ScalarOutcome::Answer(hit)) => return hit,
                    None => {}
                }
            }
            let hit = match readiness {
                Readiness::Misses => return Hit::MISS,
                Readiness::Special => return S::call(WithCare(single)),
                Readiness::Ready => single.through_any::<S, _>(&mut ray_state, KeepAll),
            };
            hit.unwrap_or_else(|| single.without_memory())
        }
    }
}

/// One ray, for which not all hits count. `None` for one that is not traced in steps: where accuracy is exact, far away or without memory for
/// a stack.
pub(crate) struct SingleKept<'a, K> {
    pub single: Single<'a>,
    pub keep: K,
}

impl<K: Keep> Compiled for SingleKept<'_, K> {
    type Output = Option<Hit>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Option<Hit> {
        let SingleKept { single, keep } = self;
        let Single { layout, scene, ray, options, query } = single;
        if layout.wide.lines().is_empty() {
            return Some(Hit::MISS);
        }
        if options.accuracy == Accuracy::Exact {
            return None;
        }
        let mut ray_state = RayState::none();
        // SAFETY: the caller's contract.
        match unsafe { ray_state.prepare::<S>(ray, scene, query) } {
            Readiness::Misses => return Some(Hit::MISS),
            Readiness::Ready => {}
            Readiness::Special => {
                match RayState::prepare_by_core(ray, scene, options.accuracy, query)? {
                    ScalarOutcome::Traced(moved) => ray_state = moved,
                    ScalarOutcome::Answer(hit) => return Some(hit),
                }
            }
        }
        // SAFETY: the caller's contract.
        unsafe { single.through_any::<S, _>(&mut ray_state, keep) }
    }
}

/// One ray, as a batch of one.
struct WithCare<'a>(Single<'a>);

impl Compiled for WithCare<'_> {
    type Output = Hit;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Hit {
        let Single { layout, scene, ray, options, query } = self.0;
        let mut hit = Hit::MISS;
        let answers = Answers::Hits(core::slice::from_mut(&mut hit));
        let rays = Rays::Records(core::slice::from_ref(ray));
        let batch = RayBatch { layout, scene, rays, options, query };
        // SAFETY: the caller's contract.
        match unsafe { S::call(Stream { batch, answers }) } {
            Ok(()) => hit,
            Err(_) => self.0.without_memory(),
        }
    }
}

impl Single<'_> {
    /// The hit of a ray of accuracy `watertight` through blocks, as most are.
    ///
    /// # Safety
    /// As for [`Compiled::run`]; the nodes must need no more than [`ENTRIES`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn usual<S: Simd, L: Leaves>(self, leaves: L) -> Hit {
        let Single { scene, ray, query, .. } = self;
        // SAFETY: the caller's contract.
        unsafe {
            let mut ray_state = RayState::none();
            match ray_state.prepare::<S>(ray, scene, query) {
                Readiness::Ready => {}
                Readiness::Misses => return Hit::MISS,
                Readiness::Special => return S::call(Unusual(self)),
            }
            // Each query by itself: in what it does nothing asks which one it is. A page would load both: there one answers both.
            if query == Query::Any && !cfg!(target_family = "wasm") {
                let single = Single { query: Query::Any, ..self };
                return single.through_short::<S, _, _, true, ENTRIES>(
                    leaves,
                    &mut ray_state,
                    KeepAll,
                );
            }
            let query = if cfg!(target_family = "wasm") { query } else { Query::Closest };
            let single = Single { query, ..self };
            single.through_short::<S, _, _, true, ENTRIES>(leaves, &mut ray_state, KeepAll)
        }
    }

    /// The hit where there is no memory for a stack: by the reference, which needs none.
    #[cold]
    fn without_memory(&self) -> Hit {
        let Single { layout, scene, ray, options, query } = *self;
        if options.accuracy == Accuracy::Exact {
            return exact::trace_in_f64(layout, &scene.bounds, ray, options, query);
        }
        reference::trace(layout, scene, ray, options, query)
    }

    /// The hit of a prepared ray, whatever the leaves; `None` where there is no memory for a stack.
    ///
    /// # Safety
    /// As for [`Compiled::run`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn through_any<S: Simd, K: Keep>(
        &self,
        ray_state: &mut RayState,
        keep: K,
    ) -> Option<Hit> {
        // SAFETY: the caller's contract.
        unsafe {
            match IndexedLeaves::of(self.layout) {
                None => {
                    let leaves = PackedLeaves::new(self.layout);
                    self.through::<S, _, K, ENTRIES>(leaves, ray_state, keep)
                }
                Some(leaves) => {
                    self.through::<S, IndexedLeaves<'_>, K, ENTRIES>(leaves, ray_state, keep)
                }
            }
        }
    }

    /// # Safety
    /// As for [`Compiled::run`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn through<S: Simd, L: Leaves, K: Keep, const ENTRIES: usize>(
        &self,
        leaves: L,
        ray_state: &mut RayState,
        keep: K,
    ) -> Option<Hit> {
        let room = self.layout.wide.stack();
        // One walk for both stacks: only unusual rays come here.
        let (mut children, mut t) = (Vec::new(), Vec::new());
        let mut short_children = [MaybeUninit::<u32>::uninit(); ENTRIES];
        let mut short_t = [MaybeUninit::<f32>::uninit(); ENTRIES];
        let stack = if room > ENTRIES {
            if lengthen(&mut children, room, 0).and(lengthen(&mut t, room, 0.0)).is_err() {
                return None;
            }
            TraversalStack { children: children.as_mut_ptr(), t: t.as_mut_ptr() }
        } else {
            let children = short_children.as_mut_ptr().cast();
            TraversalStack { children, t: short_t.as_mut_ptr().cast() }
        };
        // SAFETY: the caller's contract; stacks of no less length.
        Some(unsafe { self.walk::<S, L, K, false>(leaves, ray_state, stack, keep) })
    }

    /// With a stack that needs no allocation.
    ///
    /// # Safety
    /// As for [`Compiled::run`]; the nodes must need no more entries; the accuracy must be `watertight` where that is said.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn through_short<
        S: Simd,
        L: Leaves,
        K: Keep,
        const WATERTIGHT: bool,
        const ENTRIES: usize,
    >(
        &self,
        leaves: L,
        ray_state: &mut RayState,
        keep: K,
    ) -> Hit {
        let mut children = [MaybeUninit::<u32>::uninit(); ENTRIES];
        let mut t = [MaybeUninit::<f32>::uninit(); ENTRIES];
        let stack =
            TraversalStack { children: children.as_mut_ptr().cast(), t: t.as_mut_ptr().cast() };
        // SAFETY: the caller's contract.
        unsafe { self.walk::<S, L, K, WATERTIGHT>(leaves, ray_state, stack, keep) }
    }

    /// # Safety
    /// As for [`Compiled::run`]; the stack must have as many entries as the nodes need; the accuracy must be `watertight` where
    /// that is said.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn walk<S: Simd, L: Leaves, K: Keep, const WATERTIGHT: bool>(
        &self,
        leaves: L,
        ray_state: &mut RayState,
        mut stack: TraversalStack,
        keep: K,
    ) -> Hit {
        let Single { layout, options, query, .. } = *self;
        let lines = layout.wide.lines().as_ptr();
        let test = &TestContext { leaves, options, query, keep };
        let (mut room, mut best) = (L::room(), BestHit::NONE);
        let (room, best) = (&mut room, &mut best);
        let tested = &mut RayTest { test, room, ray_state, best, exact: None };
        // SAFETY: the stack has the space; the caller's contract.
        let alone = unsafe {
            stack.begin();
            Alone::<S>::new(tested.ray_state)
        };
        let (mut child, mut top) = (0, 0);
        loop {
            while !is_leaf(child) {
                // SAFETY: the caller's contract; the child is a node; the stack has the space.
                (child, top) = unsafe { alone.step(tested.ray_state, lines, child, &stack, top) };
            }
            if child == DONE {
                return tested.best.hit;
            }
            // A block's header says where its corners are; their loads need not wait for it.
            ask_for_block::<S, L>(leaves, child);
            // SAFETY: the caller's contract; children name nodes or leaves; the ray is not wide. In the same function, since a call
            // takes as long as a third of a node.
            let better = unsafe {
                assert_unchecked(!WATERTIGHT || options.accuracy == Accuracy::Watertight);
                TestLeaf(child, tested).run::<S>()
            };
            if better {
                if query == Query::Any {
                    return tested.best.hit;
                }
                let stop = tested.best.stop.min(tested.ray_state.stop);
                tested.ray_state.stop = stop;
                // SAFETY: the caller's contract; the stack has the space.
                top = unsafe { stack.cull::<S>(top, stop) };
            }
            // SAFETY: entries that were written.
            child = unsafe { *stack.children.add(top) };
            top = top.wrapping_sub(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use splitplane_core::backend::{Accelerator, BuildOptions};
    use splitplane_core::mesh::Mesh;
    use splitplane_test_support::random::Random;

    use super::*;
    use crate::CpuBackend;
    use crate::simd::InstructionSet;

    /// With a stack that is too short, and one that is long enough.
    struct Both<'a>(Single<'a>);

    impl Compiled for Both<'_> {
        type Output = [Hit; 2];

        #[cfg_attr(not(unoptimised), inline(always))]
        unsafe fn run<S: Simd>(self) -> [Hit; 2] {
            let Single { layout, scene, ray, query, .. } = self.0;
            let (mut ray_state, mut again) = (RayState::none(), RayState::none());
            let leaves = PackedLeaves::new(layout);
            // SAFETY: the caller's contract.
            unsafe {
                let Readiness::Ready = ray_state.prepare::<S>(ray, scene, query) else {
                    return [Hit::MISS; 2];
                };
                again.prepare::<S>(ray, scene, query);
                [
                    self.0.through::<S, _, _, 1>(leaves, &mut ray_state, KeepAll),
                    self.0.through::<S, _, _, ENTRIES>(leaves, &mut again, KeepAll),
                ]
                .map(|hit| hit.expect("memory"))
            }
        }
    }

    /// Trees may be deeper than the machine's stack has space for.
    #[test]
    fn stacks_of_any_length_give_the_same_hits() {
        let mut random = Random::new(3);
        let mut point = |spread: f64| [(); 3].map(|()| random.between(-spread, spread) as f32);
        let triangles: Vec<_> = (0..3000)
            .map(|_| {
                let (at, a, b) = (point(1.0), point(0.1), point(0.1));
                [at, [0, 1, 2].map(|k| at[k] + a[k]), [0, 1, 2].map(|k| at[k] + b[k])]
            })
            .collect();
        let rays: Vec<Ray> = (0..500)
            .map(|_| {
                let (from, to) = (point(3.0), point(1.0));
                Ray::new(from, [0, 1, 2].map(|k| to[k] - from[k]))
            })
            .collect();
        let mesh = Mesh::soup(&triangles).expect("a mesh");
        for set in InstructionSet::available() {
            let built = CpuBackend::with_instruction_set(set)
                .build_accelerator(&mesh, &BuildOptions::default())
                .expect("a tree");
            let (layout, scene) = built.parts();
            let options = &QueryOptions::default();
            let mut found = 0;
            for ray in &rays {
                let single = Single { layout, scene, ray, options, query: Query::Closest };
                // SAFETY: a set of this processor, and its layout.
                let [long, short] = unsafe { set.run(Both(single)) };
                let expected = built.closest_hit(ray, options).unwrap_or(Hit::MISS);
                assert_eq!([long, short], [expected; 2], "{set:?} {ray:?}");
                found += usize::from(expected.is_hit());
            }
            assert!(found > 100, "{found}");
        }
    }
}
