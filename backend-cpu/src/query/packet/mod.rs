//! Coherent rays together: as many rays as a vector has lanes, at one node or triangle at a time.
//!
//! At a wide node the packet as a whole is tested against all children: intervals of its rays' origins and
//! reciprocals give an entry and an exit that hold for each of them. Only the children that pass are
//! tested ray by ray, one box against all rays, when their turn comes. In a block triangles that no ray
//! of the packet can meet are sorted out first, again by intervals; the others are tested one
//! after the other against all rays, by the operations of [`super::leaf`] in their order. So the hits are
//! bit for bit those of single rays.
//!
//! Rays of a packet have one octant and one largest axis, and lie side by side.

mod bounds;
mod row;
mod take;
#[cfg(test)]
mod tests;
mod triangle;

use splitplane_core::ray::{Accuracy, Hit, QueryOptions};
use splitplane_core::traverse::Query;

use self::bounds::{Bounds, greatest};
use self::row::{Row, ZERO, load, store};
use super::blocks::Blocks;
use super::leaf::{self, Best};
use super::prepare::{LANES, Lanes, PreparedRays, Way};
use super::record::Record;
use super::simd::{MOST_LANES, Simd};
use super::stream::{Octant, octants_of};
use super::wide::{BLOCK, Line};

/// Of so many rays each is tested by itself against a whole block.
const FEW: u32 = 2;
/// Blocks of fewer triangles are not looked through for those that the packet can meet.
const WORTH_CULLING: usize = 3;
/// What one triangle against all rays costs, and one ray against a whole block.
const COST_OF_A_TRIANGLE: u32 = 2;
const COST_OF_A_RAY: u32 = 3;

/// The places of a node's children.
static PLACES: [u32; MOST_LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Memory of a packet, kept between packets.
pub(crate) struct Packet {
    bounds: Bounds,
    axes: [usize; 3],
    octant: usize,
    /// Where rays leave the bounds, or nothing can precede their best hits; minus infinity for rays
    /// that are answered or not there.
    stop: Row,
    /// Powers of two that lead from inner `t` to the caller's, and back.
    outwards: Row,
    inwards: Row,
    /// The best hits so far.
    t: Row,
    u: Row,
    v: Row,
    triangle: Row,
    /// Inner `t` beyond which nothing can precede them.
    beyond: Row,
    stack: Stack,
    /// That the rays' ways were written.
    ways: bool,
}

/// Rays of a packet as they were made ready.
struct Rays<'a> {
    ready: &'a PreparedRays,
    ways: &'a mut [Way; LANES],
    first: usize,
}

impl Rays<'_> {
    /// The packet's part of a row.
    ///
    /// # Safety
    /// The processor must have the set; `first` must leave as many lanes.
    #[inline(always)]
    unsafe fn row<S: Simd>(&self, row: &Lanes<f32>) -> S::Floats {
        // SAFETY: the caller has the set; there are as many lanes from `first` on.
        unsafe { S::load(row.as_ptr().add(self.first)) }
    }
}

/// What the packet comes back to: children as node and place, and where the first ray enters.
struct Stack {
    nodes: Vec<u32>,
    places: Vec<u32>,
    t: Vec<f32>,
}

impl Packet {
    /// Memory for a packet.
    pub fn new() -> Packet {
        Packet {
            bounds: Bounds::default(),
            axes: [0, 1, 2],
            octant: 0,
            stop: ZERO,
            outwards: ZERO,
            inwards: ZERO,
            t: ZERO,
            u: ZERO,
            v: ZERO,
            triangle: ZERO,
            beyond: ZERO,
            stack: Stack { nodes: Vec::new(), places: Vec::new(), t: Vec::new() },
            ways: false,
        }
    }

