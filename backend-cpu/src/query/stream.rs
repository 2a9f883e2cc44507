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
use splitplane_core::intersect::{PLANE_SLACK, PreparedRay, SceneScale};
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::traverse::Query;

use super::blocks::Blocks;
use super::exact;
use super::instruction_set::InstructionSet;
use super::leaf::{self, Best};
use super::prepare::{LANES, PreparedRays};
use super::record::{Record, UNIT};
use super::sieve::ExactLane;
#[cfg(target_arch = "x86_64")]
use super::simd::{Avx2, Avx512};
use super::simd::{Portable, Simd, prefetch};
use super::single;
use super::wide::{BLOCK, Line};

/// Rays under way.
const FLIGHT: usize = 16;
/// What stands at the bottom of a stack: the ray is answered.
const DONE: u32 = u32::MAX;

/// What a step at a node needs of a ray.
#[derive(Clone, Copy)]
pub(crate) struct Way {
    reciprocal: [f32; 3],
    /// Origin times reciprocal, with the planes' slack added, and with it taken away.
    near: [f32; 3],
    far: [f32; 3],
    enter: f32,
    /// Where the ray leaves the bounds, or nothing can precede its best hit any more.
    stop: f32,
    /// Rows of the planes that the ray meets first, in floats.
    rows: [usize; 3],
    /// Where the order of the children for its octant is, in bytes.
    order: usize,
    /// That order is to be taken backwards.
    reversed: bool,
}

impl Way {
    /// The way of a ray; `back_to_front` for any hits that are likely at the far end.
    #[inline(always)]
    fn new<S: Simd>(ray: &PreparedRay, (enter, stop): (f32, f32), back_to_front: bool) -> Way {
        let backwards = ray.direction.map(|d| d < 0.0);
        let [x, y, z] = backwards;
        let mut way = Way {
            reciprocal: ray.reciprocal,
            near: [0.0; 3],
            far: [0.0; 3],
            enter,
            stop,
            rows: [0; 3],
            order: (28 + usize::from(x ^ z) + 2 * usize::from(y ^ z)) * S::N,
            reversed: z ^ back_to_front,
        };
        for axis in 0..3 {
            let origin = ray.origin[axis] * ray.reciprocal[axis];
            let slack = ray.slack[axis] + origin.abs() * ORIGIN_SLACK;
            (way.near[axis], way.far[axis]) = (origin + slack, origin - slack);
            way.rows[axis] = (axis + if backwards[axis] { 3 } else { 0 }) * S::N;
        }
        way
    }
}

/// Distances to planes are differences of products here: each errs by half a rounding of the
/// product and of the difference; this is four times that.
const ORIGIN_SLACK: f32 = 4.768_371_6e-7; // 2^-21

/// A ray under way.
struct Lane {
    way: Way,
    /// Where it stands.
    child: u32,
    /// Last entry of its stack.
    top: usize,
    /// Its place in the batch; `usize::MAX` for none.
    index: usize,
    best: Best,
    ray: PreparedRay,
    exact: ExactLane,
}

/// What a ray comes back to: children and where it enters them.
struct Stack<'a> {
    children: &'a mut [u32],
    t: &'a mut [f32],
}

