//! Batches: several rays under way at a time, one step of each after the other.
//!
//! A step of a ray is one wide node, whose boxes are tested all at once, or one block of triangles.
//! After it the ray knows where it goes next, asks for that memory, and waits while others take
//! their steps: when its turn comes the memory is there. Rays at nodes and rays at blocks take
//! turns in separate lists, so that processors are not left to guess what a ray stands at; a ray that
//! is answered makes room for the next one. Rays that go the same way are traced by
//! [`super::packet`] instead.

use core::cell::RefCell;

use splitplane_core::arithmetic::Strict;
use splitplane_core::intersect::{PreparedRay, SceneScale};
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::traverse::Query;

use super::blocks::Blocks;
use super::exact;
use super::instruction_set::InstructionSet;
use super::leaf::{self, Best};
use super::leaves::{Indexed, Leaves, Packed, WrittenOut};
use super::packet::Packet;
use super::prepare::{CHUNK, PreparedRays, Way};
use super::sieve::ExactLane;
#[cfg(target_arch = "aarch64")]
use super::simd::Neon;
#[cfg(target_arch = "x86_64")]
use super::simd::{Avx2, Avx512};
use super::simd::{Direction, Portable, Simd, prefetch};
use super::single;
use super::wide::{BLOCK, Line};

/// Rays under way, at most 16.
const FLIGHT: usize = 16;
/// What stands at the bottom of a stack: the ray is answered.
const DONE: u32 = u32::MAX;

/// What of a node rays of an octant read, in bytes from its start.
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

/// Octants by [`Way::octant`], for nodes of so many children.
const fn octants(lanes: usize) -> [Octant; 16] {
    let direction = Direction::new(lanes, false);
    let mut octants = [Octant { near: [0; 3], far: [0; 3], order: 0, direction }; 16];
    let mut i = 0;
    while i < 16 {
        let [x, y, z, reversed] = [i & 1, i >> 1 & 1, i >> 2 & 1, i >> 3];
        let signs = [x, y, z];
        let mut axis = 0;
        while axis < 3 {
            let (low, high) = (4 * lanes * axis, 4 * lanes * (axis + 3));
            octants[i].near[axis] = if signs[axis] == 0 { low } else { high } as u32;
            octants[i].far[axis] = if signs[axis] == 0 { high } else { low } as u32;
            axis += 1;
        }
        octants[i].order = ((28 + (x ^ z) + 2 * (y ^ z)) * lanes) as u32;
        octants[i].direction = Direction::new(lanes, z ^ reversed != 0);
        i += 1;
    }
    octants
}

static OCTANTS_OF_8: [Octant; 16] = octants(8);
static OCTANTS_OF_16: [Octant; 16] = octants(16);

/// Octants for nodes of as many children as lanes.
#[inline(always)]
pub(crate) fn octants_of<S: Simd>() -> &'static [Octant; 16] {
    if S::N == 16 { &OCTANTS_OF_16 } else { &OCTANTS_OF_8 }
}

/// A ray under way.
struct Lane {
    way: Way,
    /// Where it stands.
    child: u32,
    /// Last entry of its stack.
    top: usize,
    best: Best,
    exact: ExactLane,
}

/// What a ray comes back to: children and where it enters them.
///
/// Pointers without bounds: every step reads and writes here.
struct Stack {
    children: *mut u32,
    t: *mut f32,
}

impl Stack {
    /// Puts what ends it at the bottom.
    ///
    /// # Safety
    /// There must be room for an entry.
    #[inline(always)]
    unsafe fn begin(&mut self) {
        // SAFETY: the caller's contract.
        unsafe { (*self.children, *self.t) = (DONE, f32::NEG_INFINITY) }
    }

    /// Lets go what lies beyond `stop`; the new last entry.
    ///
    /// # Safety
    /// The processor must have the set; the stack must have room for 16 entries more.
    #[inline(always)]
    unsafe fn cull<S: Simd>(&mut self, top: usize, stop: f32) -> usize {
        // SAFETY: the caller's contract; the lowest entry stays.
        unsafe { S::cull(self.children.add(1), self.t.add(1), top, stop) }
    }
}

