//! Rays that go the same way through the tree over instances, 32 at a time.
//!
//! A packet finds the upper nodes of the tree for all its rays at once: intervals of origins and reciprocals tell which of
//! a node's eight boxes any ray can meet, as in [`trace::packet`](crate::trace::packet), and those boxes are then tested ray by ray, by the operations
//! of [`TopRay`], each rounded by itself. Rounding is monotonic, so no interval leaves out what a ray's own test
//! meets. What a ray meets becomes its stack, nearest last, from which it goes on alone: so it meets what it meets
//! in a walk of its own.

use splitplane_core::ray::Ray;
use splitplane_core::scene::{TOP_INSTANCE, TOP_NONE, TOP_WIDTH, TopNode, TopRay, TopStack};

use super::top_walk::VectorRay;
use crate::simd::Simd;
use crate::trace::prepare::CHUNK;

/// Entries that a packet finds for a ray, at most; a ray with more walks alone.
pub(super) const MOST: usize = 24;
/// Nodes that a packet enters: what is nearest is usually enough, since a hit there ends a ray.
const NODES: usize = 12;
/// A node that fewer rays meet is left to them.
const FEWEST: u32 = 4;
/// Entries of a packet's stack.
const STACK: usize = NODES * (TOP_WIDTH - 1) + TOP_WIDTH;

/// A number of each ray.
type Row = [f32; CHUNK];

/// A child that some ray may meet.
#[derive(Clone, Copy)]
struct Pending {
    /// Where the first ray enters its box.
    enter: f32,
    node: u32,
    slot: u32,
}

/// Rays that were taken together.
pub(super) struct TopPacket {
    rays: [Option<VectorRay>; CHUNK],
    origin: [Row; 3],
    reciprocal: [Row; 3],
    outwards: [Row; 3],
    t_min: Row,
    stop: Row,
    lists: [[TopStack; MOST]; CHUNK],
    counts: [usize; CHUNK],
    /// Rays whose lists hold all that they meet, as bits.
    listed: u32,
    stack: [Pending; STACK],
}

/// What intervals of a packet's rays give on an axis.
struct Interval {
    /// What is subtracted from planes that come first, and from those that come last.
    origin: [f32; 2],
    outwards: f32,
    reciprocal: [f32; 2],
    negative: bool,
}

impl TopPacket {
    /// No rays.
    pub(super) const NONE: TopPacket = TopPacket {
        rays: [const { None }; CHUNK],
        origin: [[0.0; CHUNK]; 3],
        reciprocal: [[0.0; CHUNK]; 3],
        outwards: [[0.0; CHUNK]; 3],
        t_min: [0.0; CHUNK],
        stop: [0.0; CHUNK],
        lists: [[(0.0, 0); MOST]; CHUNK],
        counts: [0; CHUNK],
        listed: 0,
        stack: [Pending { enter: 0.0, node: 0, slot: 0 }; STACK],
    };

