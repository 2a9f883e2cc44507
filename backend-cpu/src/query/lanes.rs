//! Batches by lanes: one ray a SIMD lane, 16 in a group, several groups in flight (AVX-512).
//!
//! Lanes step through interior nodes and empty leaves together, each at a node of its own; nodes are
//! gathered, stacks scattered. When too few lanes of all groups still step, each lane that reached a
//! leaf tests its triangles, 16 at once, and goes on; a lane whose ray is answered takes the next
//! one. Groups take turns, so that one's gathers are under way while another computes.

use core::arch::x86_64::*;
use core::cell::RefCell;

use splitplane_core::config::MAX_DEPTH;
use splitplane_core::intersect::{PLANE_SLACK, PreparedRay, SceneScale};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::traverse::Query;

use super::blocks::Blocks;
use super::leaf::InstructionSet;
use super::prepare::{LANES, PreparedRays, prepare_one};
use super::single::{self, Best, test_leaf};

/// Groups in flight.
const GROUPS: usize = 3;
/// Batches below this are traced one ray after the other: filling the lanes costs more.
pub const WORTHWHILE: usize = 2 * LANES;
/// Lanes of all groups that must still step for stepping to go on.
const ENOUGH: u32 = (GROUPS * LANES / 2) as u32;

/// 16 numbers in one cache line.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Row<T>([T; LANES]);

/// What a lane comes back to: a far child and the inner interval in which the ray may be in it.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
struct Entry {
    node: u32,
    enter: f32,
    exit: f32,
    padding: u32,
}

/// Entries about to be pushed, by word.
struct Pushed {
    rows: [Row<u32>; 3],
}

/// 16 rays under way.
#[repr(C, align(64))]
struct Group {
    origin: [Row<f32>; 3],
    reciprocal: [Row<f32>; 3],
    slack: [Row<f32>; 3],
    enter: Row<f32>,
    exit: Row<f32>,
    node: Row<u32>,
    /// First block and number of triangles of the leaf a lane waits at.
    leaf_first: Row<u32>,
    leaf_count: Row<u32>,
    /// Lanes whose direction is negative on each axis.
    backwards: [__mmask16; 3],
    /// Lanes that step.
    stepping: __mmask16,
    /// Lanes that wait at a leaf with triangles.
    waiting: __mmask16,
    /// Lanes whose ray is answered or that never had one.
    idle: __mmask16,
    best: [Best; LANES],
    ray: [PreparedRay; LANES],
    /// Place of each lane's ray in the batch; `usize::MAX` for none.
    index: [usize; LANES],
    /// Entries on each lane's stack.
    depth: [usize; LANES],
    stack: [[Entry; MAX_DEPTH as usize + 1]; LANES],
}

impl Group {
    /// A group without rays.
    fn new() -> Group {
        let ray = PreparedRay {
            origin: [0.0; 3],
            direction: [1.0; 3],
            reciprocal: [1.0; 3],
            slack: [0.0; 3],
            axes: [0, 1, 2],
            shear: [0.0; 3],
            t_min: 0.0,
            t_max: 0.0,
            offset: 0.0,
            exponent: 0,
            wide: false,
        };
        let nothing = Entry { node: 0, enter: 0.0, exit: 0.0, padding: 0 };
        Group {
            origin: [Row([0.0; LANES]); 3],
            reciprocal: [Row([1.0; LANES]); 3],
            slack: [Row([0.0; LANES]); 3],
            enter: Row([0.0; LANES]),
            exit: Row([0.0; LANES]),
            node: Row([0; LANES]),
            leaf_first: Row([0; LANES]),
            leaf_count: Row([0; LANES]),
            backwards: [0; 3],
            stepping: 0,
            waiting: 0,
            idle: u16::MAX,
            best: [Best::NONE; LANES],
            ray: [ray; LANES],
            index: [usize::MAX; LANES],
            depth: [0; LANES],
            stack: [[nothing; MAX_DEPTH as usize + 1]; LANES],
        }
    }
}

thread_local! {
    /// Kept between batches: all lanes are idle at the end of one.
    static GROUPS_IN_FLIGHT: RefCell<Box<[Group; GROUPS]>> =
        RefCell::new(Box::new(core::array::from_fn(|_| Group::new())));
}