impl Stack<'_> {
    /// Lets go what lies beyond `stop`; the new last entry.
    #[inline(always)]
    fn cull(&mut self, top: usize, stop: f32) -> usize {
        let (children, t) = (&mut self.children[..=top], &mut self.t[..=top]);
        let mut end = 0;
        for i in 1..=top {
            let kept = t[i] <= stop;
            end += usize::from(kept);
            let to = if kept { end } else { 0 };
            let from = if kept { i } else { 0 };
            (children[to], t[to]) = (children[from], t[from]);
        }
        end
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
    stack: &mut Stack<'_>,
    top: usize,
) -> (u32, usize) {
    // SAFETY: the caller's contract.
    unsafe {
        let node = lines.add(node as usize * (S::N / 2)).cast::<f32>();
        let [near_x, near_y, near_z] = way.rows;
        let plane = |row: usize| S::load(node.add(row));
        let [x, y, z] = way.reciprocal;
        let (x, y, z) = (S::splat(x), S::splat(y), S::splat(z));
        let enter_x = S::mul_sub(plane(near_x), x, S::splat(way.near[0]));
        let enter_y = S::mul_sub(plane(near_y), y, S::splat(way.near[1]));
        let enter_z = S::mul_sub(plane(near_z), z, S::splat(way.near[2]));
        let exit_x = S::mul_sub(plane(3 * S::N - near_x), x, S::splat(way.far[0]));
        let exit_y = S::mul_sub(plane(5 * S::N - near_y), y, S::splat(way.far[1]));
        let exit_z = S::mul_sub(plane(7 * S::N - near_z), z, S::splat(way.far[2]));
        let enter = S::max(S::max(enter_x, enter_y), enter_z);
        let exit = S::min(S::min(exit_x, exit_y), exit_z);
        // Twice the slack of a plane, for the rounding of slack itself.
        let slack = S::splat(-2.0 * PLANE_SLACK);
        let early = S::mul_add(S::abs(enter), slack, enter);
        let late = S::mul_add(S::abs(exit), S::splat(2.0 * PLANE_SLACK), exit);
        // In this order of the operands what is no number stays so: places without a child.
        let enter = S::max(S::splat(way.enter), early);
        let exit = S::min(S::splat(way.stop), late);
        let met = S::le(enter, exit);
        let to = top + 1;
        let below = *stack.children.get_unchecked(top);
        let nearest = S::push(
            node.add(6 * S::N).cast(),
            enter,
            met,
            node.cast::<u8>().add(way.order),
            way.reversed,
            stack.children.as_mut_ptr().add(to),
            stack.t.as_mut_ptr().add(to),
        );
        let count = S::bits(met).count_ones() as usize;
        let child = core::hint::select_unpredictable(count == 0, below, nearest);
        (child, (top + count).wrapping_sub(1))
    }
}

/// Asks for the memory of a child.
#[inline(always)]
fn ask_for<S: Simd>(lines: *const Line, words: *const u32, child: u32) {
    let node = lines.wrapping_add(child as usize * (S::N / 2)) as usize;
    let block = words.wrapping_add((child & !BLOCK) as usize * UNIT) as usize;
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
}

impl Flight {
    /// No rays, and no memory yet.
    fn new() -> Flight {
        let (lanes, children, t) = (Vec::new(), Vec::new(), Vec::new());
        Flight { lanes, children, t, ready: PreparedRays::NONE }
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
    unsafe { fly::<S>(batch, &mut flight, answer) };
    IN_FLIGHT.set(Some(flight));
}

/// Rays by what they wait for, as their lanes.
struct Queues {
    lanes: [[u8; FLIGHT]; 3],
    counts: [usize; 3],
}

/// For a step at a node, for a test of a block, for another ray.
const AT_NODE: usize = 0;
const AT_BLOCK: usize = 1;
const AT_END: usize = 2;

impl Queues {
    /// Appends a lane to the queue that its child says: without a branch, since nobody could foresee it.
    #[inline(always)]
    fn put(&mut self, lane: usize, child: u32) {
        let queue = (child >> 31) as usize + usize::from(child == DONE);
        // There are as many lanes as places.
        self.lanes[queue][self.counts[queue] % FLIGHT] = lane as u8;
        self.counts[queue] += 1;
    }

