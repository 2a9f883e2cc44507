//! One ray per call through a scene: from instance to instance, by the geometries' own traversals of one ray.

use core::marker::PhantomData;
use core::mem::MaybeUninit;

use splitplane_core::backend::scene::{Asked, BuiltScene, SceneAnswer, seen_by};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Hit, Ray};
use splitplane_core::scene::{InstanceId, SceneHit, SceneOptions, TopRay, TopStack, WIDEST_STACK};

use super::counting::KeepOf;
use super::parts::{Reached, reached};
use super::top_walk::{VectorRay, next};
use crate::simd::{Compiled, InstructionSet, Simd};
use crate::trace::single::{Single, SingleKept};

/// A ray through a scene. `set` must be the one that it is compiled for.
pub(super) struct SceneSingle<'a> {
    pub(super) scene: &'a BuiltScene,
    pub(super) ray: &'a Ray,
    pub(super) options: &'a SceneOptions<'a>,
    pub(super) set: InstructionSet,
}

/// What comes of a ray.
pub(super) enum Followed<T> {
    /// Its answer.
    Answer(T),
    /// Nothing: it enters an instance of a geometry of another backend or set.
    Elsewhere,
}

impl SceneSingle<'_> {
    /// Follows the ray.
    ///
    /// # Safety
    /// The processor must have the set.
    pub(super) unsafe fn follow<T: SceneAnswer>(self) -> Followed<T> {
        let set = self.set;
        // SAFETY: the caller's contract.
        unsafe { set.run(Following(self, PhantomData)) }
    }
}

/// The task of following it.
pub(super) struct Following<'a, T>(pub(super) SceneSingle<'a>, pub(super) PhantomData<T>);

impl<T: SceneAnswer> Compiled for Following<'_, T> {
    type Output = Followed<T>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Followed<T> {
        let SceneSingle { scene, ray, options, set } = self.0;
        let mut answer = T::NONE;
        let Some(top_ray) = TopRay::new(ray) else { return Followed::Answer(answer) };
        let top_ray = VectorRay::new(&top_ray, options.accuracy, scene.top_tree().reach());
        let nodes = scene.top_tree().nodes();
        // Not cleared: that takes as long as a few nodes.
        let mut stack = [MaybeUninit::<TopStack>::uninit(); WIDEST_STACK];
        let stack: *mut TopStack = stack.as_mut_ptr().cast();
        let mut top = usize::from(!nodes.is_empty());
        // SAFETY: the stack has space for the root.
        unsafe { stack.write(TopStack::ROOT) };
        loop {
            let best = answer.best();
            let stop = TopRay::stop_after(ray.t_max.min(best.t));
            // SAFETY: the caller's contract; the tree's nodes, and a stack for every tree.
            let found = unsafe { next::<S::Eight, T>(nodes, &top_ray, stop, stack, &mut top) };
            let Some(name) = found else { return Followed::Answer(answer) };
            let instance = InstanceId(name);
            let Some(placement) = scene.placement(instance) else { continue };
            let Some(asked) = Asked::of(instance, placement, options) else { continue };
            let geometry = placement.instance.geometry;
            let Some(built) = scene.geometry(geometry) else { continue };
            let Some(reached) = reached(built, set) else { return Followed::Elsewhere };
            let seen = &seen_by(placement, ray, &best);
            let asked = &options.of_geometry(asked.culling, asked.ignore, None);
            let kept = built.kept(geometry, instance, options);
            let hit = match reached {
                Reached::Shapes(shapes) => {
                    let keep = |hit: &Hit| kept.is_none_or(|kept| kept.keeps(hit));
                    shapes.trace(seen, asked, T::QUERY, keep)
                }
                Reached::Triangles(accelerator) => {
                    let (layout, scene) = accelerator.parts();
                    let single =
                        Single { layout, scene, ray: seen, options: asked, query: T::QUERY };
                    // SAFETY: the caller's contract; the geometry was made for the set.
                    unsafe {
                        match kept {
                            None => S::call(single),
                            Some(kept) => {
                                let own = SingleKept { single, keep: KeepOf(kept) };
                                S::call(own).unwrap_or_else(|| {
                                    // A hit of which not all parts are known cannot be judged.
                                    let closest = Single { query: Query::Closest, ..single };
                                    let first = S::call(closest);
                                    kept.next(built, seen, first, (asked, T::QUERY), &mut 0)
                                })
                            }
                        }
                    }
                }
            };
            let found = SceneHit::of(&hit, geometry, instance);
            if found.is_hit() && found.precedes(&answer.best()) && answer.take(found) {
                return Followed::Answer(answer);
            }
        }
    }
}
