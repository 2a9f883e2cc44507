//! Rays through the tree over instances, a node's eight boxes at once.
//!
//! Where the core takes `((plane -+ reach distance) - origin) reciprocal`, vectors take `plane reciprocal - (origin reciprocal +- reach w)`,
//! with `w` the distance times the magnitude of the reciprocal: the same number, rounded elsewhere. Its roundings are at most three of the
//! plane, four of the origin and five of what the box is widened by, and one of the result: fewer than boxes allow for (`TEST_ROUNDINGS`). So a ray may
//! enter other boxes than in the core's walk where it touches them, but none is missed that could have a hit. A box
//! within another is still never entered before the other. Rays of accuracy `fast`, whose hits are not bound to boxes, are tested by the core's own
//! operations, so that all backends enter the same instances. Which of a box's two planes on an axis comes first is known from the direction.

use core::mem::offset_of;

use splitplane_core::backend::scene::SceneAnswer;
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::Accuracy;
use splitplane_core::scene::{
    SceneHit, TOP_INSTANCE, TOP_NONE, TOP_WIDTH, TopNode, TopRay, TopStack, TopWalk, TopWalker,
};

use crate::simd::{Compiled, InstructionSet, MOST_LANES, Simd};

/// Walks by vectors, for rays in waves.
pub(super) struct VectorWalker {
    pub(super) set: InstructionSet,
    pub(super) accuracy: Accuracy,
}

impl TopWalker for VectorWalker {
    fn advance(
        &mut self,
        walk: TopWalk<'_>,
        t_max: impl Fn(u32) -> f32,
        accept: impl FnMut(u32, u32) -> bool,
    ) {
        // SAFETY: the set is one of this processor's.
        unsafe { self.set.run(Advance { walk, t_max, accept, accuracy: self.accuracy }) }
    }
}

struct Advance<'a, T, A> {
    walk: TopWalk<'a>,
    t_max: T,
    accept: A,
    accuracy: Accuracy,
}

impl<T: Fn(u32) -> f32, A: FnMut(u32, u32) -> bool> Compiled for Advance<'_, T, A> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let Advance {
            walk: TopWalk { tree, rays, stacks, tops, active },
            t_max,
            mut accept,
            accuracy,
        } = self;
        let (nodes, room, reach) = (tree.nodes(), tree.stack(), tree.reach());
        let mut kept = 0;
        for place in 0..active.len() {
            let index = active[place];
            let at = index as usize;
            let Some(ray) = &rays[at] else { continue };
            let ray = VectorRay::new(ray, accuracy, reach);
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

/// Greatest product of an origin and a reciprocal: sums of two do not overflow.
pub(super) const PRODUCT_MOST: f32 = 8.507_059e37; // 2^126

/// Where no box is widened by more than this, per unit of the origin, all are widened as much as the one that is widened most: 2^-14. So little costs no
/// entry worth speaking of, and saves a third of the operations.
pub(super) const ALIKE_MOST: f32 = 6.103_515_6e-5;

/// Where a node has the planes that a ray meets first, and those that it meets last, in bytes.
#[derive(Clone, Copy)]
pub(super) struct Planes {
    first: [u32; 3],
    last: [u32; 3],
}

impl Planes {
    /// Of no ray.
    pub(super) const NONE: Planes = Planes { first: [0; 3], last: [0; 3] };

    /// Those of an axis, for rays that go one way along it.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn set(&mut self, axis: usize, negative: bool) {
        let row = (axis * size_of::<[f32; TOP_WIDTH]>()) as u32;
        let (lo, hi) = (offset_of!(TopNode, lo) as u32 + row, offset_of!(TopNode, hi) as u32 + row);
        (self.first[axis], self.last[axis]) = if negative { (hi, lo) } else { (lo, hi) };
    }

    /// The planes of an axis that come first.
    ///
    /// # Safety
    /// The processor must have the set, which must have eight lanes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn first<S: Simd>(&self, node: &TopNode, axis: usize) -> S::Floats {
        // SAFETY: the caller's contract; rows have eight numbers.
        unsafe { S::load(core::ptr::from_ref(node).byte_add(self.first[axis] as usize).cast()) }
    }

    /// Those that come last.
    ///
    /// # Safety
    /// As for [`Planes::first`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn last<S: Simd>(&self, node: &TopNode, axis: usize) -> S::Floats {
        // SAFETY: the caller's contract; rows have eight numbers.
        unsafe { S::load(core::ptr::from_ref(node).byte_add(self.last[axis] as usize).cast()) }
    }

    /// Both planes of a child.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn of(&self, node: &TopNode, axis: usize, slot: usize) -> [f32; 2] {
        let (lo, hi) = (node.lo[axis][slot % TOP_WIDTH], node.hi[axis][slot % TOP_WIDTH]);
        if self.first[axis] < self.last[axis] { [lo, hi] } else { [hi, lo] }
    }
}

