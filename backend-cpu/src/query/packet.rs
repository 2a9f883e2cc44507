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

use splitplane_core::intersect::{PLANE_SLACK, STOP_SLACK, SceneScale};
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions};
use splitplane_core::traverse::Query;

use super::blocks::Blocks;
use super::fast;
use super::leaf::{self, Best, Table, decide, of_corners};
use super::plane::Plane;
use super::prepare::{LANES, Lanes, ORIGIN_SLACK, PreparedRays, Way};
use super::record::Record;
use super::simd::{Compiled, MOST_LANES, Simd};
use super::step::{Octant, octants_of};
use super::watertight::{Corner, Meeting, Met, Span, View, enclosed, meet};
use super::wide::{LEAF_MARK, Line};

/// A packet has at least this part of the rays that it has room for, one in so many.
const FEWEST: u32 = 2;
/// Directions of a packet differ by less than this on all axes together; the largest component of
/// each is between 1 and 2.
const DIRECTION_SPREAD: f32 = 0.6;
/// Origins of a packet differ by less than this part of the scene's extents together.
const ORIGIN_SPREAD: f32 = 0.2;
/// Of so many rays each is tested by itself against a whole block.
const FEW: u32 = 2;
/// Blocks of fewer triangles are not looked through for those that the packet can meet.
const WORTH_CULLING: usize = 3;
/// What one triangle against all rays costs, and one ray against a whole block.
const COST_OF_A_TRIANGLE: u32 = 2;
const COST_OF_A_RAY: u32 = 3;

/// A number of each ray.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Row([f32; MOST_LANES]);

const ZERO: Row = Row([0.0; MOST_LANES]);