    /// The answer of a ray.
    #[inline(always)]
    pub fn hit(&self, lane: usize) -> Hit {
        Hit {
            t: self.t.0[lane],
            triangle: self.triangle.0[lane].to_bits(),
            u: self.u.0[lane],
            v: self.v.0[lane],
        }
    }
    /// Traces the rays that were taken, from the same place on.
    ///
    /// # Safety
    /// The processor must have the set, for whose width the layout was made; the rays must be those
    /// taken, and none of them wide.
    #[inline(always)]
    pub unsafe fn trace<S: Simd>(
        &mut self,
        blocks: &Blocks,
        (ready, ways): (&PreparedRays, &mut [Way; LANES]),
        first: usize,
        options: &QueryOptions,
        query: Query,
    ) {
        let mut rays = Rays { ready, ways, first };
        let (lines, words) = (blocks.wide.lines().as_ptr(), &blocks.words[..]);
        let room = blocks.wide.stack();
        if self.stack.nodes.len() < room {
            self.stack.nodes.resize(room, 0);
            self.stack.places.resize(room, 0);
            self.stack.t.resize(room, 0.0);
        }
        let octant = &octants_of::<S>()[self.octant];
        let (mut node, mut top) = (0, 0);
        // SAFETY: the caller's contract; children name nodes or blocks; a stack has room for all
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
                    let parent = lines.add(parent as usize * (S::N / 2)).cast::<u8>();
                    let active = self.meets::<S>(&rays, octant, parent.add(4 * place));
                    if active == 0 {
                        continue;
                    }
                    let child = *parent.add(24 * S::N + 4 * place).cast::<u32>();
                    if child & BLOCK == 0 {
                        node = child;
                        break;
                    }
                    let record = Record::at_unchecked(words, child & !BLOCK);
                    if self.block::<S>(&record, &mut rays, active, options, query) {
                        self.bounds.stop = greatest::<S>(&self.stop);
                        if self.bounds.stop == f32::NEG_INFINITY {
                            return;
                        }
                    }
                }
            }
        }
    }

    /// The way of a ray, all of them written when the first is asked for.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(always)]
    unsafe fn way<'a, S: Simd>(&mut self, rays: &'a mut Rays<'_>, lane: usize) -> &'a Way {
        if !self.ways {
            // SAFETY: the caller's contract.
            unsafe { rays.ready.ways::<S>(rays.ways) };
            self.ways = true;
        }
        &rays.ways[rays.first + lane]
    }

    /// Puts the children of a node that some ray may meet on the stack; how many.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[inline(always)]
    unsafe fn step<S: Simd>(
        &mut self,
        lines: *const Line,
        index: u32,
        octant: &Octant,
        top: usize,
    ) -> usize {
        let bounds = &self.bounds;
        // SAFETY: the caller's contract.
        unsafe {
            let node = lines.add(index as usize * (S::N / 2)).cast::<u8>();
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
                enter = S::max(enter, S::min(S::mul(near, least), S::mul(near, most)));
                exit = S::min(exit, S::max(S::mul(far, least), S::mul(far, most)));
            }
            let reach = S::splat(bounds.reach);
            // Places without a child are entered at infinity.
            let enter = S::max(S::sub(enter, reach), S::splat(bounds.enter));
            let exit = S::min(S::add(exit, reach), S::splat(bounds.stop));
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

    /// The rays that meet a box, whose first coordinate is at `corner` and the others a row on each.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[inline(always)]
    unsafe fn meets<S: Simd>(&self, rays: &Rays<'_>, octant: &Octant, corner: *const u8) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            let mut enter = rays.row::<S>(&rays.ready.enter);
            let mut exit = load::<S>(&self.stop);
            for axis in 0..3 {
                let near = S::splat(*corner.add(octant.near[axis] as usize).cast::<f32>());
                let far = S::splat(*corner.add(octant.far[axis] as usize).cast::<f32>());
                let reciprocal = rays.row::<S>(&rays.ready.reciprocal[axis]);
                let near = S::mul_sub(near, reciprocal, rays.row::<S>(&rays.ready.near[axis]));
                let far = S::mul_sub(far, reciprocal, rays.row::<S>(&rays.ready.far[axis]));
                (enter, exit) = (S::max(enter, near), S::min(exit, far));
            }
            S::bits(S::le(enter, exit))
        }
    }

    /// Tests a block for some rays. True when a best hit changed.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[inline(always)]
    unsafe fn block<S: Simd>(
        &mut self,
        record: &Record<'_>,
        rays: &mut Rays<'_>,
        mut active: u32,
        options: &QueryOptions,
        query: Query,
    ) -> bool {
        let fast = options.accuracy == Accuracy::Fast;
        let many = active.count_ones();
        let mut triangles = (1u32 << record.count()) - 1;
        let mut better = false;
        // SAFETY: the caller's contract.
        unsafe {
            if many > FEW && !fast && record.count() >= WORTH_CULLING {
                triangles &= self.cull::<S>(record);
            }
            let singly =
                many <= FEW || triangles.count_ones() * COST_OF_A_TRIANGLE > many * COST_OF_A_RAY;
            if singly && triangles != 0 {
                while active != 0 {
                    let lane = active.trailing_zeros() as usize;
                    active &= active - 1;
                    better |= self.test_ray::<S>(record, rays, lane, options, query);
                }
                return better;
            }
            if !fast {
                // All edges first: nobody could foresee which triangles rays are within.
                let mut rest = triangles;
                while rest != 0 {
                    let index = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    let met = self.within::<S>(record, rays, index) & active != 0;
                    triangles ^= u32::from(!met) << index;
                }
            }
            while triangles != 0 && active != 0 {
                let index = triangles.trailing_zeros() as usize;
                triangles &= triangles - 1;
                if options.ignore == Some(record.triangle(index)) {
                    continue;
                }
                let (taken, unclear) = if fast {
                    (0, self.test_fast::<S>(record, rays, index, active))
                } else {
                    self.test::<S>(record, rays, index, active, options.culling)
                };
                if taken | unclear == 0 {
                    continue;
                }
                let taken = taken | self.decide(record, index, unclear, rays, options);
                better |= taken != 0;
                if query == Query::Any {
                    active &= !taken;
                    let stop = load::<S>(&self.stop);
                    let nothing = S::splat(f32::NEG_INFINITY);
                    store::<S>(&mut self.stop, S::select(S::mask(taken), nothing, stop));
                }
            }
            if better && query == Query::Closest {
                let stop = S::min(load::<S>(&self.beyond), load::<S>(&self.stop));
                store::<S>(&mut self.stop, stop);
            }
        }
        better
    }

    /// Tests a block for one ray. True when its best hit changed.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[inline(always)]
    unsafe fn test_ray<S: Simd>(
        &mut self,
        record: &Record<'_>,
        rays: &mut Rays<'_>,
        lane: usize,
        options: &QueryOptions,
        query: Query,
    ) -> bool {
        let mut best = Best { hit: self.hit(lane), stop: self.beyond.0[lane] };
        // SAFETY: the caller's contract.
        let better = unsafe {
            leaf::test::<S, _>(self.way::<S>(rays, lane), record, options, query, &mut best)
        };
        if better {
            self.set(lane, &best);
            if query == Query::Any {
                self.stop.0[lane] = f32::NEG_INFINITY;
            } else if best.stop < self.stop.0[lane] {
                self.stop.0[lane] = best.stop;
            }
        }
        better
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, best: &Best) {
        self.t.0[lane] = best.hit.t;
        self.triangle.0[lane] = f32::from_bits(best.hit.triangle);
        (self.u.0[lane], self.v.0[lane]) = (best.hit.u, best.hit.v);
        self.beyond.0[lane] = best.stop;
    }
}
