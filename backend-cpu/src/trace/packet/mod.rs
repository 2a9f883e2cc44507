//! Traces coherent rays together: all that were prepared at once, or as many as a vector has lanes.
//!
//! A packet is one or more groups, each of as many rays as a vector has lanes. At a wide node the
//! packet as a whole is tested against all children: intervals of its rays' origins and reciprocals
//! give an entry and an exit that hold for each of them. Only the children that pass are tested ray
//! by ray, one box against all rays of a group, when their turn comes. In a block, triangles that
//! no ray of the packet can meet are rejected first, again by intervals; the others are tested one
//! at a time against all rays of a group, by the operations of [`super::block_test`] in their
//! order. So the hits are bit for bit those of single rays. Exact rays go the same way; their tests are in `exact.rs`.
//!
//! Rays of a packet have one octant and one largest axis, and lie side by side.

pub(crate) mod bounds;
#[cfg(not(target_family = "wasm"))]
pub(crate) mod exact;
mod group;
mod packet_block;
pub(crate) mod row;
mod take;
#[cfg(test)]
mod tests;
mod triangle;
mod worth;

use std::collections::TryReserveError;

use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Rays};

use self::bounds::{Bounds, greatest};
#[cfg(not(target_family = "wasm"))]
use self::exact::ExactPacket;
use self::group::Group;
use self::packet_block::PacketBlock;
use self::row::{GroupRow, load};
use self::worth::Worth;
use crate::layout::packed_block::PackedBlock;
use crate::layout::tree_layout::TreeLayout;
use crate::layout::wide_node::{CacheLine, children_offset, is_leaf, leaf_number, lines_of_node};
use crate::memory::lengthen;
use crate::simd::{Compiled, MOST_LANES, Simd};
use crate::trace::prepare::{CHUNK, PerRay, PreparedRays};
use crate::trace::ray_state::{EXIT_FACTOR, RayState};
use crate::trace::step::{Octant, octants_of};
use crate::trace::triangle_block::WrittenBlock;
use crate::trace::watertight::Span;

/// Up to this many rays are each tested alone against a whole block.
const FEW: u32 = 2;
/// Blocks of fewer triangles are not searched for those that the packet can meet.
const WORTH_CULLING: usize = 3;
/// The fewest lanes of any set, and so the most groups.
const FEWEST_LANES: usize = 8;
const MOST_GROUPS: usize = CHUNK / FEWEST_LANES;

/// The places of a node's children.
static PLACES: [u32; MOST_LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Memory of a packet, kept between packets.
pub(crate) struct Packet {
    bounds: Bounds,
    axes: [usize; 3],
    octant: usize,
    groups: [Group; MOST_GROUPS],
    /// The first of the groups that were taken.
    first: usize,
    stack: PacketStack,
    /// What exact rays need in addition. A page would load what they take; there they go one by one.
    #[cfg(not(target_family = "wasm"))]
    exact: ExactPacket,
    worth: Worth,
    /// Of which tree, by its address, and of which query.
    of: Option<(usize, Query)>,
}

/// The prepared rays of a packet, and the current group.
struct PacketRays<'a> {
    ready: &'a PreparedRays,
    ray_states: &'a mut [RayState; CHUNK],
    /// The rays as they were given, where they are exact.
    #[cfg_attr(
        target_family = "wasm",
        allow(dead_code, reason = "exact rays have no packets there")
    )]
    given: Rays<'a>,
    /// The groups whose ray states were written, as bits.
    written: u32,
    /// The group's first lane.
    first: usize,
}