/// The places of a node's children.
static PLACES: [u32; MOST_LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// # Safety
/// The processor must have the set.
#[inline(always)]
unsafe fn load<S: Simd>(row: &Row) -> S::Floats {
    // SAFETY: the caller has the set; rows are of the most lanes.
    unsafe { S::load(row.0.as_ptr()) }
}

/// # Safety
/// As for [`load`].
#[inline(always)]
unsafe fn store<S: Simd>(row: &mut Row, x: S::Floats) {
    // SAFETY: as above.
    unsafe { S::store(row.0.as_mut_ptr(), x) }
}

/// # Safety
/// As for [`load`].
#[inline(always)]
unsafe fn put<S: Simd>(mask: S::Mask, row: &mut Row, x: S::Floats) {
    // SAFETY: as above.
    unsafe { store::<S>(row, S::select(mask, x, load::<S>(row))) }
}

/// The greatest number of a row.
#[inline(always)]
fn greatest<S: Simd>(row: &Row) -> f32 {
    range::<S>(&row.0, 0)[1]
}

/// Least and greatest number of the lanes from `first` on.
#[inline(always)]
fn range<S: Simd>(row: &Lanes<f32>, first: usize) -> [f32; 2] {
    let mut lo = [0.0; MOST_LANES];
    lo[..S::N].copy_from_slice(&row[first..first + S::N]);
    let mut hi = lo;
    let mut half = S::N / 2;
    while half > 0 {
        for i in 0..half {
            lo[i] = if lo[i] < lo[i + half] { lo[i] } else { lo[i + half] };
            hi[i] = if hi[i] > hi[i + half] { hi[i] } else { hi[i + half] };
        }
        half /= 2;
    }
    [lo[0], hi[0]]
}

/// The least and greatest products of two intervals.
///
/// # Safety
/// As for [`load`].
#[inline(always)]
unsafe fn products<S: Simd>([a, b]: [f32; 2], [c, d]: [S::Floats; 2]) -> [S::Floats; 2] {
    // SAFETY: as above.
    unsafe {
        let (a, b) = (S::splat(a), S::splat(b));
        let (ac, ad, bc, bd) = (S::mul(a, c), S::mul(a, d), S::mul(b, c), S::mul(b, d));
        let least = S::min(S::min(ac, ad), S::min(bc, bd));
        [least, S::max(S::max(ac, ad), S::max(bc, bd))]
    }
}

/// The least of each triangle's corners.
///
/// # Safety
/// As for [`load`].
#[inline(always)]
unsafe fn least<S: Simd>(table: Table<S>, places: [S::Places; 3]) -> S::Floats {
    // SAFETY: as above.
    unsafe {
        let [a, b, c] = of_corners::<S>(table, places);
        S::min(a, S::min(b, c))
    }
}

/// The greatest of each triangle's corners.
///
/// # Safety
/// As for [`load`].
#[inline(always)]
unsafe fn most<S: Simd>(table: Table<S>, places: [S::Places; 3]) -> S::Floats {
    // SAFETY: as above.
    unsafe {
        let [a, b, c] = of_corners::<S>(table, places);
        S::max(a, S::max(b, c))
    }
}

/// What holds for all rays of a packet.
#[derive(Clone, Copy, Default)]
struct Bounds {
    /// What to take from the planes that the rays meet first, and last: the origin, with slack, that
    /// gives the least and the greatest distance.
    near: [f32; 3],
    far: [f32; 3],
    reciprocal: [[f32; 2]; 3],
    /// What distances are widened by.
    reach: f32,
    /// On the sheared axes.
    origin: [[f32; 2]; 3],
    shear: [[f32; 2]; 3],
    enter: f32,
    stop: f32,
}

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

    /// Inner `t` that count, where nothing beyond `beyond` does.
    ///
    /// # Safety
    /// As for [`Rays::row`].
    #[inline(always)]
    unsafe fn span<S: Simd>(&self, beyond: &Row) -> Span<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let t_max = self.row::<S>(&self.ready.t_max);
            let t_min = self.row::<S>(&self.ready.t_min);
            Span { t_min, t_max, stop: S::min(load::<S>(beyond), t_max) }
        }
    }

    /// The packet's part of three rows.
    ///
    /// # Safety
    /// As for [`Rays::row`].
    #[inline(always)]
    unsafe fn rows<S: Simd>(&self, [x, y, z]: &[Lanes<f32>; 3]) -> [S::Floats; 3] {
        // SAFETY: the caller's contract.
        unsafe { [self.row::<S>(x), self.row::<S>(y), self.row::<S>(z)] }
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

    /// Takes rays that were made ready, those of `rays` from place `first` on, if they are worth
    /// tracing as one packet: many, of one octant, side by side. True if it did.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(always)]
    pub unsafe fn take<S: Simd>(
        &mut self,
        ready: &mut PreparedRays,
        first: usize,
        rays: u32,
        scene: &SceneScale,
        forced: bool,
    ) -> bool {
        let fewest = if forced { 1 } else { S::N as u32 / FEWEST };
        if rays.count_ones() < fewest {
            return false;
        }
        let one = rays.trailing_zeros() as usize + first;
        let (mut octants, mut axes) = (0, 0);
        for lane in 0..S::N {
            let there = 0u32.wrapping_sub(rays >> lane & 1);
            octants |= (ready.octant[first + lane] ^ ready.octant[one]) & there;
            axes |= (ready.axes[first + lane] ^ ready.axes[one]) & there;
        }
        // Whether its end is solid need not be the same for all.
        if octants & 7 != 0 || axes != 0 {
            return false;
        }
        let whole = rays == (1u32 << S::N) - 1;
        if !whole {
            // Places without a ray take the numbers of one that is there.
            ready.repeat(one, (!rays & ((1u32 << S::N) - 1)) << first);
        }
        let spread = |[lo, hi]: [f32; 2]| hi - lo;
        // SAFETY: the caller's contract; there are lanes from `first` on.
        unsafe {
            let (mut directions, mut origins, mut extents) = (0.0, 0.0, 0.0);
            let mut origin = [[0.0; 2]; 3];
            for axis in 0..3 {
                directions += spread(range::<S>(&ready.direction[axis], first));
                origin[axis] = range::<S>(&ready.origin[axis], first);
                origins += spread(origin[axis]);
                extents += scene.bounds.hi[axis] - scene.bounds.lo[axis];
            }
            let near = directions < DIRECTION_SPREAD && origins < ORIGIN_SPREAD * extents;
            if !(near || forced) {
                return false;
            }
            let octant = ready.octant[one] as usize & 7;
            self.octant =
                octant | if octants & 8 == 0 { ready.octant[one] as usize & 8 } else { 0 };
            self.axes = ready.ray(one).axes;
            let bounds = &mut self.bounds;
            for axis in 0..3 {
                let [lo, hi] = origin[axis];
                let most = if lo.abs() > hi.abs() { lo.abs() } else { hi.abs() };
                let slack = scene.slack * (1.0 + 4.0 * PLANE_SLACK) + most * ORIGIN_SLACK;
                let (low, high) = (lo - slack, hi + slack);
                let backwards = octant >> axis & 1 != 0;
                (bounds.near[axis], bounds.far[axis]) =
                    if backwards { (low, high) } else { (high, low) };
                bounds.reciprocal[axis] = range::<S>(&ready.reciprocal[axis], first);
                bounds.shear[axis] = range::<S>(&ready.shear[axis], first);
            }
            bounds.origin = self.axes.map(|axis| origin[axis]);
            let [enter, last] = range::<S>(&ready.enter, first);
            let [exit, stop] = range::<S>(&ready.exit, first);
            let reach = last.abs().max(enter.abs()).max(exit.abs().max(stop.abs()));
            (bounds.enter, bounds.stop, bounds.reach) = (enter, stop, reach * (2.0 * PLANE_SLACK));
            let mut exit = S::load(ready.exit.as_ptr().add(first));
            if !whole {
                exit = S::select(S::mask(rays), exit, S::splat(f32::NEG_INFINITY));
            }
            store::<S>(&mut self.stop, exit);
            for lane in 0..S::N {
                // Of rays that are alive between -126 and 126.
                let biased = (ready.exponent[first + lane] + 127) as u32;
                self.outwards.0[lane] = f32::from_bits(254u32.wrapping_sub(biased) << 23);
                self.inwards.0[lane] = f32::from_bits(biased << 23);
            }
            store::<S>(&mut self.t, S::splat(Hit::MISS.t));
            store::<S>(&mut self.triangle, S::splat(f32::from_bits(Hit::MISS.triangle)));
            store::<S>(&mut self.u, S::splat(0.0));
            store::<S>(&mut self.v, S::splat(0.0));
            store::<S>(&mut self.beyond, S::splat(f32::INFINITY));
            self.ways = false;
            true
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
                    if child & LEAF_MARK == 0 {
                        node = child;
                        break;
                    }
                    let record = Record::at_unchecked(words, child & !LEAF_MARK);
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

    /// Decides a triangle for some rays by the reference test; those whose best hit changed.
    #[inline(always)]
    fn decide(
        &mut self,
        record: &Record<'_>,
        index: usize,
        mut unclear: u32,
        rays: &Rays<'_>,
        options: &QueryOptions,
    ) -> u32 {
        let mut taken = 0;
        while unclear != 0 {
            let lane = unclear.trailing_zeros() as usize;
            unclear &= unclear - 1;
            let ray = rays.ready.ray(rays.first + lane);
            let Some(found) = decide(&ray, &record.corners(index), options) else { continue };
            let mut best = Best { hit: self.hit(lane), stop: self.beyond.0[lane] };
            if best.take(&ray, &found, record.triangle(index)) {
                self.set(lane, &best);
                taken |= 1 << lane;
            }
        }
        taken
    }

    /// The triangles of a block that rays of the packet may meet: those whose sheared corners
    /// lie, for all rays together, on no side of the ray, and reach into the limits. All operations are
    /// those of the test, on the ends of intervals; since rounding is monotonic, no interval leaves out
    /// what the test computes.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[inline(always)]
    unsafe fn cull<S: Simd>(&self, record: &Record<'_>) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            let Bounds { origin, shear, enter, stop, .. } = &self.bounds;
            let zero = S::splat(0.0);
            // Flat x, flat y, depth: least and greatest.
            let mut tables = [[[zero; 2]; 2]; 3];
            for half in 0..2 {
                let mut from = [[zero; 2]; 3];
                for axis in 0..3 {
                    let row = record.coordinates(self.axes[axis]).wrapping_add(half * S::N);
                    let x = S::load(row);
                    let [lo, hi] = origin[axis];
                    from[axis] = [S::sub(x, S::splat(hi)), S::sub(x, S::splat(lo))];
                }
                for axis in 0..3 {
                    let [less, more] = products::<S>(shear[axis], from[2]);
                    let [lo, hi] = from[axis];
                    tables[axis][0][half] = if axis < 2 { S::sub(lo, more) } else { less };
                    tables[axis][1][half] = if axis < 2 { S::sub(hi, less) } else { more };
                }
            }
            let places = [
                S::places(record.places(0)),
                S::places(record.places(1)),
                S::places(record.places(2)),
            ];
            let left = S::max(least::<S>(tables[0][0], places), least::<S>(tables[1][0], places));
            let right = S::min(most::<S>(tables[0][1], places), most::<S>(tables[1][1], places));
            let met = S::and(S::le(left, zero), S::le(zero, right));
            // The rays enter the bounds within their limits: so this holds for those too.
            let reached = S::le(S::splat(*enter), most::<S>(tables[2][1], places));
            let before = S::le(least::<S>(tables[2][0], places), S::splat(*stop));
            S::bits(S::and(met, S::and(reached, before)))
        }
    }

    /// The rays that the edges of a triangle enclose, as the test finds them.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[inline(always)]
    unsafe fn within<S: Simd>(&self, record: &Record<'_>, rays: &Rays<'_>, index: usize) -> u32 {
        // SAFETY: the caller's contract.
        unsafe { enclosed(&Seen::<S>::new(rays, self.axes, record, index)) }
    }

    /// The watertight test of one triangle against some rays; keeps what precedes. The rays whose best
    /// hit changed, and those for which the reference must decide.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[inline(always)]
    unsafe fn test<S: Simd>(
        &mut self,
        record: &Record<'_>,
        rays: &Rays<'_>,
        index: usize,
        active: u32,
        culling: Culling,
    ) -> (u32, u32) {
        // SAFETY: the caller's contract.
        unsafe {
            let seen = Seen::<S>::new(rays, self.axes, record, index);
            let span = rays.span::<S>(&self.beyond);
            let Some(mut meeting) = meet(&seen, active, &span, culling) else { return (0, 0) };
            if meeting.unclear != 0 {
                let (mut met, beyond) = (Met::of(&meeting), &self.beyond);
                S::call(CloserLook { rays, record, index, beyond, met: &mut met });
                meeting = met.meeting();
            }
            let Meeting { met, unclear, t: inner, v, w, det, .. } = meeting;
            // The caller's t: packets hold no moved rays.
            let most = S::splat(f32::MAX);
            let t = S::mul(inner, load::<S>(&self.outwards));
            let t = snapped::<S>(S::min(S::max(t, S::splat(-f32::MAX)), most));
            let within = S::le(rays.row::<S>(&rays.ready.limits[0]), t);
            let within = S::and(within, S::le(t, rays.row::<S>(&rays.ready.limits[1])));
            let met = met & S::bits(within);
            let best = load::<S>(&self.t);
            let mut taken = met & !S::bits(S::le(best, t));
            let mut tied = met & S::bits(S::and(S::le(best, t), S::le(t, best)));
            while tied != 0 {
                let lane = tied.trailing_zeros() as usize;
                tied &= tied - 1;
                let lower = record.triangle(index) < self.triangle.0[lane].to_bits();
                taken |= u32::from(lower) << lane;
            }
            if taken != 0 {
                let mask = S::mask(taken);
                put::<S>(mask, &mut self.t, t);
                put::<S>(mask, &mut self.u, snapped::<S>(S::div(v, det)));
                put::<S>(mask, &mut self.v, snapped::<S>(S::div(w, det)));
                put::<S>(
                    mask,
                    &mut self.triangle,
                    S::splat(f32::from_bits(record.triangle(index))),
                );
                // As `PreparedRay::stop_after`: what is flushed to 0 or clamped is equal outside.
                let slack = S::mul(S::abs(inner), S::splat(STOP_SLACK));
                let least = S::splat(f32::MIN_POSITIVE * (1.0 + STOP_SLACK));
                let least = S::mul(least, load::<S>(&self.inwards));
                let stop = S::max(S::add(inner, slack), least);
                let clamped = S::le(most, S::abs(t));
                put::<S>(mask, &mut self.beyond, S::select(clamped, S::splat(f32::INFINITY), stop));
            }
            (taken, unclear)
        }
    }

    /// Rays that one triangle may be a hit of by the fast test, whichever way it faces.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[inline(always)]
    unsafe fn test_fast<S: Simd>(
        &self,
        record: &Record<'_>,
        rays: &Rays<'_>,
        index: usize,
        active: u32,
    ) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            let origin = rays.rows::<S>(&rays.ready.origin);
            let direction = rays.rows::<S>(&rays.ready.direction);
            let corners = corners::<S>(record, index, [0, 1, 2]);
            let limit = S::min(load::<S>(&self.beyond), rays.row::<S>(&rays.ready.t_max));
            let span = [rays.row::<S>(&rays.ready.t_min), limit];
            fast::may_meet::<S>(origin, direction, corners, span) & active
        }
    }
}