    /// Empties a queue.
    #[inline(always)]
    fn take(&mut self, queue: usize) -> ([u8; FLIGHT], usize) {
        (self.lanes[queue], core::mem::take(&mut self.counts[queue]))
    }
}

/// # Safety
/// As for [`trace`].
#[inline(always)]
unsafe fn fly<S: Simd>(batch: Batch<'_>, flight: &mut Flight, answer: &mut impl FnMut(usize, Hit)) {
    let Batch { blocks, scene, rays, options, query } = batch;
    let (lines, words) = (blocks.wide.lines(), &blocks.words[..]);
    let room = blocks.wide.stack();
    let Flight { lanes, children, t, ready } = flight;
    if lanes.is_empty() {
        let ray = ready.ray(0);
        let way = Way::new::<S>(&ray, (0.0, 0.0), false);
        let (best, exact) = (Best::NONE, ExactLane::idle());
        lanes.resize_with(FLIGHT, || Lane {
            way,
            child: DONE,
            top: 0,
            index: usize::MAX,
            best,
            ray,
            exact,
        });
    }
    if children.len() < room * FLIGHT {
        children.resize(room * FLIGHT, DONE);
        t.resize(room * FLIGHT, 0.0);
    }
    let exactly = options.accuracy == Accuracy::Exact;
    let mut source = Source { batch, next: 0, left: 0, ready };
    let mut queues = Queues { lanes: [[0; FLIGHT]; 3], counts: [0; 3] };
    for (lane, state) in lanes.iter_mut().enumerate() {
        state.index = usize::MAX;
        queues.put(lane, DONE);
    }
    let lanes = &mut lanes[..FLIGHT];
    let (children, t) = (&mut children[..room * FLIGHT], &mut t[..room * FLIGHT]);
    // SAFETY: lanes are below FLIGHT.
    macro_rules! stack {
        ($lane:expr) => {
            unsafe {
                Stack {
                    children: children.get_unchecked_mut($lane * room..($lane + 1) * room),
                    t: t.get_unchecked_mut($lane * room..($lane + 1) * room),
                }
            }
        };
    }
    let (lines, words_start) = (lines.as_ptr(), words.as_ptr());
    loop {
        let (waiting, count) = queues.take(AT_END);
        for &lane in waiting.iter().take(count) {
            let lane = lane as usize % FLIGHT;
            let state = &mut lanes[lane];
            if state.index != usize::MAX {
                let hit = if exactly { state.exact.hit(query) } else { state.best.hit };
                answer(state.index, hit);
                state.index = usize::MAX;
            }
            // SAFETY: the caller's contract.
            let Some((from, index)) = (unsafe { source.next::<S>(answer) }) else { continue };
            let ready = &source.ready;
            state.ray = ready.ray(from);
            let interval = (ready.enter[from], ready.exit[from]);
            let backwards = query == Query::Any && single::far_end_is_solid(&state.ray, interval);
            state.way = Way::new::<S>(&state.ray, interval, backwards);
            state.best = Best::NONE;
            state.index = index;
            if exactly {
                let exact = ExactLane::new(&rays[index], &state.ray, &scene.bounds);
                // Rays that can hit nothing are not handed out.
                state.exact = exact.unwrap_or(ExactLane::idle());
            }
            (state.child, state.top) = (0, 0);
            let stack = stack!(lane);
            (stack.children[0], stack.t[0]) = (DONE, f32::NEG_INFINITY);
            queues.put(lane, 0);
        }
        if queues.counts == [0; 3] {
            return;
        }
        let (waiting, count) = queues.take(AT_NODE);
        for &lane in waiting.iter().take(count) {
            let lane = lane as usize % FLIGHT;
            let state = &mut lanes[lane];
            let mut stack = stack!(lane);
            // SAFETY: the caller's contract; the child is a node; stacks have the room.
            let (child, top) =
                unsafe { step::<S>(&state.way, lines, state.child, &mut stack, state.top) };
            (state.child, state.top) = (child, top);
            ask_for::<S>(lines, words_start, child);
            queues.put(lane, child);
        }
        let (waiting, count) = queues.take(AT_BLOCK);
        for &lane in waiting.iter().take(count) {
            let lane = lane as usize % FLIGHT;
            let state = &mut lanes[lane];
            let mut stack = stack!(lane);
            // SAFETY: children name nodes or blocks.
            let record = unsafe { Record::at_unchecked(words, state.child & !BLOCK) };
            // SAFETY: the caller's contract; wide rays get no lane.
            let better = unsafe {
                if exactly {
                    exact_test::<S>(state, &record, options, query)
                } else {
                    leaf::test::<S>(&state.ray, &record, options, query, &mut state.best)
                }
            };
            if better {
                if query == Query::Any {
                    queues.put(lane, DONE);
                    continue;
                }
                if state.best.stop < state.way.stop {
                    state.way.stop = state.best.stop;
                    state.top = stack.cull(state.top, state.way.stop);
                }
            }
            // SAFETY: entries that were written.
            let child = unsafe { *stack.children.get_unchecked(state.top) };
            (state.child, state.top) = (child, state.top.wrapping_sub(1));
            ask_for::<S>(lines, words_start, child);
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
    record: &Record<'_>,
    options: &QueryOptions,
    query: Query,
) -> bool {
    let before = state.best.stop;
    // SAFETY: the caller's contract.
    let answered = unsafe {
        state.exact.test_record::<S>(&state.ray, record, options, query, &mut state.best.stop)
    };
    answered || state.best.stop < before
}

/// Where lanes get their rays: made ready 16 at a time.
struct Source<'a> {
    batch: Batch<'a>,
    /// The first ray not yet made ready.
    next: usize,
    ready: &'a mut PreparedRays,
    /// Rays of `ready` not yet handed out.
    left: u32,
}

impl Source<'_> {
    /// The next ray that needs a lane, as its place among those made ready together and in the
    /// batch. Rays that miss the bounds, and those left to the scalar code, are answered on the way.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(always)]
    unsafe fn next<S: Simd>(
        &mut self,
        answer: &mut impl FnMut(usize, Hit),
    ) -> Option<(usize, usize)> {
        while self.left == 0 {
            let Batch { scene, rays, options, .. } = self.batch;
            if self.next >= rays.len() {
                return None;
            }
            let start = self.next;
            let chunk = &rays[start..(start + LANES).min(rays.len())];
            self.ready.fill(chunk, scene);
            self.next += chunk.len();
            for lane in 0..chunk.len() {
                let ready = &self.ready;
                let shifted = options.accuracy == Accuracy::Exact && ready.shifted[lane] != 0;
                if ready.special[lane] != 0 || shifted {
                    answer(start + lane, self.trace_one(&chunk[lane]));
                } else if ready.alive[lane] != 0 && ready.enter[lane] <= ready.exit[lane] {
                    self.left |= 1 << lane;
                } else {
                    answer(start + lane, Hit::MISS);
                }
            }
        }
        let lane = self.left.trailing_zeros() as usize;
        self.left &= self.left - 1;
        Some((lane, (self.next - 1) / LANES * LANES + lane))
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
            _ => one::<Portable>(blocks, scene, ray, options, query),
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
    unsafe { one::<Avx512>(blocks, scene, ray, options, query) }
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
    unsafe { one::<Avx2>(blocks, scene, ray, options, query) }
}

/// Entries of a stack that needs no allocation: far more than common trees need.
const COMMON: usize = 512;

/// # Safety
/// As for [`trace_one`].
#[inline(always)]
unsafe fn one<S: Simd>(
    blocks: &Blocks,
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
    let backwards = query == Query::Any && single::far_end_is_solid(&ray, interval);
    let mut way = Way::new::<S>(&ray, interval, backwards);
    let mut best = Best::NONE;
    let (lines, words) = (blocks.wide.lines(), &blocks.words[..]);
    let room = blocks.wide.stack();
    let (mut children, mut t) = ([DONE; COMMON], [0.0; COMMON]);
    let (mut more_children, mut more_t) = (Vec::new(), Vec::new());
    let mut stack = if room <= COMMON {
        Stack { children: &mut children, t: &mut t }
    } else {
        more_children.resize(room, DONE);
        more_t.resize(room, 0.0);
        Stack { children: &mut more_children, t: &mut more_t }
    };
    (stack.children[0], stack.t[0]) = (DONE, f32::NEG_INFINITY);
    let (mut child, mut top) = (0, 0);
    loop {
        if child & BLOCK == 0 {
            // SAFETY: the caller's contract; the child is a node; the stack has the room.
            let next = unsafe { step::<S>(&way, lines.as_ptr(), child, &mut stack, top) };
            (child, top) = next;
            continue;
        }
        if child == DONE {
            return best.hit;
        }
        {
            let record = Record::at(words, child & !BLOCK);
            // SAFETY: the caller's contract; the ray is not wide.
            if unsafe { leaf::test::<S>(&ray, &record, options, query, &mut best) } {
                if query == Query::Any {
                    return best.hit;
                }
                if best.stop < way.stop {
                    way.stop = best.stop;
                    top = stack.cull(top, way.stop);
                }
            }
        }
        child = stack.children[top];
        top = top.wrapping_sub(1);
    }
}
