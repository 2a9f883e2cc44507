//! Rays through the tree over instances, a node's eight boxes at once.
//!
//! Each box is tested by the operations that [`TopRay`] states, each rounded by itself, so a ray enters what it enters in
//! the core's walk. Which of a box's two planes on an axis comes first is known from the direction; the core compares them.

use splitplane_core::backend::scene::SceneAnswer;
use splitplane_core::query::traverse::Query;
use splitplane_core::scene::{
    SceneHit, TOP_INSTANCE, TOP_NONE, TOP_WIDTH, TopNode, TopRay, TopStack, TopWalk, TopWalker,
};

use crate::simd::{Compiled, InstructionSet, Simd};

/// Walks by vectors, for rays in waves.
pub(super) struct VectorWalker {
    pub(super) set: InstructionSet,
}

impl TopWalker for VectorWalker {
    fn advance(
        &mut self,
        walk: TopWalk<'_>,
        t_max: impl Fn(u32) -> f32,
        accept: impl FnMut(u32, u32) -> bool,
    ) {
        // SAFETY: the set is one of this processor's.
        unsafe { self.set.run(Advance { walk, t_max, accept }) }
    }
}

struct Advance<'a, T, A> {
    walk: TopWalk<'a>,
    t_max: T,
    accept: A,
}

impl<T: Fn(u32) -> f32, A: FnMut(u32, u32) -> bool> Compiled for Advance<'_, T, A> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let Advance { walk: TopWalk { tree, rays, stacks, tops, active }, t_max, mut accept } =
            self;
        let (nodes, room) = (tree.nodes(), tree.stack());
        let mut kept = 0;
        for place in 0..active.len() {
            let index = active[place];
            let at = index as usize;
            let Some(ray) = &rays[at] else { continue };
            let ray = VectorRay::new(ray);
            let stack = &mut stacks[at * room..][..room];
            let (mut top, stop) = (tops[at], TopRay::stop_after(t_max(index)));
            // SAFETY: the caller's contract; the tree's nodes, and a stack for it.
            let found = unsafe {
                loop {
                    match next::<S::Eight, SceneHit>(
                        nodes,
                        &ray,
                        stop,
                        stack.as_mut_ptr(),
                        &mut top,
                    ) {
                        Some(name) if !accept(index, name) => {}
                        found => break found,
                    }
                }
            };
            tops[at] = top;
            active[kept] = index;
            kept += usize::from(found.is_some());
        }
        active.truncate(kept);
    }
}

/// A [`TopRay`] with what vectors need of it.
#[derive(Clone, Copy)]
pub(super) struct VectorRay {
    origin: [f32; 3],
    reciprocal: [f32; 3],
    /// The greatest component of the origin, with the sign by which planes that come first move outwards.
    outwards: [f32; 3],
    /// Whether the upper planes come first.
    negative: [bool; 3],
    t_min: f32,
    tame: bool,
}

impl VectorRay {
    /// No ray.
    pub(super) const NONE: VectorRay = VectorRay {
        origin: [0.0; 3],
        reciprocal: [0.0; 3],
        outwards: [0.0; 3],
        negative: [false; 3],
        t_min: 0.0,
        tame: false,
    };

    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn new(ray: &TopRay) -> VectorRay {
        let TopRay { origin, reciprocal, distance, t_min, tame } = *ray;
        let [x, y, z] = reciprocal;
        let negative = [x < 0.0, y < 0.0, z < 0.0];
        let sign = |negative: bool| if negative { distance } else { -distance };
        let outwards = [sign(negative[0]), sign(negative[1]), sign(negative[2])];
        VectorRay { origin, reciprocal, outwards, negative, t_min, tame }
    }
}