/// A [`TopRay`] as vectors need it.
#[derive(Clone, Copy)]
pub(super) struct VectorRay {
    reciprocal: [f32; 3],
    /// What is taken from planes that come first, and from those that come last, times the reciprocal: the origin times it and, where
    /// all boxes are widened alike, what that moves them by.
    first: [f32; 3],
    last: [f32; 3],
    /// How far planes move for a box that is widened by 1 per unit of the origin, in units of the ray.
    widening: [f32; 3],
    planes: Planes,
    t_min: f32,
    /// False for a ray that enters everything.
    tame: bool,
    widened: Widened,
}

/// How boxes are widened.
#[derive(Clone, Copy)]
enum Widened {
    /// All alike.
    Alike,
    /// Each by its own reach.
    Apart,
    /// By the core's operations, which need the origin and its greatest component.
    AsCore([f32; 3], f32),
}

impl VectorRay {
    /// No ray.
    pub(super) const NONE: VectorRay = VectorRay {
        reciprocal: [0.0; 3],
        first: [0.0; 3],
        last: [0.0; 3],
        widening: [0.0; 3],
        planes: Planes::NONE,
        t_min: 0.0,
        tame: false,
        widened: Widened::Apart,
    };

    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn new(ray: &TopRay, accuracy: Accuracy, reach: f32) -> VectorRay {
        let TopRay { origin, reciprocal, distance, t_min, tame } = *ray;
        let as_core = accuracy == Accuracy::Fast;
        let widened = match () {
            () if as_core => Widened::AsCore(origin, distance),
            () if reach <= ALIKE_MOST => Widened::Alike,
            () => Widened::Apart,
        };
        let alike = if matches!(widened, Widened::Alike) { reach } else { 0.0 };
        let mut own = VectorRay { reciprocal, t_min, tame, widened, ..VectorRay::NONE };
        for axis in 0..3 {
            let from = origin[axis] * reciprocal[axis];
            own.widening[axis] = distance * reciprocal[axis].abs();
            let out = alike * own.widening[axis];
            (own.first[axis], own.last[axis]) = (from + out, from - out);
            own.tame &= as_core | (own.widening[axis] <= PRODUCT_MOST);
            own.planes.set(axis, reciprocal[axis] < 0.0);
        }
        own
    }
}