impl PacketRays<'_> {
    /// The group's part of a row.
    ///
    /// # Safety
    /// The processor must have the set; `first` must leave as many lanes.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn row<S: Simd>(&self, row: &PerRay<f32>) -> S::Floats {
        // SAFETY: the caller has the set; there are as many lanes from `first` on.
        unsafe { S::load(row.as_ptr().add(self.first)) }
    }

    /// Inner `t` that count, where nothing beyond `beyond` does.
    ///
    /// # Safety
    /// As for [`PacketRays::row`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn span<S: Simd>(&self, beyond: &GroupRow) -> Span<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let t_max = self.row::<S>(&self.ready.t_max);
            let t_min = self.row::<S>(&self.ready.t_min);
            Span { t_min, t_max, stop: S::min(load::<S>(beyond), t_max) }
        }
    }

    /// The group's part of three rows.
    ///
    /// # Safety
    /// As for [`PacketRays::row`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn rows<S: Simd>(&self, [x, y, z]: &[PerRay<f32>; 3]) -> [S::Floats; 3] {
        // SAFETY: the caller's contract.
        unsafe { [self.row::<S>(x), self.row::<S>(y), self.row::<S>(z)] }
    }

    /// The state of a ray; the states of its group are written when the first is asked for.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn ray_state<S: Simd>(&mut self, lane: usize) -> &RayState {
        let group = 1 << (self.first / S::N);
        if self.written & group == 0 {
            // SAFETY: the caller's contract.
            unsafe { self.ready.some_ray_states::<S>(self.first, self.ray_states) };
            self.written |= group;
        }
        &self.ray_states[self.first + lane]
    }
}

/// The packet's stack: children to visit, as node and place, and where the first ray enters them.
struct PacketStack {
    nodes: Vec<u32>,
    places: Vec<u32>,
    t: Vec<f32>,
}

impl Packet {
    /// Memory for a packet.
    pub(crate) fn new() -> Packet {
        Packet {
            bounds: Bounds::default(),
            axes: [0, 1, 2],
            octant: 0,
            groups: [Group::NONE; MOST_GROUPS],
            first: 0,
            stack: PacketStack { nodes: Vec::new(), places: Vec::new(), t: Vec::new() },
            #[cfg(not(target_family = "wasm"))]
            exact: ExactPacket::none(),
            worth: Worth::default(),
            of: None,
        }
    }

    /// Makes space for a stack of `room` entries.
    ///
    /// # Errors
    /// Less memory than that.
    pub(crate) fn make_room(&mut self, room: usize) -> Result<(), TryReserveError> {
        lengthen(&mut self.stack.nodes, room, 0)?;
        lengthen(&mut self.stack.places, room, 0)?;
        lengthen(&mut self.stack.t, room, 0.0)
    }