/// Takes a step at a node: puts the children that the ray meets on the stack but for the nearest. Where
/// the ray goes next, and the new last entry.
///
/// # Safety
/// The processor must have the set; the node must be one of the lines; the stack must have room for
/// 16 entries more.
#[inline(always)]
unsafe fn step<S: Simd>(
    way: &Way,
    lines: *const Line,
    node: u32,
    stack: &mut Stack,
    top: usize,
) -> (u32, usize) {
    // SAFETY: the caller's contract.
    unsafe {
        let octant = octants_of::<S>().get_unchecked(way.octant as usize);
        let node = lines.add(node as usize * (S::N / 2)).cast::<u8>();
        let plane = |row: u32| S::load(node.add(row as usize).cast());
        let [x, y, z] = way.reciprocal;
        let (x, y, z) = (S::splat(x), S::splat(y), S::splat(z));
        let enter_x = S::mul_sub(plane(octant.near[0]), x, S::splat(way.near[0]));
        let enter_y = S::mul_sub(plane(octant.near[1]), y, S::splat(way.near[1]));
        let enter_z = S::mul_sub(plane(octant.near[2]), z, S::splat(way.near[2]));
        let exit_x = S::mul_sub(plane(octant.far[0]), x, S::splat(way.far[0]));
        let exit_y = S::mul_sub(plane(octant.far[1]), y, S::splat(way.far[1]));
        let exit_z = S::mul_sub(plane(octant.far[2]), z, S::splat(way.far[2]));
        // Places without a child are entered at infinity.
        let enter = S::max(S::max(enter_x, enter_y), S::max(enter_z, S::splat(way.enter)));
        let exit = S::min(S::min(exit_x, exit_y), S::min(exit_z, S::splat(way.stop)));
        let met = S::le(enter, exit);
        let to = top + 1;
        let below = *stack.children.add(top);
        let nearest = S::push(
            node.add(24 * S::N).cast(),
            enter,
            met,
            node.add(octant.order as usize),
            &octant.direction,
            stack.children.add(to),
            stack.t.add(to),
        );
        let count = S::bits(met).count_ones() as usize;
        let child = core::hint::select_unpredictable(count == 0, below, nearest);
        (child, (top + count).wrapping_sub(1))
    }
}

/// Asks for the memory of a child.
#[inline(always)]
fn ask_for<S: Simd, L: Leaves>(lines: *const Line, leaves: L, child: u32) {
    let node = lines.wrapping_add(child as usize * (S::N / 2)) as usize;
    let block = leaves.address(child & !BLOCK) as usize;
    // Without a branch, since nobody could foresee it.
    let is_block = 0usize.wrapping_sub((child >> 31) as usize);
    let at = (node ^ ((node ^ block) & is_block)) as *const u8;
    for line in 0..S::N / 2 {
        prefetch(at.wrapping_add(64 * line));
    }
}

/// Memory of the rays under way, kept between batches.
struct Flight {
    lanes: Vec<Lane>,
    children: Vec<u32>,
    t: Vec<f32>,
    ready: PreparedRays,
    ways: [Way; CHUNK],
    packet: Packet,
}

impl Flight {
    /// No rays, and no memory yet.
    fn new() -> Flight {
        let (lanes, children, t) = (Vec::new(), Vec::new(), Vec::new());
        let (ready, ways, packet) = (PreparedRays::NONE, [Way::none(); CHUNK], Packet::new());
        Flight { lanes, children, t, ready, ways, packet }
    }
}

thread_local! {
    static IN_FLIGHT: RefCell<Option<Box<Flight>>> = const { RefCell::new(None) };
}

/// What a batch is traced through, and how.
#[derive(Clone, Copy)]
pub(crate) struct Batch<'a> {
    pub blocks: &'a Blocks,
    pub scene: &'a SceneScale,
    pub rays: &'a [Ray],
    pub options: &'a QueryOptions,
    pub query: Query,
}