/// The next instance that the ray enters up to `stop`, for closest hits in the order of boxes; see [`TopTree::next`](splitplane_core::scene::TopTree::next).
///
/// # Safety
/// The processor must have the set, which must have eight lanes. The nodes must be all those of a tree, and the stack must have the
/// entries that it needs, of which `top` have been written by this function or by [`TopTree::begin`](splitplane_core::scene::TopTree::begin) for the same tree and ray.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn next<S: Simd, T: SceneAnswer>(
    nodes: &[TopNode],
    ray: &VectorRay,
    stop: f32,
    stack: *mut TopStack,
    top: &mut usize,
) -> Option<u32> {
    while *top > 0 {
        *top -= 1;
        // SAFETY: an entry that was written.
        let (enter, mut child) = unsafe { *stack.add(*top) };
        if enter > stop {
            continue;
        }
        // A node's nearest child is entered at once.
        while child & TOP_INSTANCE == 0 {
            // SAFETY: the caller's contract.
            child = unsafe {
                spread::<S, T>(nodes.get_unchecked(child as usize), ray, stop, stack, top)
            };
        }
        if child != TOP_NONE {
            return Some(child & !TOP_INSTANCE);
        }
    }
    None
}

/// Puts the children of a node that the ray enters on the stack, for closest hits the nearest last, except the one that is next, which is
/// returned; or `TOP_NONE`.
///
/// # Safety
/// As for [`next`].
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn spread<S: Simd, T: SceneAnswer>(
    node: &TopNode,
    ray: &VectorRay,
    stop: f32,
    stack: *mut TopStack,
    top: &mut usize,
) -> u32 {
    // Sorting takes longer than what it saves for rays that any hit ends.
    let is_ordered = T::QUERY == Query::Closest;
    let mut entered = [-f32::MAX; TOP_WIDTH];
    let mut met = if ray.tame {
        // SAFETY: the caller's contract; rows have eight numbers.
        unsafe {
            let reach = S::load(node.reach.as_ptr());
            let (mut near, mut far) = (S::splat(ray.t_min), S::splat(stop));
            for axis in 0..3 {
                let [first, last] = if ray.negative[axis] {
                    [&node.hi[axis], &node.lo[axis]]
                } else {
                    [&node.lo[axis], &node.hi[axis]]
                };
                let outwards = S::mul(reach, S::splat(ray.outwards[axis]));
                let (origin, reciprocal) =
                    (S::splat(ray.origin[axis]), S::splat(ray.reciprocal[axis]));
                let first = S::sub(S::add(S::load(first.as_ptr()), outwards), origin);
                let last = S::sub(S::sub(S::load(last.as_ptr()), outwards), origin);
                near = S::max(S::mul(first, reciprocal), near);
                far = S::min(S::mul(last, reciprocal), far);
            }
            S::store(entered.as_mut_ptr(), S::min(near, S::splat(f32::MAX)));
            // Where there is no child, the planes are in the wrong order, and nothing is met.
            S::bits(S::le(near, far))
        }
    } else {
        there(node)
    };
    if met == 0 {
        return TOP_NONE;
    }
    let mut slot = met.trailing_zeros() as usize;
    met &= met - 1;
    let (bottom, mut end) = (*top, *top);
    // SAFETY: slots are below eight; the stack has the space.
    unsafe {
        let mut nearest = *entered.get_unchecked(slot);
        while met != 0 {
            let mut other = met.trailing_zeros() as usize;
            met &= met - 1;
            let mut t = *entered.get_unchecked(other);
            // Of equals, the first child is the next.
            let is_nearer = is_ordered && t < nearest;
            (slot, other) = if is_nearer { (other, slot) } else { (slot, other) };
            (nearest, t) = if is_nearer { (t, nearest) } else { (nearest, t) };
            let mut at = end;
            while is_ordered && at > bottom && (*stack.add(at - 1)).0 <= t {
                *stack.add(at) = *stack.add(at - 1);
                at -= 1;
            }
            *stack.add(at) = (t, *node.children.get_unchecked(other));
            end += 1;
        }
        *top = end;
        *node.children.get_unchecked(slot)
    }
}

/// The places of a node that have a child, as bits.
#[cold]
fn there(node: &TopNode) -> u32 {
    let mut bits = 0;
    for (slot, child) in node.children.iter().enumerate() {
        bits |= u32::from(*child != TOP_NONE) << slot;
    }
    bits
}