/// Traces rays in any order; `answer` takes a ray's place and its hit.
///
/// # Safety
/// The processor must have [`InstructionSet::Avx512`].
#[target_feature(enable = "avx512f,avx512dq")]
pub unsafe fn trace(
    blocks: &Blocks,
    scene: &SceneScale,
    rays: &[Ray],
    options: &QueryOptions,
    query: Query,
    answer: &mut impl FnMut(usize, Hit),
) {
    let ready = PreparedRays::new();
    let mut source = Source { scene, blocks, rays, next: 0, ready, left: 0 };
    GROUPS_IN_FLIGHT.with_borrow_mut(|groups| {
        // SAFETY: the instruction set, by contract.
        unsafe { run(groups, &mut source, options, query, answer) };
    });
}

/// Runs the groups until every ray of the source is answered.
///
/// # Safety
/// The processor must have [`InstructionSet::Avx512`].
#[target_feature(enable = "avx512f,avx512dq")]
unsafe fn run(
    groups: &mut [Group; GROUPS],
    source: &mut Source<'_>,
    options: &QueryOptions,
    query: Query,
    answer: &mut impl FnMut(usize, Hit),
) {
    let blocks = source.blocks;
    loop {
        let mut alive = 0;
        for group in groups.iter_mut() {
            // SAFETY: the instruction set, by contract.
            unsafe {
                group.test_leaves(blocks, options, query);
                group.refill(source, options, query, answer);
            }
            alive |= group.stepping | group.waiting;
        }
        if alive == 0 {
            return;
        }
        let enough = if source.is_empty() { 1 } else { ENOUGH };
        loop {
            let mut stepping = 0;
            for group in groups.iter_mut() {
                // SAFETY: as above; the nodes are a valid tree's.
                unsafe { group.step(&blocks.nodes) };
                stepping += group.stepping.count_ones();
            }
            if stepping < enough {
                break;
            }
        }
    }
}

/// Where lanes get their rays: made ready 16 at a time.
struct Source<'a> {
    scene: &'a SceneScale,
    blocks: &'a Blocks,
    rays: &'a [Ray],
    /// The first ray not yet made ready.
    next: usize,
    ready: PreparedRays,
    /// Rays of `ready` not yet handed out.
    left: u32,
}

impl Source<'_> {
    /// True when every ray has been handed out.
    fn is_empty(&self) -> bool {
        self.left == 0 && self.next >= self.rays.len()
    }

    /// The next ray that needs a lane, as its place among those made ready together and in the
    /// batch. Rays that miss the bounds, and those left to the scalar code, are answered on the way.
    ///
    /// # Safety
    /// The processor must have [`InstructionSet::Avx512`].
    #[target_feature(enable = "avx512f,avx512dq")]
    unsafe fn next(
        &mut self,
        options: &QueryOptions,
        query: Query,
        answer: &mut impl FnMut(usize, Hit),
    ) -> Option<(usize, usize)> {
        loop {
            while self.left == 0 {
                if self.next >= self.rays.len() {
                    return None;
                }
                let start = self.next;
                let chunk = &self.rays[start..(start + LANES).min(self.rays.len())];
                self.ready.fill(chunk, self.scene);
                self.next += chunk.len();
                for lane in 0..chunk.len() {
                    let ready = &self.ready;
                    if ready.special[lane] != 0 {
                        let hit = self.trace_one(&chunk[lane], options, query);
                        answer(start + lane, hit);
                    } else if ready.alive[lane] != 0 && ready.enter[lane] <= ready.exit[lane] {
                        self.left |= 1 << lane;
                    } else {
                        answer(start + lane, Hit::MISS);
                    }
                }
            }
            let lane = self.left.trailing_zeros() as usize;
            self.left &= self.left - 1;
            return Some((lane, (self.next - 1) / LANES * LANES + lane));
        }
    }

    #[cold]
    fn trace_one(&self, ray: &Ray, options: &QueryOptions, query: Query) -> Hit {
        let Some((ray, interval)) = prepare_one(ray, self.scene) else { return Hit::MISS };
        // SAFETY: every processor has the portable set.
        unsafe {
            let set = InstructionSet::Portable;
            single::trace(set, self.blocks, &ray, interval, options, query)
        }
    }
}

/// The lowest lane of a mask, which it loses.
#[inline(always)]
fn take_lane(mask: &mut __mmask16) -> usize {
    let lane = mask.trailing_zeros() as usize;
    *mask &= *mask - 1;
    lane
}

#[inline(always)]
fn load(row: &Row<f32>) -> __m512 {
    // SAFETY: a row is 64 aligned bytes; only code that has AVX-512 calls this.
    unsafe { _mm512_load_ps(row.0.as_ptr()) }
}