/// Traces rays in any order; `answer` takes a ray's place and its hit.
///
/// # Safety
/// The processor must have `set`, for whose width the layout was made.
pub(crate) unsafe fn trace(
    set: InstructionSet,
    batch: Batch<'_>,
    answer: &mut impl FnMut(usize, Hit),
) {
    // SAFETY: the caller's contract.
    unsafe {
        match set {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => avx512(batch, answer),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => avx2(batch, answer),
            #[cfg(target_arch = "aarch64")]
            InstructionSet::Neon => run::<Neon>(batch, answer),
            _ => run::<Portable>(batch, answer),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma,bmi1,bmi2,popcnt")]
unsafe fn avx512(batch: Batch<'_>, answer: &mut impl FnMut(usize, Hit)) {
    // SAFETY: as for `trace`.
    unsafe { run::<Avx512>(batch, answer) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,popcnt")]
unsafe fn avx2(batch: Batch<'_>, answer: &mut impl FnMut(usize, Hit)) {
    // SAFETY: as for `trace`.
    unsafe { run::<Avx2>(batch, answer) }
}

/// # Safety
/// As for [`trace`].
#[inline(always)]
unsafe fn run<S: Simd>(batch: Batch<'_>, answer: &mut impl FnMut(usize, Hit)) {
    // Taken out, so that `answer` may trace rays of its own.
    let mut flight = IN_FLIGHT.take().unwrap_or_else(|| Box::new(Flight::new()));
    // SAFETY: the caller's contract.
    unsafe {
        match batch.blocks.indexed() {
            None => fly::<S, _>(batch, Packed::new(batch.blocks), &mut flight, answer),
            Some(leaves) => fly::<S, Indexed<'_>>(batch, leaves, &mut flight, answer),
        }
    }
    IN_FLIGHT.set(Some(flight));
}

/// The lanes by what their rays wait for: a bit a lane, 16 bits for each [`Turn`]. In a register: memory
/// would have to be written and read back in every step.
struct Queues(u64);

/// What a ray waits for.
#[derive(Clone, Copy)]
enum Turn {
    Node,
    Block,
    /// Another ray.
    Refill,
}

impl Queues {
    /// Puts a lane where its child says: without a branch, since nobody could foresee it.
    #[inline(always)]
    fn put(&mut self, lane: usize, child: u32) {
        let queue = (child >> 31) as usize + usize::from(child == DONE);
        self.0 |= 1 << (16 * queue + lane);
    }

    /// Empties a queue.
    #[inline(always)]
    fn take(&mut self, turn: Turn) -> Lanes {
        let shift = 16 * turn as u32;
        let lanes = self.0 >> shift & 0xffff;
        self.0 ^= lanes << shift;
        Lanes(lanes)
    }
}

/// Lanes as bits.
struct Lanes(u64);

impl Iterator for Lanes {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let lane = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (lane < FLIGHT).then_some(lane)
    }
}

/// # Safety
/// As for [`trace`].
#[inline(always)]
unsafe fn fly<S: Simd, L: Leaves>(
    batch: Batch<'_>,
    leaves: L,
    flight: &mut Flight,
    answer: &mut impl FnMut(usize, Hit),
) {
    let Batch { blocks, scene, rays, options, query } = batch;
    let lines = blocks.wide.lines();
    let mut leaf_room = L::room();
    let room = blocks.wide.stack();
    let Flight { lanes, children, t, ready, ways, packet } = flight;
    if lanes.is_empty() {
        let (way, best, exact) = (Way::none(), Best::NONE, ExactLane::idle());
        lanes.resize_with(FLIGHT, || Lane { way, child: DONE, top: 0, best, exact });
    }
    if children.len() < room * FLIGHT {
        children.resize(room * FLIGHT, DONE);
        t.resize(room * FLIGHT, 0.0);
    }
    let exactly = options.accuracy == Accuracy::Exact;
    let mut source = Source { batch, next: 0, left: 0, ready, ways, packet };
    let mut queues = Queues(0);
    for (lane, state) in lanes.iter_mut().enumerate() {
        state.way.index = Way::NO_RAY;
        queues.put(lane, DONE);
    }
    let lanes = &mut lanes[..FLIGHT];
    let (children, t) = (children.as_mut_ptr(), t.as_mut_ptr());
    macro_rules! stack {
        ($lane:expr) => {
            // SAFETY: lanes are below FLIGHT.
            unsafe { Stack { children: children.add($lane * room), t: t.add($lane * room) } }
        };
    }
    let lines = lines.as_ptr();
    loop {
        for lane in queues.take(Turn::Refill) {
            // SAFETY: lanes are below FLIGHT.
            let state = unsafe { lanes.get_unchecked_mut(lane) };
            if state.way.index != Way::NO_RAY {
                let hit = if exactly { state.exact.hit(query) } else { state.best.hit };
                answer(state.way.index as usize, hit);
                state.way.index = Way::NO_RAY;
            }
            // SAFETY: the caller's contract.
            let Some(way) = (unsafe { source.next::<S>(answer) }) else { continue };
            state.way = *way;
            state.best = Best::NONE;
            if exactly {
                let ray = &rays[way.index as usize];
                let exact = ExactLane::new(ray, &way.ray(), &scene.bounds);
                // Rays that can hit nothing are not handed out.
                state.exact = exact.unwrap_or(ExactLane::idle());
            }
            (state.child, state.top) = (0, 0);
            let mut stack = stack!(lane);
            // SAFETY: stacks have the room.
            unsafe { stack.begin() };
            queues.put(lane, 0);
        }
        if queues.0 == 0 {
            return;
        }
        for lane in queues.take(Turn::Node) {
            // SAFETY: lanes are below FLIGHT.
            let state = unsafe { lanes.get_unchecked_mut(lane) };
            let mut stack = stack!(lane);
            // SAFETY: the caller's contract; the child is a node; stacks have the room.
            let (child, top) =
                unsafe { step::<S>(&state.way, lines, state.child, &mut stack, state.top) };
            (state.child, state.top) = (child, top);
            ask_for::<S, L>(lines, leaves, child);
            queues.put(lane, child);
        }
        for lane in queues.take(Turn::Block) {
            // SAFETY: lanes are below FLIGHT.
            let state = unsafe { lanes.get_unchecked_mut(lane) };
            let mut stack = stack!(lane);
            let (mut from, mut better) = (0, false);
            loop {
                // SAFETY: children name nodes or leaves.
                let (record, next) =
                    unsafe { leaves.block::<S>(state.child & !BLOCK, from, &mut leaf_room) };
                // SAFETY: the caller's contract; wide rays get no lane.
                better |= unsafe {
                    if exactly {
                        exact_test::<S>(state, &record, options, query)
                    } else {
                        leaf::test::<S, _>(&state.way, &record, options, query, &mut state.best)
                    }
                };
                if L::ONE || next == 0 || (better && query == Query::Any) {
                    break;
                }
                from = next;
            }
            if better {
                if query == Query::Any {
                    queues.put(lane, DONE);
                    continue;
                }
                let stop = state.best.stop.min(state.way.stop);
                state.way.stop = stop;
                // SAFETY: the caller's contract; stacks have the room.
                state.top = unsafe { stack.cull::<S>(state.top, stop) };
            }
            // SAFETY: entries that were written.
            let child = unsafe { *stack.children.add(state.top) };
            (state.child, state.top) = (child, state.top.wrapping_sub(1));
            ask_for::<S, L>(lines, leaves, child);
            queues.put(lane, child);
        }
    }
}

/// Tests a block exactly. True when the best hit changed.
///
/// # Safety
/// As for [`leaf::test`].
#[inline(never)]
unsafe fn exact_test<S: Simd>(
    state: &mut Lane,
    record: &impl WrittenOut,
    options: &QueryOptions,
    query: Query,
) -> bool {
    let before = state.best.stop;
    // SAFETY: the caller's contract.
    let answered = unsafe {
        state.exact.test_record::<S>(&state.way.ray(), record, options, query, &mut state.best.stop)
    };
    answered || state.best.stop < before
}

/// Where lanes get their rays: made ready 16 at a time.
struct Source<'a> {
    batch: Batch<'a>,
    /// The first ray not yet made ready.
    next: usize,
    ready: &'a mut PreparedRays,
    ways: &'a mut [Way; CHUNK],
    /// Rays of `ready` not yet handed out.
    left: u32,
    packet: &'a mut Packet,
}

impl Source<'_> {
    /// The next ray that needs a lane. Rays that miss the bounds, and those left to the scalar code,
    /// are answered on the way.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(always)]
    unsafe fn next<S: Simd>(&mut self, answer: &mut impl FnMut(usize, Hit)) -> Option<&Way> {
        while self.left == 0 {
            let Batch { scene, rays, options, query, .. } = self.batch;
            if self.next >= rays.len() {
                return None;
            }
            let start = self.next;
            let chunk = &rays[start..(start + CHUNK).min(rays.len())];
            for line in 0..size_of::<[Ray; CHUNK]>() / 64 {
                // What comes after the next rays: batches are long, and read only once.
                let rays = rays.as_ptr().wrapping_add(start + 2 * CHUNK);
                prefetch(rays.cast::<u8>().wrapping_add(64 * line));
            }
            // SAFETY: the caller's contract.
            unsafe { self.ready.fill::<S>(&rays[start..], scene, start, query) };
            self.next += chunk.len();
            let ready = &*self.ready;
            let shifts = u32::from(options.accuracy == Accuracy::Exact);
            let (mut special, mut alive) = (0, 0);
            for lane in 0..CHUNK {
                let within = u32::from(ready.enter[lane] <= ready.exit[lane]);
                special |= (ready.special[lane] | (ready.shifted[lane] & shifts)) << lane;
                alive |= (ready.alive[lane] & within) << lane;
            }
            self.left = alive & !special;
            let mut others = (u32::MAX >> (CHUNK - chunk.len())) & !self.left;
            while others != 0 {
                let lane = others.trailing_zeros() as usize;
                others &= others - 1;
                let alone = special >> lane & 1 != 0;
                let hit = if alone { self.trace_one(&chunk[lane]) } else { Hit::MISS };
                answer(start + lane, hit);
            }
            // SAFETY: the caller's contract.
            unsafe { self.packets::<S>(start, answer) };
            if self.left != 0 {
                // SAFETY: the caller's contract.
                unsafe { self.ready.ways::<S>(self.ways) };
            }
        }
        let lane = self.left.trailing_zeros() as usize;
        self.left &= self.left - 1;
        Some(&self.ways[lane])
    }

    /// Answers the rays made ready that go the same way: all together, or as many as a vector has lanes.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(always)]
    unsafe fn packets<S: Simd>(&mut self, start: usize, answer: &mut impl FnMut(usize, Hit)) {
        let Batch { blocks, scene, options, query, .. } = self.batch;
        // Packets test blocks as they are stored.
        if options.accuracy == Accuracy::Exact || blocks.indexed().is_some() {
            return;
        }
        let sizes = if self.packet.keeps_together() { &[CHUNK, S::N][..] } else { &[S::N] };
        for &lanes in sizes {
            for first in (0..CHUNK).step_by(lanes) {
                let rays = self.left & (u32::MAX >> (CHUNK - lanes)) << first;
                let groups = first / S::N..(first + lanes) / S::N;
                // SAFETY: the caller's contract; rays left to the scalar code are not in `left`.
                unsafe {
                    if !self.packet.take_coherent::<S>(self.ready, groups, rays, scene) {
                        continue;
                    }
                    let ready = (&*self.ready, &mut *self.ways);
                    match lanes / S::N {
                        2 if S::N == 16 => self.packet.trace::<S, 2>(blocks, ready, options, query),
                        4 if S::N == 8 => self.packet.trace::<S, 4>(blocks, ready, options, query),
                        _ => self.packet.trace::<S, 1>(blocks, ready, options, query),
                    }
                }
                for lane in (first..first + lanes).filter(|lane| rays >> lane & 1 != 0) {
                    answer(start + lane, self.packet.hit::<S>(lane));
                }
                self.left &= !rays;
            }
        }
    }

    #[cold]
    fn trace_one(&self, ray: &Ray) -> Hit {
        let Batch { blocks, scene, options, query, .. } = self.batch;
        if options.accuracy == Accuracy::Exact {
            return exact::trace_in_f64(blocks, &scene.bounds, ray, options, query);
        }
        single::trace(blocks, scene, ray, options, query)
    }
}

/// Traces one ray; the same as [`trace`] for a batch of one.
///
/// # Safety
/// As for [`trace`].
pub(crate) unsafe fn trace_one(
    set: InstructionSet,
    blocks: &Blocks,
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions,
    query: Query,
) -> Hit {
    // SAFETY: the caller's contract.
    unsafe {
        match set {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => avx512_one(blocks, scene, ray, options, query),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => avx2_one(blocks, scene, ray, options, query),
            #[cfg(target_arch = "aarch64")]
            InstructionSet::Neon => either::<Neon>(blocks, scene, ray, options, query),
            _ => either::<Portable>(blocks, scene, ray, options, query),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma,bmi1,bmi2,popcnt")]
unsafe fn avx512_one(
    blocks: &Blocks,
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions,
    query: Query,
) -> Hit {
    // SAFETY: as for `trace_one`.
    unsafe { either::<Avx512>(blocks, scene, ray, options, query) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,popcnt")]
unsafe fn avx2_one(
    blocks: &Blocks,
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions,
    query: Query,
) -> Hit {
    // SAFETY: as for `trace_one`.
    unsafe { either::<Avx2>(blocks, scene, ray, options, query) }
}

thread_local! {
    /// The stack of a ray traced alone: children and `t`.
    static ONE: RefCell<(Vec<u32>, Vec<f32>)> = const { RefCell::new((Vec::new(), Vec::new())) };
}

/// Over blocks, or over the tree's own leaves.
///
/// # Safety
/// As for [`trace_one`].
#[inline(always)]
unsafe fn either<S: Simd>(
    blocks: &Blocks,
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions,
    query: Query,
) -> Hit {
    // SAFETY: the caller's contract.
    unsafe {
        match blocks.indexed() {
            None => one::<S, _>(blocks, Packed::new(blocks), scene, ray, options, query),
            Some(leaves) => one::<S, Indexed<'_>>(blocks, leaves, scene, ray, options, query),
        }
    }
}

/// # Safety
/// As for [`trace_one`].
#[inline(always)]
unsafe fn one<S: Simd, L: Leaves>(
    blocks: &Blocks,
    leaves: L,
    scene: &SceneScale,
    given: &Ray,
    options: &QueryOptions,
    query: Query,
) -> Hit {
    let Some(ray) = PreparedRay::new::<Strict>(given, scene) else { return Hit::MISS };
    if ray.wide || ray.offset != 0.0 {
        return single::trace(blocks, scene, given, options, query);
    }
    let Some(interval) = ray.enter::<Strict>(&scene.bounds) else { return Hit::MISS };
    let mut way = Way::new(&ray, interval, query);
    let mut best = Best::NONE;
    let lines = blocks.wide.lines();
    let mut leaf_room = L::room();
    let room = blocks.wide.stack();
    let (mut children, mut t) = ONE.take();
    if children.len() < room {
        children.resize(room, DONE);
        t.resize(room, 0.0);
    }
    let mut stack = Stack { children: children.as_mut_ptr(), t: t.as_mut_ptr() };
    // SAFETY: the stack has the room.
    unsafe { stack.begin() };
    let (mut child, mut top) = (0, 0);
    loop {
        if child & BLOCK == 0 {
            // SAFETY: the caller's contract; the child is a node; the stack has the room.
            let next = unsafe { step::<S>(&way, lines.as_ptr(), child, &mut stack, top) };
            (child, top) = next;
            // A block's header says where its corners are: they need not wait for it.
            ask_for::<S, L>(lines.as_ptr(), leaves, child);
            continue;
        }
        if child == DONE {
            break;
        }
        let (mut from, mut better) = (0, false);
        loop {
            // SAFETY: children name nodes or leaves.
            let (record, next) = unsafe { leaves.block::<S>(child & !BLOCK, from, &mut leaf_room) };
            // SAFETY: the caller's contract; the ray is not wide.
            better |= unsafe { leaf::test::<S, _>(&way, &record, options, query, &mut best) };
            if L::ONE || next == 0 || (better && query == Query::Any) {
                break;
            }
            from = next;
        }
        if better {
            if query == Query::Any {
                break;
            }
            way.stop = best.stop.min(way.stop);
            // SAFETY: the caller's contract; the stack has the room.
            top = unsafe { stack.cull::<S>(top, way.stop) };
        }
        // SAFETY: entries that were written.
        child = unsafe { *stack.children.add(top) };
        top = top.wrapping_sub(1);
    }
    ONE.set((children, t));
    best.hit
}
