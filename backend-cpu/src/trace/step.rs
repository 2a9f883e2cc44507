//! One step of a ray: a wide node, whose boxes are tested all at once, or the contents of a child
//! that is not a node.

use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{QueryOptions, Rays};

use super::block_test::BestHit;
use super::keep::{Keep, KeepAll};
use super::leaves::Leaves;
use super::ray_state::RayState;
use super::sieve::ExactLane;
use crate::layout::wide_node::{
    CacheLine, DONE, bounds_offset, children_offset, leaf_bit, leaf_number, lines_of_node,
    order_offset,
};
use crate::simd::{Compiled, Direction, Simd, not_known, prefetch};
use crate::trace::block_test as leaf;

/// The parts of a node that rays of an octant read, in bytes from its start.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Octant {
    /// Rows of the planes that they meet first on x, y and z, and of those that they meet last.
    pub near: [u32; 3],
    pub far: [u32; 3],
    /// The order of the children.
    pub order: u32,
    pub direction: Direction,
}

/// Octants by [`RayState::octant`], for nodes of `lanes` children.
const fn octants(lanes: usize) -> [Octant; 16] {
    let direction = Direction::new(lanes, false);
    let mut octants = [Octant { near: [0; 3], far: [0; 3], order: 0, direction }; 16];
    let mut i = 0;
    while i < 16 {
        let [x, y, z, reversed] = [i & 1, i >> 1 & 1, i >> 2 & 1, i >> 3];
        let signs = [x, y, z];
        let mut axis = 0;
        while axis < 3 {
            let (low, high) = (bounds_offset(lanes, axis, false), bounds_offset(lanes, axis, true));
            octants[i].near[axis] = if signs[axis] == 0 { low } else { high } as u32;
            octants[i].far[axis] = if signs[axis] == 0 { high } else { low } as u32;
            axis += 1;
        }
        octants[i].order = order_offset(lanes, (x ^ z) + 2 * (y ^ z)) as u32;
        octants[i].direction = Direction::new(lanes, z ^ reversed != 0);
        i += 1;
    }
    octants
}

static OCTANTS_OF_8: [Octant; 16] = octants(8);
static OCTANTS_OF_16: [Octant; 16] = octants(16);

/// Octants for nodes of as many children as lanes.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn octants_of<S: Simd>() -> &'static [Octant; 16] {
    if S::N == 16 { &OCTANTS_OF_16 } else { &OCTANTS_OF_8 }
}

/// A ray's stack: children to visit, and where the ray enters them.
///
/// Pointers without bounds: every step reads and writes here.
pub(crate) struct TraversalStack {
    pub children: *mut u32,
    pub t: *mut f32,
}

impl TraversalStack {
    /// An entry, and those after it.
    ///
    /// # Safety
    /// There must be as many.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn at(&self, entry: usize) -> TraversalStack {
        // SAFETY: the caller's contract.
        unsafe { TraversalStack { children: self.children.add(entry), t: self.t.add(entry) } }
    }

    /// Writes the sentinel at the bottom.
    ///
    /// # Safety
    /// There must be space for an entry.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn begin(&mut self) {
        // SAFETY: the caller's contract.
        unsafe { (*self.children, *self.t) = (DONE, f32::NEG_INFINITY) }
    }

    /// Drops entries beyond `stop`. Returns the new last entry.
    ///
    /// # Safety
    /// The processor must have the set; the stack must have space for 16 more entries.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn cull<S: Simd>(&mut self, top: usize, stop: f32) -> usize {
        // SAFETY: the caller's contract; the lowest entry stays.
        unsafe { S::cull(self.children.add(1), self.t.add(1), top, stop) }
    }
}

/// A ray alone at nodes: where in a node its octant has what it reads, and those of its numbers for which most sets have registers.
#[derive(Clone, Copy)]
pub(crate) struct Alone<'a, S: Simd> {
    /// In bytes.
    near: [usize; 3],
    far: [usize; 3],
    order: usize,
    direction: &'a Direction,
    /// As in [`RayState`].
    reciprocal: [S::Floats; 3],
    exit_reciprocal: [S::Floats; 3],
}