/// One triangle's corners in all lanes, each on three axes.
///
/// # Safety
/// The processor must have the set; the triangle must be one of the block's.
#[inline(always)]
unsafe fn corners<S: Simd>(
    record: &Record<'_>,
    index: usize,
    [x, y, z]: [usize; 3],
) -> [[S::Floats; 3]; 3] {
    // SAFETY: the caller's contract.
    unsafe {
        let (x, y, z) = (record.coordinates(x), record.coordinates(y), record.coordinates(z));
        let [a, b, c] = record.places_of(index);
        [
            [S::splat(*x.add(a)), S::splat(*y.add(a)), S::splat(*z.add(a))],
            [S::splat(*x.add(b)), S::splat(*y.add(b)), S::splat(*z.add(b))],
            [S::splat(*x.add(c)), S::splat(*y.add(c)), S::splat(*z.add(c))],
        ]
    }
}

/// One triangle as the rays see it.
struct Seen<S: Simd> {
    corners: [Corner<S>; 3],
}

impl<S: Simd> Seen<S> {
    /// # Safety
    /// As for [`Packet::trace`]; the triangle must be one of the block's.
    #[inline(always)]
    unsafe fn new(rays: &Rays<'_>, axes: [usize; 3], record: &Record<'_>, index: usize) -> Seen<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let origin = rays.rows::<S>(&rays.ready.sheared_origin);
            let shear = rays.rows::<S>(&rays.ready.shear);
            let [a, b, c] = corners::<S>(record, index, axes);
            let corners = [
                Corner::new(a, origin, shear),
                Corner::new(b, origin, shear),
                Corner::new(c, origin, shear),
            ];
            Seen { corners }
        }
    }
}