#[inline(always)]
fn load_words(row: &Row<u32>) -> __m512i {
    // SAFETY: as for `load`.
    unsafe { _mm512_load_si512(row.0.as_ptr().cast()) }
}

#[inline(always)]
fn store(row: &mut Row<f32>, value: __m512) {
    // SAFETY: as for `load`.
    unsafe { _mm512_store_ps(row.0.as_mut_ptr(), value) }
}

#[inline(always)]
fn store_words(row: &mut Row<u32>, value: __m512i) {
    // SAFETY: as for `load`.
    unsafe { _mm512_store_si512(row.0.as_mut_ptr().cast(), value) }
}

impl Group {
    /// One node for each stepping lane.
    ///
    /// # Safety
    /// AVX-512; `nodes` must be those of a valid tree.
    #[target_feature(enable = "avx512f,avx512dq")]
    #[inline]
    unsafe fn step(&mut self, nodes: &[splitplane_core::node::KdNode]) {
        let active = self.stepping;
        if active == 0 {
            return;
        }
        let base = nodes.as_ptr().cast::<u8>();
        let node = load_words(&self.node);
        let zero = _mm512_setzero_si512();
        // Two gathers of whole nodes are half the loads of two of single words. Lanes that do not
        // step stand at the root or where they last were, so no mask is needed.
        // SAFETY: every lane stands at a node of the tree; a node is 8 bytes.
        let (low, high) = unsafe {
            (
                _mm512_i32gather_epi64::<8>(_mm512_castsi512_si256(node), base.cast()),
                _mm512_i32gather_epi64::<8>(_mm512_extracti64x4_epi64::<1>(node), base.cast()),
            )
        };
        let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
        let odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
        let word = _mm512_permutex2var_epi32(low, even, high);
        let tagged = _mm512_permutex2var_epi32(low, odd, high);
        let axis = _mm512_and_si512(tagged, _mm512_set1_epi32(3));
        let leaf = _mm512_mask_cmpeq_epi32_mask(active, axis, _mm512_set1_epi32(3));
        let is_y = _mm512_cmpeq_epi32_mask(axis, _mm512_set1_epi32(1));
        let is_z = _mm512_cmpeq_epi32_mask(axis, _mm512_set1_epi32(2));
        let interior = active & !leaf;
        let index = _mm512_srli_epi32::<2>(tagged);

        let pick = |rows: &[Row<f32>; 3]| {
            let xy = _mm512_mask_blend_ps(is_y, load(&rows[0]), load(&rows[1]));
            _mm512_mask_blend_ps(is_z, xy, load(&rows[2]))
        };
        let split = _mm512_castsi512_ps(word);
        let t = _mm512_mul_ps(_mm512_sub_ps(split, pick(&self.origin)), pick(&self.reciprocal));
        let error =
            _mm512_fmadd_ps(_mm512_abs_ps(t), _mm512_set1_ps(PLANE_SLACK), pick(&self.slack));
        let least = _mm512_sub_ps(t, error);
        let greatest = _mm512_add_ps(t, error);

        let is_x = !(is_y | is_z);
        let backwards =
            (self.backwards[0] & is_x) | (self.backwards[1] & is_y) | (self.backwards[2] & is_z);
        let left = _mm512_add_epi32(node, _mm512_set1_epi32(1));
        let near = _mm512_mask_blend_epi32(backwards, left, index);
        let far = _mm512_mask_blend_epi32(backwards, index, left);
        let (enter, exit) = (load(&self.enter), load(&self.exit));
        let only_far = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(interior, greatest, enter);
        let only_near = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(interior, least, exit) & !only_far;
        let both = interior & !only_far & !only_near;

        if both != 0 {
            let mut pushed = Pushed { rows: [Row([0; LANES]); 3] };
            store_words(&mut pushed.rows[0], far);
            let far_enter = _mm512_max_ps(least, enter);
            store_words(&mut pushed.rows[1], _mm512_castps_si512(far_enter));
            store_words(&mut pushed.rows[2], _mm512_castps_si512(exit));
            let mut rest = both;
            while rest != 0 {
                let lane = take_lane(&mut rest);
                let depth = self.depth[lane];
                // A valid tree has at most MAX_DEPTH levels, and a lane at most one entry a level.
                let Some(entry) = self.stack[lane].get_mut(depth) else { continue };
                *entry = Entry {
                    node: pushed.rows[0].0[lane],
                    enter: f32::from_bits(pushed.rows[1].0[lane]),
                    exit: f32::from_bits(pushed.rows[2].0[lane]),
                    padding: 0,
                };
                self.depth[lane] = depth + 1;
            }
            store(&mut self.exit, _mm512_mask_min_ps(exit, both, exit, greatest));
        }
        let next = _mm512_mask_blend_epi32(only_far, near, far);
        store_words(&mut self.node, _mm512_mask_blend_epi32(interior, node, next));

        if leaf != 0 {
            let empty = _mm512_mask_cmpeq_epi32_mask(leaf, index, zero);
            let full = leaf & !empty;
            // SAFETY: rows are 64 aligned bytes.
            unsafe {
                _mm512_mask_store_epi32(self.leaf_first.0.as_mut_ptr().cast(), full, word);
                _mm512_mask_store_epi32(self.leaf_count.0.as_mut_ptr().cast(), full, index);
            }
            self.waiting |= full;
            self.stepping &= !full;
            let mut rest = empty;
            while rest != 0 {
                self.pop(take_lane(&mut rest));
            }
        }
    }