impl<S: Simd> Alone<'_, S> {
    /// For a ray.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn new(ray_state: &RayState) -> Self {
        // SAFETY: the caller's contract; an octant is below 16.
        unsafe {
            let octant = octants_of::<S>().get_unchecked(ray_state.octant as usize);
            let Octant { near: [nx, ny, nz], far: [fx, fy, fz], order, direction } = octant;
            let [x, y, z] = ray_state.reciprocal;
            let [exit_x, exit_y, exit_z] = ray_state.exit_reciprocal;
            Alone {
                near: [*nx as usize, *ny as usize, *nz as usize],
                far: [*fx as usize, *fy as usize, *fz as usize],
                order: *order as usize,
                direction,
                reciprocal: [S::splat(x), S::splat(y), S::splat(z)],
                exit_reciprocal: [S::splat(exit_x), S::splat(exit_y), S::splat(exit_z)],
            }
        }
    }

    /// Takes a step at a node: puts the children that the ray meets behind the stack's last entry, which is `top`, except the
    /// nearest. Returns where the ray goes next, and the new last entry.
    ///
    /// # Safety
    /// The processor must have the set; the ray must be the one that this is for; the node must be one of the lines; the stack must
    /// have space for 16 more entries.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn step(
        &self,
        ray_state: &RayState,
        lines: *const CacheLine,
        node: u32,
        stack: &TraversalStack,
        top: usize,
    ) -> (u32, usize) {
        // SAFETY: the caller's contract.
        unsafe {
            // Read in each step, for which nothing waits: kept they would be on the machine's stack, and eight times as long.
            let RayState { near, far, enter, stop, .. } = &*not_known(ray_state);
            let node = lines.add(node as usize * lines_of_node(S::N)).cast::<u8>();
            let plane = |row: usize| S::load(node.add(row).cast());
            let [x, y, z] = self.reciprocal;
            let enter_x = S::mul_sub(plane(self.near[0]), x, S::splat(near[0]));
            let enter_y = S::mul_sub(plane(self.near[1]), y, S::splat(near[1]));
            let enter_z = S::mul_sub(plane(self.near[2]), z, S::splat(near[2]));
            let [x, y, z] = self.exit_reciprocal;
            let exit_x = S::mul_sub(plane(self.far[0]), x, S::splat(far[0]));
            let exit_y = S::mul_sub(plane(self.far[1]), y, S::splat(far[1]));
            let exit_z = S::mul_sub(plane(self.far[2]), z, S::splat(far[2]));
            // Places without a child are entered at infinity.
            let enter = S::max(S::max(enter_x, enter_y), S::max(enter_z, S::splat(*enter)));
            let exit = S::min(S::min(exit_x, exit_y), S::min(exit_z, S::splat(*stop)));
            let last = stack.at(top);
            let (child, count) = S::push_met_alone(
                node.add(children_offset(S::N)).cast(),
                enter,
                exit,
                node.add(self.order),
                self.direction,
                last.children.add(1),
                last.t.add(1),
            );
            (child, (top + count).wrapping_sub(1))
        }
    }
}

/// Takes a step at a node: puts the children that the ray meets on the stack, whose last entries are at `top`, except the nearest. Returns
/// where the ray goes next, and how many children were put on the stack: with as many entries more, less one, the last one is
/// there. For a ray among others.
///
/// The nearest child is read back from the stack: that is later, while others take their steps, but finding it in the node as
/// well takes 10 instructions of a hundred.
///
/// # Safety
/// The processor must have the set; the node must be one of the lines; the stack must have space
/// for 16 more entries.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn step_in_turn<S: Simd>(
    ray_state: &RayState,
    lines: *const CacheLine,
    node: u32,
    top: TraversalStack,
) -> (u32, usize) {
    // SAFETY: the caller's contract. Where nothing is met, the last entry is the one from before.
    unsafe {
        let (_, count) = push_met::<S>(ray_state, lines, node, &top);
        (*top.children.add(count), count)
    }
}