impl<S: Simd> View<S> for Seen<S> {
    #[inline(always)]
    unsafe fn flat(&self) -> [[S::Floats; 3]; 2] {
        let [a, b, c] = &self.corners;
        [[a.flat[0], b.flat[0], c.flat[0]], [a.flat[1], b.flat[1], c.flat[1]]]
    }

    #[inline(always)]
    unsafe fn depths(&self) -> [S::Floats; 3] {
        let [a, b, c] = &self.corners;
        [a.depth, b.depth, c.depth]
    }

    #[inline(always)]
    unsafe fn reach(&self) -> S::Floats {
        let [a, b, c] = &self.corners;
        // SAFETY: the caller's contract.
        unsafe { S::max(a.reach(), S::max(b.reach(), c.reach())) }
    }

    #[inline(always)]
    unsafe fn width(&self) -> S::Floats {
        let [a, b, c] = &self.corners;
        // SAFETY: the caller's contract.
        unsafe { S::max(a.width(), S::max(b.width(), c.width())) }
    }
}

/// A look at a triangle's plane for the rays that are unclear.
struct CloserLook<'a> {
    rays: &'a Rays<'a>,
    record: &'a Record<'a>,
    index: usize,
    /// See [`Packet::beyond`].
    beyond: &'a Row,
    met: &'a mut Met,
}