    /// Takes a lane to its next stack entry that may still hold a nearer hit; without any, its ray
    /// is answered.
    #[inline(always)]
    fn pop(&mut self, lane: usize) {
        let bit = 1 << lane;
        let mut depth = self.depth[lane];
        let stop = self.best[lane].stop;
        loop {
            if depth == 0 {
                self.stepping &= !bit;
                self.idle |= bit;
                break;
            }
            depth -= 1;
            let entry = self.stack[lane][depth];
            if entry.enter <= stop {
                self.node.0[lane] = entry.node;
                self.enter.0[lane] = entry.enter;
                self.exit.0[lane] = entry.exit;
                self.stepping |= bit;
                break;
            }
        }
        self.depth[lane] = depth;
    }

    /// Tests the leaves that lanes wait at, and sends the lanes on.
    ///
    /// # Safety
    /// AVX-512.
    #[target_feature(enable = "avx512f,avx512dq")]
    unsafe fn test_leaves(&mut self, blocks: &Blocks, options: &QueryOptions, query: Query) {
        let mut rest = self.waiting;
        if rest == 0 {
            return;
        }
        while rest != 0 {
            let lane = take_lane(&mut rest);
            let leaf = blocks.leaf(self.leaf_first.0[lane], self.leaf_count.0[lane]);
            let best = &mut self.best[lane];
            let ray = &self.ray[lane];
            // SAFETY: the instruction set, by contract; wide rays get no lane.
            if unsafe { test_leaf(InstructionSet::Avx512, ray, leaf, options, query, best) } {
                // Answered: nothing left to visit.
                self.depth[lane] = 0;
            }
            self.pop(lane);
        }
        self.waiting = 0;
    }

    /// Gives answers of idle lanes and new rays to them.
    ///
    /// # Safety
    /// AVX-512.
    #[target_feature(enable = "avx512f,avx512dq")]
    unsafe fn refill(
        &mut self,
        source: &mut Source<'_>,
        options: &QueryOptions,
        query: Query,
        answer: &mut impl FnMut(usize, Hit),
    ) {
        let mut rest = self.idle;
        while rest != 0 {
            let lane = take_lane(&mut rest);
            if self.index[lane] != usize::MAX {
                answer(self.index[lane], self.best[lane].hit);
                self.index[lane] = usize::MAX;
            }
            // SAFETY: the instruction set, by contract.
            let Some((from, index)) = (unsafe { source.next(options, query, answer) }) else {
                continue;
            };
            let ready = &source.ready;
            let bit = 1 << lane;
            for axis in 0..3 {
                self.origin[axis].0[lane] = ready.origin[axis][from];
                self.reciprocal[axis].0[lane] = ready.reciprocal[axis][from];
                self.slack[axis].0[lane] = ready.slack[axis][from];
                self.backwards[axis] &= !bit;
                self.backwards[axis] |= if ready.direction[axis][from] < 0.0 { bit } else { 0 };
            }
            self.enter.0[lane] = ready.enter[from];
            self.exit.0[lane] = ready.exit[from];
            self.node.0[lane] = 0;
            self.depth[lane] = 0;
            self.best[lane] = Best::NONE;
            self.ray[lane] = ready.ray(from);
            self.index[lane] = index;
            self.idle &= !bit;
            self.stepping |= bit;
        }
    }
}