/// Puts the children that the ray meets on the stack, whose last entries are given, the nearest last. Returns that, or anything where
/// there is none, and how many there are.
///
/// # Safety
/// As for [`step_in_turn`].
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn push_met<S: Simd>(
    ray_state: &RayState,
    lines: *const CacheLine,
    node: u32,
    last: &TraversalStack,
) -> (u32, usize) {
    // SAFETY: the caller's contract.
    unsafe {
        let octant = octants_of::<S>().get_unchecked(ray_state.octant as usize);
        let node = lines.add(node as usize * lines_of_node(S::N)).cast::<u8>();
        let plane = |row: u32| S::load(node.add(row as usize).cast());
        let [x, y, z] = ray_state.reciprocal;
        let (x, y, z) = (S::splat(x), S::splat(y), S::splat(z));
        let enter_x = S::mul_sub(plane(octant.near[0]), x, S::splat(ray_state.near[0]));
        let enter_y = S::mul_sub(plane(octant.near[1]), y, S::splat(ray_state.near[1]));
        let enter_z = S::mul_sub(plane(octant.near[2]), z, S::splat(ray_state.near[2]));
        let [x, y, z] = ray_state.exit_reciprocal;
        let (x, y, z) = (S::splat(x), S::splat(y), S::splat(z));
        let exit_x = S::mul_sub(plane(octant.far[0]), x, S::splat(ray_state.far[0]));
        let exit_y = S::mul_sub(plane(octant.far[1]), y, S::splat(ray_state.far[1]));
        let exit_z = S::mul_sub(plane(octant.far[2]), z, S::splat(ray_state.far[2]));
        // Places without a child are entered at infinity.
        let enter = S::max(S::max(enter_x, enter_y), S::max(enter_z, S::splat(ray_state.enter)));
        let exit = S::min(S::min(exit_x, exit_y), S::min(exit_z, S::splat(ray_state.stop)));
        S::push_met(
            node.add(children_offset(S::N)).cast(),
            enter,
            exit,
            node.add(octant.order as usize),
            &octant.direction,
            last.children.add(1),
            last.t.add(1),
        )
    }
}

/// Prefetches a child.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn ask_for<S: Simd, L: Leaves>(lines: *const CacheLine, leaves: L, child: u32) {
    let node = lines.wrapping_add((child as usize).wrapping_mul(lines_of_node(S::N))) as usize;
    let block = leaves.address(leaf_number(child)) as usize;
    // Without a branch, since no predictor could get it right.
    let is_block = 0usize.wrapping_sub(leaf_bit(child));
    ask_for_lines::<S>((node ^ ((node ^ block) & is_block)) as *const u8);
}

/// Prefetches a child that is not a node.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn ask_for_block<S: Simd, L: Leaves>(leaves: L, child: u32) {
    ask_for_lines::<S>(leaves.address(leaf_number(child)));
}

/// Prefetches as many lines as a node has, and most blocks of shared corners. Of seven or eight triangles whose corners are written out the last
/// one or two lines are not among them.
#[cfg_attr(not(unoptimised), inline(always))]
fn ask_for_lines<S: Simd>(at: *const u8) {
    for line in 0..lines_of_node(S::N) {
        prefetch(at.wrapping_add(64 * line));
    }
}

/// The triangle tests of traversals.
#[derive(Clone, Copy)]
pub(crate) struct TestContext<'a, L, K = KeepAll> {
    pub leaves: L,
    pub options: &'a QueryOptions<'a>,
    pub query: Query,
    /// Which hits count; exact tests ask nothing.
    pub keep: K,
}

/// The state that tests of a ray's triangles read and write: the state of the ray, which must not
/// be wide, its best hit, space for blocks, and its lane and batch where tests are exact.
pub(crate) struct RayTest<'a, L: Leaves, K = KeepAll> {
    pub test: &'a TestContext<'a, L, K>,
    pub room: &'a mut L::Room,
    pub ray_state: &'a mut RayState,
    pub best: &'a mut BestHit,
    pub exact: Option<(&'a mut ExactLane, &'a Rays<'a>)>,
}

/// The test of the triangles of a child that is not a node and that a node names. True when the
/// best hit changed, which for any hit is the end. Two words, so that they are returned in
/// registers.
pub(crate) struct TestLeaf<'a, 'b, L: Leaves, K = KeepAll>(pub u32, pub &'a mut RayTest<'b, L, K>);

impl<L: Leaves, K: Keep> Compiled for TestLeaf<'_, '_, L, K> {
    type Output = bool;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> bool {
        let TestLeaf(child, RayTest { test, room, ray_state, best, exact }) = self;
        let TestContext { leaves, options, query, keep } = **test;
        let (mut from, mut better) = (0, false);
        loop {
            // SAFETY: the caller's contract.
            better |= unsafe {
                let (block, next) = leaves.block::<S>(leaf_number(child), from, room);
                from = next;
                match exact {
                    Some((exact, rays)) => {
                        let ray = (*rays, &**ray_state);
                        let block = (&block, L::written::<S>(&block));
                        exact.test::<S, _>(ray, block, options, query, &mut best.stop)
                    }
                    None => leaf::test_either::<S, _, _>(
                        ray_state,
                        (&block, L::written::<S>(&block)),
                        (options, query, keep),
                        best,
                    ),
                }
            };
            if L::ONE || from == 0 || (better && query == Query::Any) {
                return better;
            }
        }
    }
}