    /// The answers of the rays of a group.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn hits<S: Simd>(
        &self,
        group: usize,
        accuracy: Accuracy,
    ) -> [Hit; MOST_LANES] {
        // SAFETY: the caller's contract.
        unsafe { self.groups[group].hits::<S>(accuracy) }
    }

    /// Whether a ray of a group has a hit.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn is_hit(&self, group: usize, lane: usize) -> bool {
        self.groups[group].is_hit(lane)
    }

    /// Whether rays have stayed together so far: then packets may be large.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn keeps_together(&self) -> bool {
        self.worth.keeps_together()
    }

    /// Whether the next rays, which are not exact, should go in packets.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn is_worth_it<S: Simd>(&mut self) -> bool {
        self.worth.packets_pay(S::N)
    }

    /// Rays through this tree with this query are next. Of others nothing is remembered.
    pub(crate) fn begin(&mut self, layout: &TreeLayout, query: Query) {
        let of = (core::ptr::from_ref(layout).addr(), query);
        if self.of.replace(of) != Some(of) {
            self.worth = Worth::default();
        }
    }

    /// Traces the rays that were taken, in `G` groups. They must not be exact.
    ///
    /// # Safety
    /// The processor must have the set, for whose width the layout was made; the rays must be those
    /// taken, in as many groups, and none of them wide; there must be space for the nodes' stack.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn trace<S: Simd, const G: usize>(
        &mut self,
        layout: &TreeLayout,
        (ready, ray_states): (&PreparedRays, &mut [RayState; CHUNK]),
        options: &QueryOptions<'_>,
        query: Query,
    ) {
        let given = Rays::Records(&[]);
        let mut rays = PacketRays { ready, ray_states, given, written: 0, first: 0 };
        // SAFETY: the caller's contract.
        unsafe { self.walk::<S, G, false>(layout, &mut rays, options, query) }
    }

    /// Takes the rays through the tree: [`Packet::trace`], of exact rays or of others.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn walk<S: Simd, const G: usize, const EXACT: bool>(
        &mut self,
        layout: &TreeLayout,
        rays: &mut PacketRays<'_>,
        options: &QueryOptions<'_>,
        query: Query,
    ) {
        // SAFETY: the caller's contract; blocks are of the kind that the layout says.
        unsafe {
            if S::WRITES_OUT && layout.is_written() {
                let (packet, asked) = (self, (options, query));
                return S::call(WalkWritten::<G, EXACT> { packet, layout, rays, asked });
            }
            self.walk_blocks::<S, PackedBlock<'_>, G, EXACT>(layout, rays, options, query);
        }
    }

    /// The same through blocks of one kind.
    ///
    /// # Safety
    /// As for [`Packet::trace`]; the layout's blocks must be of that kind.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn walk_blocks<'b, S: Simd, T: PacketBlock<'b>, const G: usize, const EXACT: bool>(
        &mut self,
        layout: &'b TreeLayout,
        rays: &mut PacketRays<'_>,
        options: &QueryOptions<'_>,
        query: Query,
    ) {
        self.worth.begins(G * S::N);
        let (lines, words) = (layout.wide.lines().as_ptr(), &layout.words[..]);
        let room = layout.wide.stack();
        let PacketStack { nodes, places, t } = &self.stack;
        debug_assert!(nodes.len().min(places.len()).min(t.len()) >= room);
        let octant = &octants_of::<S>()[self.octant];
        let (mut node, mut top) = (0, 0);
        // SAFETY: the caller's contract; children name nodes or blocks; a stack has space for all
        // children of the nodes on the way, and for 16 entries more.
        unsafe {
            loop {
                top += self.step::<S>(lines, node, octant, top);
                loop {
                    if top == 0 {
                        return;
                    }
                    top -= 1;
                    if *self.stack.t.get_unchecked(top) > self.bounds.stop {
                        continue;
                    }
                    let parent = *self.stack.nodes.get_unchecked(top);
                    let place = *self.stack.places.get_unchecked(top) as usize;
                    let parent = lines.add(parent as usize * lines_of_node(S::N)).cast::<u8>();
                    let (mut active, mut some) = ([0; G], 0);
                    for (k, met) in active.iter_mut().enumerate() {
                        let (group, corner) = (self.first + k, parent.add(4 * place));
                        rays.first = group * S::N;
                        *met = self.groups.get_unchecked(group).meets::<S>(rays, octant, corner);
                        some |= *met;
                    }
                    if some == 0 {
                        continue;
                    }
                    let child = *parent.add(children_offset(S::N) + 4 * place).cast::<u32>();
                    if !is_leaf(child) {
                        node = child;
                        break;
                    }
                    let block = T::of(PackedBlock::at_unchecked(words, leaf_number(child)));
                    if self.block::<S, T, G, EXACT>(&block, rays, active, options, query) {
                        self.bounds.stop = self.last::<S, G>();
                        if self.bounds.stop == f32::NEG_INFINITY {
                            return;
                        }
                    }
                }
            }
        }
    }

    /// Where the last ray stops.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn last<S: Simd, const G: usize>(&self) -> f32 {
        // SAFETY: the caller's contract.
        unsafe {
            let mut stop = S::splat(f32::NEG_INFINITY);
            for k in 0..G {
                let group = self.groups.get_unchecked(self.first + k);
                stop = S::max(stop, load::<S>(&group.stop));
            }
            greatest::<S>(stop)
        }
    }

    /// Puts the children of a node that some ray may meet on the stack. Returns how many.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn step<S: Simd>(
        &mut self,
        lines: *const CacheLine,
        index: u32,
        octant: &Octant,
        top: usize,
    ) -> usize {
        let bounds = &self.bounds;
        // SAFETY: the caller's contract.
        unsafe {
            let node = lines.add(index as usize * lines_of_node(S::N)).cast::<u8>();
            let mut enter = S::splat(f32::NEG_INFINITY);
            let mut exit = S::splat(f32::INFINITY);
            for axis in 0..3 {
                let [least, most] = bounds.reciprocal[axis];
                let near = S::sub(
                    S::load(node.add(octant.near[axis] as usize).cast()),
                    S::splat(bounds.near[axis]),
                );
                let far = S::sub(
                    S::load(node.add(octant.far[axis] as usize).cast()),
                    S::splat(bounds.far[axis]),
                );
                let (least, most) = (S::splat(least), S::splat(most));
                // NaN bounds nothing: the first operand.
                enter = S::max(S::min(S::mul(near, least), S::mul(near, most)), enter);
                exit = S::min(S::max(S::mul(far, least), S::mul(far, most)), exit);
            }
            // Places without a child are entered at infinity.
            let enter = S::max(enter, S::splat(bounds.enter));
            let exit = S::min(S::mul(exit, S::splat(EXIT_FACTOR)), S::splat(bounds.stop));
            let met = S::le(enter, exit);
            S::push(
                PLACES.as_ptr(),
                enter,
                met,
                node.add(octant.order as usize),
                &octant.direction,
                self.stack.places.as_mut_ptr().add(top),
                self.stack.t.as_mut_ptr().add(top),
            );
            let number = S::splat(f32::from_bits(index));
            S::store(self.stack.nodes.as_mut_ptr().add(top).cast(), number);
            S::bits(met).count_ones() as usize
        }
    }

    /// Tests a block for some rays of each group. True when a best hit changed.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn block<'b, S: Simd, T: PacketBlock<'b>, const G: usize, const EXACT: bool>(
        &mut self,
        block: &T,
        rays: &mut PacketRays<'_>,
        active: [u32; G],
        options: &QueryOptions<'_>,
        query: Query,
    ) -> bool {
        let mut triangles = (1u32 << block.count()) - 1;
        let (mut most, mut met) = (0, 0);
        for rays in active {
            most = rays.count_ones().max(most);
            met += rays.count_ones();
        }
        self.worth.at_block(G * S::N, met);
        let fast = options.accuracy == Accuracy::Fast;
        if most > FEW && !fast && block.count() >= WORTH_CULLING {
            // SAFETY: the caller's contract.
            triangles &= unsafe {
                match () {
                    #[cfg(not(target_family = "wasm"))]
                    () if EXACT => self.cull_exactly::<S, _>(block),
                    () => self.cull::<S, _>(block),
                }
            };
        }
        let mut better = false;
        for (k, active) in active.into_iter().enumerate() {
            if active == 0 {
                continue;
            }
            rays.first = (self.first + k) * S::N;
            #[cfg(not(target_family = "wasm"))]
            if EXACT {
                let tested = (triangles, active);
                // SAFETY: the caller's contract.
                better |=
                    unsafe { self.block_exactly::<S, _>(block, rays, tested, options, query) };
                continue;
            }
            // SAFETY: the caller's contract.
            better |= unsafe {
                let group = self.groups.get_unchecked_mut(self.first + k);
                group.block::<S, _>(block, rays, triangles, active, options, query)
            };
        }
        better
    }
}

/// A walk through blocks with corners written out, in a function of its own: few meshes have them, and that of the others must not lose
/// registers to them.
struct WalkWritten<'a, 'b, const G: usize, const EXACT: bool> {
    packet: &'a mut Packet,
    layout: &'a TreeLayout,
    rays: &'a mut PacketRays<'b>,
    asked: (&'a QueryOptions<'a>, Query),
}

impl<const G: usize, const EXACT: bool> Compiled for WalkWritten<'_, '_, G, EXACT> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let WalkWritten { packet, layout, rays, asked: (options, query) } = self;
        // SAFETY: the caller's contract.
        unsafe { packet.walk_blocks::<S, WrittenBlock<'_>, G, EXACT>(layout, rays, options, query) }
    }
}