impl Compiled for CloserLook<'_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<S: Simd>(self) {
        let ready = self.rays.ready;
        // SAFETY: the caller's contract; the triangle is one of the block's.
        unsafe {
            let plane = Plane::<S> {
                origin: self.rays.rows::<S>(&ready.origin),
                direction: self.rays.rows::<S>(&ready.direction),
                corners: corners::<S>(self.record, self.index, [0, 1, 2]),
            };
            let mut meeting = self.met.meeting::<S>();
            meeting.look_closely(&plane, &self.rays.span::<S>(self.beyond));
            *self.met = Met::of(&meeting);
        }
    }
}

/// 0 for what is below the normal range.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
unsafe fn snapped<S: Simd>(x: S::Floats) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe { S::keep(S::le(S::splat(f32::MIN_POSITIVE), S::abs(x)), x) }
}

#[cfg(test)]
mod tests {
    use splitplane_core::backend::{Accelerator, BuildOptions, QueryLayout};
    use splitplane_core::mesh::Mesh;
    use splitplane_core::ray::Ray;
    use splitplane_core::traverse;
    use splitplane_core::triangle::Triangle;

    use super::*;
    use crate::CpuBackend;
    use crate::buffers::Memory;
    use crate::lookout::UNWATCHED;
    use crate::query::instruction_set::InstructionSet;
    use crate::query::simd::Portable;
    #[cfg(target_arch = "x86_64")]
    use crate::query::simd::{Avx2, Avx512};
    use crate::query::{LayoutScratch, Source};