/// The next instance that the ray enters up to `stop`, for closest hits in the order of boxes; see
/// [`TopTree::next`](splitplane_core::scene::TopTree::next).
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
        let TopStack { enter, mut child } = unsafe { *stack.add(*top) };
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
    // SAFETY: the caller's contract; a node's stack has space for eight entries.
    unsafe {
        let (enter, mut met) = if ray.tame {
            let [near, far] = enter_and_leave::<S>(node, ray, stop);
            // Where there is no child, the planes are in the wrong order, and nothing is met.
            let near = S::min(near, S::splat(f32::MAX));
            (near, S::bits(S::le(near, far)))
        } else {
            (S::splat(-f32::MAX), there(node))
        };
        if met == 0 {
            return TOP_NONE;
        }
        let children = node.children.as_ptr();
        let mut slot = met.trailing_zeros() as usize;
        met &= met - 1;
        // Sorting takes longer than what it saves for rays that any hit ends.
        if T::QUERY == Query::Any {
            S::push_pairs(enter, children, met, stack.add(*top).cast());
            *top += met.count_ones() as usize;
            return *children.add(slot);
        }
        let mut entered = [0.0; MOST_LANES];
        S::store(entered.as_mut_ptr(), enter);
        let (bottom, mut end) = (*top, *top);
        let mut nearest = *entered.get_unchecked(slot);
        while met != 0 {
            let mut other = met.trailing_zeros() as usize;
            met &= met - 1;
            let mut t = *entered.get_unchecked(other);
            // Of equals, the first child is the next.
            let is_nearer = t < nearest;
            (slot, other) = if is_nearer { (other, slot) } else { (slot, other) };
            (nearest, t) = if is_nearer { (t, nearest) } else { (nearest, t) };
            let mut at = end;
            while at > bottom && (*stack.add(at - 1)).enter <= t {
                *stack.add(at) = *stack.add(at - 1);
                at -= 1;
            }
            *stack.add(at) = TopStack { enter: t, child: *children.add(other) };
            end += 1;
        }
        *top = end;
        *children.add(slot)
    }
}

/// Where the ray enters a node's boxes and where it leaves them, within its limits.
///
/// # Safety
/// As for [`next`].
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn enter_and_leave<S: Simd>(node: &TopNode, ray: &VectorRay, stop: f32) -> [S::Floats; 2] {
    // SAFETY: the caller's contract; rows have eight numbers.
    unsafe {
        let (mut near, mut far) = (S::splat(ray.t_min), S::splat(stop));
        match ray.widened {
            Widened::Alike => {
                for axis in 0..3 {
                    let reciprocal = S::splat(ray.reciprocal[axis]);
                    let first = ray.planes.first::<S>(node, axis);
                    let last = ray.planes.last::<S>(node, axis);
                    near = S::max(S::mul_sub(first, reciprocal, S::splat(ray.first[axis])), near);
                    far = S::min(S::mul_sub(last, reciprocal, S::splat(ray.last[axis])), far);
                }
            }
            Widened::Apart => {
                let reach = S::load(node.reach.as_ptr());
                for axis in 0..3 {
                    let reciprocal = S::splat(ray.reciprocal[axis]);
                    let (first, last) =
                        (ray.planes.first::<S>(node, axis), ray.planes.last::<S>(node, axis));
                    let from = S::splat(ray.first[axis]);
                    let out = S::mul(reach, S::splat(ray.widening[axis]));
                    near = S::max(S::mul_sub(first, reciprocal, S::add(from, out)), near);
                    far = S::min(S::mul_sub(last, reciprocal, S::sub(from, out)), far);
                }
            }
            Widened::AsCore(origin, distance) => {
                let reach = S::load(node.reach.as_ptr());
                for axis in 0..3 {
                    let reciprocal = S::splat(ray.reciprocal[axis]);
                    let (first, last) =
                        (ray.planes.first::<S>(node, axis), ray.planes.last::<S>(node, axis));
                    let outwards = if ray.reciprocal[axis] < 0.0 { distance } else { -distance };
                    let outwards = S::mul(reach, S::splat(outwards));
                    let origin = S::splat(origin[axis]);
                    let first = S::sub(S::add(first, outwards), origin);
                    let last = S::sub(S::sub(last, outwards), origin);
                    near = S::max(S::mul(first, reciprocal), near);
                    far = S::min(S::mul(last, reciprocal), far);
                }
            }
        }
        [near, far]
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