    /// Takes at most [`CHUNK`] rays, and finds what those of one octant meet in the upper nodes.
    ///
    /// # Safety
    /// The processor must have the set. The nodes must be all those of a tree.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn take<S: Simd>(&mut self, rays: &[Ray], nodes: &[TopNode]) {
        let mut alike = 0u32;
        let mut first: Option<[bool; 3]> = None;
        for (lane, ray) in rays.iter().enumerate().take(CHUNK) {
            let top_ray = TopRay::new(ray).map(|ray| VectorRay::new(&ray));
            self.rays[lane] = top_ray;
            self.counts[lane] = 0;
            let Some(top_ray) = top_ray else { continue };
            let octant = *first.get_or_insert(top_ray.negative);
            if top_ray.tame & (top_ray.negative == octant) {
                alike |= 1 << lane;
            }
            for axis in 0..3 {
                self.origin[axis][lane] = top_ray.origin[axis];
                self.reciprocal[axis][lane] = top_ray.reciprocal[axis];
                self.outwards[axis][lane] = top_ray.outwards[axis];
            }
            self.t_min[lane] = top_ray.t_min;
            self.stop[lane] = TopRay::stop_after(ray.t_max);
        }
        self.listed = alike;
        let Some(octant) = first else { return };
        if alike.count_ones() < FEWEST || nodes.is_empty() {
            self.listed = 0;
            return;
        }
        // SAFETY: the caller's contract.
        unsafe { self.walk::<S>(alike, octant, nodes) }
    }

    /// The ray of a lane, and the number of entries that were put on its stack; `begin` puts the root there.
    ///
    /// # Safety
    /// The stack must have space for [`MOST`] entries.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn hand_over(
        &self,
        lane: usize,
        stack: &mut [TopStack],
        begin: impl FnOnce(&mut [TopStack]) -> usize,
    ) -> Option<(VectorRay, usize)> {
        let ray = self.rays[lane]?;
        if self.listed >> lane & 1 == 0 {
            return Some((ray, begin(stack)));
        }
        let count = self.counts[lane];
        // The farthest first; they come nearly in the order of their distance.
        for (number, entry) in self.lists[lane][..count].iter().rev().enumerate() {
            let mut at = number;
            while at > 0 && stack[at - 1].0 < entry.0 {
                stack[at] = stack[at - 1];
                at -= 1;
            }
            stack[at] = *entry;
        }
        Some((ray, count))
    }

    /// # Safety
    /// As for [`TopPacket::take`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn walk<S: Simd>(&mut self, alike: u32, octant: [bool; 3], nodes: &[TopNode]) {
        let intervals = self.intervals(alike, octant);
        let (mut t_min, mut stop) = (f32::INFINITY, f32::NEG_INFINITY);
        let mut lanes = alike;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            (t_min, stop) = (t_min.min(self.t_min[lane]), stop.max(self.stop[lane]));
        }
        // SAFETY: the caller's contract; a stack holds the children of all nodes that are entered.
        unsafe {
            let mut top = self.spread::<S::Eight>(&intervals, (t_min, stop), nodes, 0, 0);
            let mut entered = 1;
            while top > 0 {
                top -= 1;
                let Pending { node, slot, .. } = *self.stack.get_unchecked(top);
                let parent = nodes.get_unchecked(node as usize);
                let child = *parent.children.get_unchecked(slot as usize % TOP_WIDTH);
                let mut enters = [0.0; CHUNK];
                let met = alike & self.meets::<S>(octant, parent, slot as usize, &mut enters);
                if met == 0 {
                    continue;
                }
                let is_node = child & TOP_INSTANCE == 0;
                if is_node && entered < NODES && met.count_ones() >= FEWEST {
                    entered += 1;
                    top = self.spread::<S::Eight>(&intervals, (t_min, stop), nodes, child, top);
                    continue;
                }
                let mut lanes = met & self.listed;
                while lanes != 0 {
                    let lane = lanes.trailing_zeros() as usize;
                    lanes &= lanes - 1;
                    let count = *self.counts.get_unchecked(lane);
                    if count == MOST {
                        self.listed &= !(1 << lane);
                        continue;
                    }
                    let entry = (*enters.get_unchecked(lane), child);
                    *self.lists.get_unchecked_mut(lane).get_unchecked_mut(count) = entry;
                    *self.counts.get_unchecked_mut(lane) = count + 1;
                }
            }
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn intervals(&self, alike: u32, octant: [bool; 3]) -> [Interval; 3] {
        let mut intervals = [const {
            Interval { origin: [0.0; 2], outwards: 0.0, reciprocal: [0.0; 2], negative: false }
        }; 3];
        for (axis, interval) in intervals.iter_mut().enumerate() {
            let mut range = [[f32::INFINITY, f32::NEG_INFINITY]; 3];
            let rows = [&self.origin[axis], &self.reciprocal[axis], &self.outwards[axis]];
            for (row, [least, most]) in rows.into_iter().zip(&mut range) {
                for (lane, &x) in row.iter().enumerate() {
                    let here = alike >> lane & 1 != 0;
                    *least = least.min(if here { x } else { f32::INFINITY });
                    *most = most.max(if here { x } else { f32::NEG_INFINITY });
                }
            }
            let [[low, high], reciprocal, outwards] = range;
            let negative = octant[axis];
            *interval = Interval {
                origin: if negative { [low, high] } else { [high, low] },
                outwards: if negative { outwards[1] } else { outwards[0] },
                reciprocal,
                negative,
            };
        }
        intervals
    }

    /// Puts the children of a node that some ray may meet on the stack, the nearest last. Returns the number of entries.
    ///
    /// # Safety
    /// As for [`TopPacket::take`]; the set must have eight lanes, and the stack must have the space.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn spread<S: Simd>(
        &mut self,
        intervals: &[Interval; 3],
        (t_min, stop): (f32, f32),
        nodes: &[TopNode],
        index: u32,
        bottom: usize,
    ) -> usize {
        let mut entered = [0.0; TOP_WIDTH];
        // SAFETY: the caller's contract.
        let mut met = unsafe {
            let node = nodes.get_unchecked(index as usize);
            let reach = S::load(node.reach.as_ptr());
            let (mut near, mut far) = (S::splat(t_min), S::splat(stop));
            for (axis, interval) in intervals.iter().enumerate() {
                let (lo, hi) = (node.lo[axis].as_ptr(), node.hi[axis].as_ptr());
                let (first, last) = if interval.negative { (hi, lo) } else { (lo, hi) };
                let outwards = S::mul(reach, S::splat(interval.outwards));
                let [nearest, farthest] = interval.origin;
                let first = S::sub(S::add(S::load(first), outwards), S::splat(nearest));
                let last = S::sub(S::sub(S::load(last), outwards), S::splat(farthest));
                let [least, most] = interval.reciprocal;
                let (least, most) = (S::splat(least), S::splat(most));
                near = S::max(S::min(S::mul(first, least), S::mul(first, most)), near);
                far = S::min(S::max(S::mul(last, least), S::mul(last, most)), far);
            }
            S::store(entered.as_mut_ptr(), near);
            S::bits(S::le(near, far))
        };
        let mut top = bottom;
        while met != 0 {
            let slot = met.trailing_zeros();
            met &= met - 1;
            let enter = entered[slot as usize % TOP_WIDTH];
            let mut at = top;
            // SAFETY: the caller's contract.
            unsafe {
                while at > bottom && self.stack.get_unchecked(at - 1).enter <= enter {
                    *self.stack.get_unchecked_mut(at) = *self.stack.get_unchecked(at - 1);
                    at -= 1;
                }
                *self.stack.get_unchecked_mut(at) = Pending { enter, node: index, slot };
            }
            top += 1;
        }
        top
    }

    /// The rays that meet the box of a child, as bits, and where they enter it: [`TopRay`]'s operations for all rays.
    ///
    /// # Safety
    /// As for [`TopPacket::take`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn meets<S: Simd>(
        &self,
        octant: [bool; 3],
        node: &TopNode,
        slot: usize,
        enters: &mut Row,
    ) -> u32 {
        let slot = slot % TOP_WIDTH;
        let mut met = 0;
        // A macro, since a closure would not have the set's instructions.
        macro_rules! row {
            ($row:expr, $lane:expr) => {
                S::load($row.as_ptr().add($lane))
            };
        }
        // SAFETY: the caller's contract; rows have whole vectors.
        unsafe {
            let reach = S::splat(node.reach[slot]);
            for first_lane in (0..CHUNK).step_by(S::N) {
                let (mut near, mut far) =
                    (row!(self.t_min, first_lane), row!(self.stop, first_lane));
                for axis in 0..3 {
                    let (lo, hi) = (node.lo[axis][slot], node.hi[axis][slot]);
                    let (first, last) = if octant[axis] { (hi, lo) } else { (lo, hi) };
                    let outwards = S::mul(reach, row!(self.outwards[axis], first_lane));
                    let origin = row!(self.origin[axis], first_lane);
                    let reciprocal = row!(self.reciprocal[axis], first_lane);
                    let first = S::sub(S::add(S::splat(first), outwards), origin);
                    let last = S::sub(S::sub(S::splat(last), outwards), origin);
                    near = S::max(S::mul(first, reciprocal), near);
                    far = S::min(S::mul(last, reciprocal), far);
                }
                S::store(enters.as_mut_ptr().add(first_lane), S::min(near, S::splat(f32::MAX)));
                met |= S::bits(S::le(near, far)) << first_lane;
            }
        }
        if node.children[slot] == TOP_NONE { 0 } else { met }
    }
}