    /// Numbers in `[-1, 1)`.
    struct Numbers(u32);

    impl Numbers {
        fn next(&mut self) -> f32 {
            self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (self.0 >> 8) as f32 / 8_388_608.0 - 1.0
        }

        fn point(&mut self, spread: f32) -> [f32; 3] {
            [self.next() * spread, self.next() * spread, self.next() * spread]
        }
    }

    /// A bumpy sheet whose triangles share corners, small triangles about it, flat ones, and some of all
    /// twice: at equal `t` the lower index counts.
    fn mesh(size: usize, numbers: &mut Numbers) -> Vec<Triangle> {
        let mut triangles = Vec::new();
        let side = size as f32;
        let mut heights = vec![[0.0; 3]; (size + 1) * (size + 1)];
        for (i, corner) in heights.iter_mut().enumerate() {
            let (x, y) = ((i % (size + 1)) as f32 / side, (i / (size + 1)) as f32 / side);
            *corner = [4.0 * x - 2.0, 4.0 * y - 2.0, 0.3 * numbers.next()];
        }
        for i in 0..size * size {
            let at = i / size * (size + 1) + i % size;
            let [a, b, c, d] = [at, at + 1, at + size + 1, at + size + 2].map(|i| heights[i]);
            triangles.push([a, b, c]);
            triangles.push([b, d, c]);
        }
        for i in 0..2 * size {
            let (centre, spread) = (numbers.point(2.0), if i % 9 == 0 { 2.0 } else { 0.2 });
            let mut corners = [(); 3].map(|()| {
                let offset = numbers.point(spread);
                [0, 1, 2].map(|k| centre[k] + offset[k])
            });
            if i % 3 == 0 {
                corners.iter_mut().for_each(|corner| corner[i % 2] = centre[i % 2]);
            }
            triangles.push(corners);
        }
        for i in 0..size {
            triangles.push(triangles[i * 5 % triangles.len()]);
        }
        triangles
    }

    /// 16 rays side by side, of one origin or not, towards the mesh or a corner of it.
    fn group(triangles: &[Triangle], round: usize, numbers: &mut Numbers) -> Vec<Ray> {
        let spread = [0.0, 1e-3, 0.03, 0.3][round % 4];
        let apart = [0.0, 1e-3, 0.3][round % 3];
        let origin = numbers.point(if round.is_multiple_of(5) { 1.0 } else { 5.0 });
        let some = (numbers.next() * 0.5 + 0.5) * triangles.len() as f32;
        let target = triangles[some as usize % triangles.len()][round % 3];
        let mut direction = [0, 1, 2].map(|k| target[k] - origin[k]);
        if round.is_multiple_of(11) {
            direction = [0, 1, 2].map(|k| if k == round % 3 { direction[k] } else { 0.0 });
        }
        let scale = [1.0, 0.01, 300.0][round / 4 % 3];
        (0..LANES)
            .map(|i| {
                let (o, d) = (numbers.point(apart), numbers.point(spread));
                let origin = [0, 1, 2].map(|k| origin[k] + o[k]);
                let direction = [0, 1, 2].map(|k| (direction[k] + d[k]) * scale);
                let ray = Ray::new(origin, direction);
                match (round % 7, i) {
                    (1, 3 | 9) => Ray::new(origin, [f32::NAN; 3]),
                    (2, 0 | 1) => Ray::new(origin.map(|x| x + 90.0), direction),
                    (3, _) => ray.with_limits(0.5 / scale, (1.2 + 0.2 * numbers.next()) / scale),
                    (4, _) => ray.with_limits(-2.0 / scale, 2.0 / scale),
                    (5, _) => ray.with_limits(0.0, 1.0 / scale),
                    _ => ray,
                }
            })
            .collect()
    }

    /// Traces groups as packets; how many packets and hits there were.
    unsafe fn compare<S: Simd>(set: InstructionSet) -> (usize, usize) {
        let mut numbers = Numbers(77);
        let (mut packets, mut hits) = (0, 0);
        let mut packet = Packet::new();
        let mut ways = [Way::none(); LANES];
        for size in [1, 40, 6, 100] {
            let triangles = mesh(size, &mut numbers);
            let soup = Mesh::soup(&triangles).unwrap();
            let backend = CpuBackend::with_instruction_set(set);
            let built = backend.build_accelerator(&soup, &BuildOptions::default()).unwrap();
            let (tree, scene) = (built.tree().view(), built.scene_scale());
            let source = Source { mesh: &soup, triangles: &triangles, layout: QueryLayout::Fast };
            let mut scratch = LayoutScratch::default();
            let (copy, mut memory) = (built.tree().clone(), Memory::default());
            let blocks =
                Blocks::new(copy, source, set, &UNWATCHED, &mut memory, &mut scratch).unwrap();
            for round in 0..120 {
                let rays = group(&triangles, round, &mut numbers);
                let (accuracy, culling, ignore) = match round % 6 {
                    0 => (Accuracy::Fast, Culling::None, None),
                    1 => (Accuracy::Watertight, Culling::Back, None),
                    2 => (Accuracy::Watertight, Culling::Front, Some(5)),
                    _ => (Accuracy::Watertight, Culling::None, None),
                };
                let options = QueryOptions { accuracy, culling, ignore, ..Default::default() };
                for query in [Query::Closest, Query::Any] {
                    let mut ready = PreparedRays::NONE;
                    // SAFETY: the caller says that the processor has the set.
                    unsafe { ready.fill::<S>(&rays, scene, 0, query) };
                    for first in (0..LANES).step_by(S::N) {
                        let alive = (0..S::N).filter(|&lane| {
                            let at = first + lane;
                            let within = ready.enter[at] <= ready.exit[at];
                            ready.alive[at] != 0 && ready.special[at] == 0 && within
                        });
                        let alive = alive.fold(0, |bits, lane| bits | 1 << lane);
                        // SAFETY: as above; the rays are those taken.
                        unsafe {
                            if !packet.take::<S>(&mut ready, first, alive, scene, true) {
                                continue;
                            }
                            let ready = (&ready, &mut ways);
                            packet.trace::<S>(&blocks, ready, first, &options, query);
                        }
                        packets += 1;
                        for lane in (0..S::N).filter(|lane| alive >> lane & 1 != 0) {
                            let ray = &rays[first + lane];
                            let expected =
                                traverse::closest_hit(&tree, &soup, scene, ray, &options);
                            let found = packet.hit(lane);
                            let context = (set, size, round, lane, ray);
                            assert_eq!(found.is_hit(), expected.is_some(), "{context:?}");
                            if query == Query::Closest {
                                let expected = expected.unwrap_or(Hit::MISS);
                                let bits: [[u32; 4]; 2] = bytemuck::cast([found, expected]);
                                assert_eq!(bits[0], bits[1], "{context:?} {found:?} {expected:?}");
                                hits += usize::from(found.is_hit());
                            }
                        }
                    }
                }
            }
        }
        (packets, hits)
    }

    /// Forced packets give the hits of the reference loop bit for bit, on every instruction set.
    #[test]
    fn packets_equal_the_reference() {
        for set in InstructionSet::available() {
            // SAFETY: the processor has it.
            let (packets, hits) = unsafe {
                match set {
                    #[cfg(target_arch = "x86_64")]
                    InstructionSet::Avx512 => compare::<Avx512>(set),
                    #[cfg(target_arch = "x86_64")]
                    InstructionSet::Avx2 => compare::<Avx2>(set),
                    #[cfg(target_arch = "aarch64")]
                    InstructionSet::Neon => compare::<crate::query::simd::Neon>(set),
                    _ => compare::<Portable>(set),
                }
            };
            assert!(packets > 400 && hits > 2500, "{set:?}: {packets} packets, {hits} hits");
        }
    }
}
