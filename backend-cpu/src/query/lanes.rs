//! Batches by lanes: one ray a SIMD lane, 16 in a group, several groups in flight (AVX-512).
//!
//! Lanes step through interior nodes together, each at a node of its own. When too few lanes of all groups still step, each lane that reached a
//! leaf tests its triangles, 16 at once, and goes on; a lane whose ray is answered takes the next
//! one. Groups take turns, so that one's loads are under way while another computes. Rays that are
//! found to be coherent when they are made ready go to [`super::packet`] instead.

use core::arch::x86_64::*;
use core::cell::RefCell;

use splitplane_core::config::MAX_DEPTH;
use splitplane_core::intersect::{PLANE_SLACK, PreparedRay, SceneScale};
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::traverse::Query;

use super::blocks::{Blocks, WalkNode};
use super::exact;
use super::leaf::{InstructionSet, Sifted};
use super::packet::Packet;
use super::prepare::{LANES, PreparedRays, prepare_one};
use super::sieve::ExactLane;
use super::single::{self, Best, test_leaf};

/// Groups in flight.
const GROUPS: usize = 3;
/// Batches below this are traced one ray after the other: filling the lanes costs more.
pub const WORTHWHILE: usize = 2 * LANES;
/// Lanes of all groups that must still step for stepping to go on.
const ENOUGH: u32 = (GROUPS * LANES / 2) as u32;

/// Entries of a lane's stack: a valid tree has at most MAX_DEPTH levels, and a lane pushes at most
/// one entry a level.
const STACK: usize = MAX_DEPTH as usize + 1;
/// Place of the entries that nobody reads.
const NOWHERE: i32 = (LANES * STACK) as i32;

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

/// 16 rays under way.
#[repr(C, align(64))]
struct Group {
    origin: [Row<f32>; 3],
    reciprocal: [Row<f32>; 3],
    slack: [Row<f32>; 3],
    enter: Row<f32>,
    exit: Row<f32>,
    stop: Row<f32>,
    node: Row<u32>,
    /// Entries on each lane's stack.
    depth: Row<u32>,
    /// First block and number of triangles of the leaf a lane waits at.
    leaf_first: Row<u32>,
    leaf_count: Row<u32>,
    /// Lanes whose direction is negative on each axis.
    backwards: [__mmask16; 3],
    /// Lanes that go back to front: for any hit only.
    reversed: __mmask16,
    /// Lanes that stand at a node.
    stepping: __mmask16,
    /// Lanes that must go back to their stack.
    popping: __mmask16,
    /// Lanes that wait at a leaf with triangles.
    waiting: __mmask16,
    /// Lanes whose ray is answered or that never had one.
    idle: __mmask16,
    best: [Best; LANES],
    ray: [PreparedRay; LANES],
    /// The rays of accuracy `exact`, and what they hit.
    exact: [ExactLane; LANES],
    /// Room for the wide test.
    sifted: Sifted,
    /// Place of each lane's ray in the batch; `usize::MAX` for none.
    index: [usize; LANES],
    /// The stacks, lane after lane, and four entries that nobody reads.
    stack: [Entry; LANES * STACK + 4],
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
            limits: [0.0; 2],
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
            stop: Row([0.0; LANES]),
            node: Row([0; LANES]),
            depth: Row([0; LANES]),
            leaf_first: Row([0; LANES]),
            leaf_count: Row([0; LANES]),
            backwards: [0; 3],
            reversed: 0,
            stepping: 0,
            popping: 0,
            waiting: 0,
            idle: u16::MAX,
            best: [Best::NONE; LANES],
            ray: [ray; LANES],
            exact: [ExactLane::idle(); LANES],
            sifted: Sifted::new(),
            index: [usize::MAX; LANES],
            stack: [nothing; LANES * STACK + 4],
        }
    }
}

thread_local! {
    /// Kept between batches: all lanes are idle at the end of one.
    static GROUPS_IN_FLIGHT: RefCell<(Box<[Group; GROUPS]>, Packet)> =
        RefCell::new((Box::new(core::array::from_fn(|_| Group::new())), Packet::new()));
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
    GROUPS_IN_FLIGHT.with_borrow_mut(|(groups, packet)| {
        for group in groups.iter_mut() {
            // Idle lanes load their node like the others, and it must be one of this tree's: where
            // they last were may be beyond its end.
            group.node = Row([0; LANES]);
        }
        let mut source = Source { scene, blocks, rays, next: 0, ready, left: 0, packet };
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
            alive |= group.stepping | group.popping | group.waiting;
        }
        if alive == 0 {
            return;
        }
        let enough = if source.is_empty() { 1 } else { ENOUGH };
        loop {
            let mut stepping = 0;
            for group in groups.iter_mut() {
                // SAFETY: as above; the nodes are a valid tree's.
                unsafe {
                    if query == Query::Any {
                        group.step::<true>(&blocks.nodes);
                    } else {
                        group.step::<false>(&blocks.nodes);
                    }
                }
                stepping += (group.stepping | group.popping).count_ones();
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
    left: __mmask16,
    packet: &'a mut Packet,
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
                let shifted = options.accuracy == Accuracy::Exact && ready.shifted[lane] != 0;
                if ready.special[lane] != 0 || shifted {
                    let hit = self.trace_one(&chunk[lane], options, query);
                    answer(start + lane, hit);
                } else if ready.alive[lane] != 0 && ready.enter[lane] <= ready.exit[lane] {
                    self.left |= 1 << lane;
                } else {
                    answer(start + lane, Hit::MISS);
                }
            }
            // SAFETY: the instruction set, by contract.
            if unsafe { Packet::is_worthwhile(&self.ready, self.left, self.scene) } {
                let (rays, ready) = (self.left, &self.ready);
                // SAFETY: the instruction set, by contract; worthwhile packets are of one octant.
                let hits = unsafe {
                    self.packet.trace(self.blocks, self.scene, chunk, ready, rays, options, query)
                };
                while self.left != 0 {
                    let lane = take_lane(&mut self.left);
                    answer(start + lane, hits[lane]);
                }
            }
        }
        let lane = self.left.trailing_zeros() as usize;
        self.left &= self.left - 1;
        Some((lane, (self.next - 1) / LANES * LANES + lane))
    }

    #[cold]
    fn trace_one(&self, ray: &Ray, options: &QueryOptions, query: Query) -> Hit {
        if options.accuracy == Accuracy::Exact {
            return exact::trace_in_f64(self.blocks, &self.scene.bounds, ray, options, query);
        }
        let Some((ray, interval)) = prepare_one(ray, self.scene) else { return Hit::MISS };
        // SAFETY: every processor has the portable set.
        unsafe {
            let set = InstructionSet::Portable;
            single::trace(set, self.blocks, &ray, interval, options, query, None)
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

/// Eight nodes. Plain loads, put together: on some processors gathers are several times slower.
///
/// # Safety
/// AVX-512; indices `first..first + 8` must name nodes.
#[target_feature(enable = "avx512f,avx512dq")]
#[inline]
unsafe fn load_8(nodes: &[WalkNode], indices: &[u32; LANES], first: usize) -> __m512i {
    debug_assert!(indices[first..first + 8].iter().all(|&index| (index as usize) < nodes.len()));
    let base = nodes.as_ptr().cast::<i64>();
    // SAFETY: by contract; a node is 8 bytes.
    let pair = |i: usize| unsafe {
        let low = _mm_loadl_epi64(base.add(indices[first + i] as usize).cast());
        let high = base.add(indices[first + i + 1] as usize);
        _mm_castps_si128(_mm_loadh_pi_from(_mm_castsi128_ps(low), high))
    };
    let (a, b, c, d) = (pair(0), pair(2), pair(4), pair(6));
    let ab = _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(a), b);
    let cd = _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(c), d);
    _mm512_inserti64x4::<1>(_mm512_castsi256_si512(ab), cd)
}

/// `low` with its upper half read from memory.
///
/// # Safety
/// `high` must be readable.
#[inline(always)]
unsafe fn _mm_loadh_pi_from(low: __m128, high: *const i64) -> __m128 {
    // SAFETY: by contract; SSE2 is part of x86-64.
    unsafe { _mm_castpd_ps(_mm_loadh_pd(_mm_castps_pd(low), high.cast())) }
}

/// The four lowest lanes of a mask.
#[inline(always)]
fn lowest_4(mask: __mmask16) -> __mmask16 {
    let mut rest = mask;
    for _ in 0..4 {
        rest &= rest.wrapping_sub(1);
    }
    mask & !rest
}

/// The first slot of each lane's stack.
#[target_feature(enable = "avx512f,avx512dq")]
#[inline]
fn slot_of_lane() -> __m512i {
    const S: i32 = STACK as i32;
    let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    _mm512_mullo_epi32(lanes, _mm512_set1_epi32(S))
}

/// The four lowest words.
#[target_feature(enable = "avx512f,avx512dq")]
#[inline]
fn four(words: __m512i) -> __m128i {
    _mm512_castsi512_si128(words)
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
    unsafe fn step<const ANY: bool>(&mut self, nodes: &[WalkNode]) {
        let active = self.stepping;
        let zero = _mm512_setzero_si512();
        let node = load_words(&self.node);
        // SAFETY: every lane stands at a node of the tree, those that do not step too: at the root
        // or where they last were.
        let (low, high) =
            unsafe { (load_8(nodes, &self.node.0, 0), load_8(nodes, &self.node.0, 8)) };
        let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
        let odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
        let word = _mm512_permutex2var_epi32(low, even, high);
        let tagged = _mm512_permutex2var_epi32(low, odd, high);
        let axis = _mm512_and_si512(tagged, _mm512_set1_epi32(3));
        let leaf = _mm512_mask_cmpeq_epi32_mask(active, axis, _mm512_set1_epi32(3));
        let is_y = _mm512_cmpeq_epi32_mask(axis, _mm512_set1_epi32(1));
        let is_z = _mm512_cmpeq_epi32_mask(axis, _mm512_set1_epi32(2));
        let interior = active & !leaf;
        let index = _mm512_srli_epi32::<{ WalkNode::SHIFT }>(tagged);

        let pick = |rows: &[Row<f32>; 3]| {
            let xy = _mm512_mask_blend_ps(is_y, load(&rows[0]), load(&rows[1]));
            _mm512_mask_blend_ps(is_z, xy, load(&rows[2]))
        };
        let split = _mm512_castsi512_ps(word);
        let t = _mm512_mul_ps(_mm512_sub_ps(split, pick(&self.origin)), pick(&self.reciprocal));
        // Not fused: every path visits the same cells.
        let part = _mm512_mul_ps(_mm512_abs_ps(t), _mm512_set1_ps(PLANE_SLACK));
        let error = _mm512_add_ps(part, pick(&self.slack));
        let least = _mm512_sub_ps(t, error);
        let greatest = _mm512_add_ps(t, error);

        let is_x = !(is_y | is_z);
        let backwards =
            (self.backwards[0] & is_x) | (self.backwards[1] & is_y) | (self.backwards[2] & is_z);
        let left = _mm512_add_epi32(node, _mm512_set1_epi32(1));
        let near = _mm512_mask_blend_epi32(backwards, left, index);
        let far = _mm512_mask_blend_epi32(backwards, index, left);
        let (enter, exit) = (load(&self.enter), load(&self.exit));
        let before = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(interior, greatest, enter);
        let behind = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(interior, least, exit) & !before;
        let crossing = interior & !before & !behind;
        let bit = |bit: u32| _mm512_test_epi32_mask(tagged, _mm512_set1_epi32(bit as i32));
        let (left_empty, right_empty) = (bit(WalkNode::LEFT_EMPTY), bit(WalkNode::RIGHT_EMPTY));
        let near_empty = (left_empty & !backwards) | (right_empty & backwards);
        let far_empty = (left_empty & backwards) | (right_empty & !backwards);
        let visit_near = interior & !before & !near_empty;
        let visit_far = interior & !behind & !far_empty;
        let both = visit_near & visit_far;
        let far_enter = _mm512_mask_max_ps(enter, crossing, least, enter);
        let near_exit = _mm512_mask_min_ps(exit, crossing, exit, greatest);

        let mut depth = load_words(&self.depth);
        if both != 0 {
            let (mut other, mut other_enter, mut other_exit) = (far, far_enter, exit);
            if ANY {
                other = _mm512_mask_blend_epi32(self.reversed, far, near);
                other_enter = _mm512_mask_blend_ps(self.reversed, far_enter, enter);
                other_exit = _mm512_mask_blend_ps(self.reversed, exit, near_exit);
            }
            let slot = _mm512_add_epi32(slot_of_lane(), depth);
            let other_enter = _mm512_castps_si512(other_enter);
            let other_exit = _mm512_castps_si512(other_exit);
            let mut rest = both;
            while rest != 0 {
                // SAFETY: the instruction set; slots are within the stack, since depth counts the
                // entries of a lane.
                unsafe { self.push_4(rest, slot, other, other_enter, other_exit) };
                rest &= !lowest_4(rest);
            }
            depth = _mm512_mask_add_epi32(depth, both, depth, _mm512_set1_epi32(1));
        }
        let mut to_far = visit_far & !visit_near;
        if ANY {
            to_far |= both & self.reversed;
        }
        let next = _mm512_mask_blend_epi32(to_far, near, far);
        let mut node = _mm512_mask_blend_epi32(visit_near | visit_far, node, next);
        let mut enter = _mm512_mask_blend_ps(to_far, enter, far_enter);
        let mut exit = _mm512_mask_blend_ps(visit_near & !to_far, exit, near_exit);

        // Only the root of an empty tree is a leaf without triangles that a lane gets to.
        let nothing = _mm512_mask_cmpeq_epi32_mask(leaf, index, zero);
        let full = leaf & !nothing;
        // SAFETY: rows are 64 aligned bytes.
        unsafe {
            _mm512_mask_store_epi32(self.leaf_first.0.as_mut_ptr().cast(), full, word);
            _mm512_mask_store_epi32(self.leaf_count.0.as_mut_ptr().cast(), full, index);
        }
        self.waiting |= full;
        let mut stepping = visit_near | visit_far;
        let empty = active & !stepping & !full;

        // Four lanes at most go back to their stacks; others wait for the next step.
        let popping = self.popping | empty;
        let done = _mm512_mask_cmpeq_epi32_mask(popping, depth, zero);
        self.idle |= done;
        let popping = popping & !done;
        let four = lowest_4(popping);
        depth = _mm512_mask_sub_epi32(depth, four, depth, _mm512_set1_epi32(1));
        let slot = _mm512_add_epi32(slot_of_lane(), depth);
        // SAFETY: as above.
        let [popped_node, popped_enter, popped_exit] = unsafe { self.peek_4(four, slot) };
        node = _mm512_mask_expand_epi32(node, four, popped_node);
        let popped_enter = _mm512_castsi512_ps(popped_enter);
        enter = _mm512_mask_expand_ps(enter, four, popped_enter);
        exit = _mm512_mask_expand_ps(exit, four, _mm512_castsi512_ps(popped_exit));
        let found = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(four, enter, load(&self.stop));
        stepping |= found;
        self.popping = popping & !found;
        self.stepping = stepping;
        store_words(&mut self.depth, depth);
        store_words(&mut self.node, node);
        store(&mut self.enter, enter);
        store(&mut self.exit, exit);
    }

    /// Writes the entries of the four lowest lanes of a mask to their slots.
    ///
    /// # Safety
    /// AVX-512; the slots of the mask's lanes must be within the stack.
    #[target_feature(enable = "avx512f,avx512dq")]
    #[inline]
    unsafe fn push_4(
        &mut self,
        lanes: __mmask16,
        slot: __m512i,
        node: __m512i,
        enter: __m512i,
        exit: __m512i,
    ) {
        let slots = four(_mm512_mask_compress_epi32(_mm512_set1_epi32(NOWHERE), lanes, slot));
        let node = four(_mm512_maskz_compress_epi32(lanes, node));
        let enter = four(_mm512_maskz_compress_epi32(lanes, enter));
        let exit = four(_mm512_maskz_compress_epi32(lanes, exit));
        let (node_enter, exit_zero) =
            (_mm_unpacklo_epi32(node, enter), _mm_unpacklo_epi32(exit, _mm_setzero_si128()));
        let (node_enter_2, exit_zero_2) =
            (_mm_unpackhi_epi32(node, enter), _mm_unpackhi_epi32(exit, _mm_setzero_si128()));
        let stack = self.stack.as_mut_ptr();
        // SAFETY: slots are within the stack by contract; a lane that is not in the mask gives
        // NOWHERE, which is too.
        unsafe {
            let at = |slot: i32| stack.add(slot as usize).cast::<__m128i>();
            _mm_store_si128(
                at(_mm_extract_epi32::<0>(slots)),
                _mm_unpacklo_epi64(node_enter, exit_zero),
            );
            _mm_store_si128(
                at(_mm_extract_epi32::<1>(slots)),
                _mm_unpackhi_epi64(node_enter, exit_zero),
            );
            _mm_store_si128(
                at(_mm_extract_epi32::<2>(slots)),
                _mm_unpacklo_epi64(node_enter_2, exit_zero_2),
            );
            _mm_store_si128(
                at(_mm_extract_epi32::<3>(slots)),
                _mm_unpackhi_epi64(node_enter_2, exit_zero_2),
            );
        }
    }

    /// The entries at the slots of up to four lanes: node, enter, exit, lowest lane first.
    ///
    /// # Safety
    /// As for [`Group::push_4`].
    #[target_feature(enable = "avx512f,avx512dq")]
    #[inline]
    unsafe fn peek_4(&self, lanes: __mmask16, slot: __m512i) -> [__m512i; 3] {
        let slots = four(_mm512_mask_compress_epi32(_mm512_set1_epi32(NOWHERE), lanes, slot));
        let stack = self.stack.as_ptr();
        // SAFETY: as in `push_4`.
        let [a, b, c, d] = unsafe {
            let at = |slot: i32| _mm_load_si128(stack.add(slot as usize).cast::<__m128i>());
            [
                at(_mm_extract_epi32::<0>(slots)),
                at(_mm_extract_epi32::<1>(slots)),
                at(_mm_extract_epi32::<2>(slots)),
                at(_mm_extract_epi32::<3>(slots)),
            ]
        };
        let (ab, cd) = (_mm_unpacklo_epi32(a, b), _mm_unpacklo_epi32(c, d));
        let (ab_high, cd_high) = (_mm_unpackhi_epi32(a, b), _mm_unpackhi_epi32(c, d));
        [
            _mm512_castsi128_si512(_mm_unpacklo_epi64(ab, cd)),
            _mm512_castsi128_si512(_mm_unpackhi_epi64(ab, cd)),
            _mm512_castsi128_si512(_mm_unpacklo_epi64(ab_high, cd_high)),
        ]
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
            let (ray, set) = (&self.ray[lane], InstructionSet::Avx512);
            // SAFETY: the instruction set, by contract; wide rays get no lane.
            let answered = unsafe {
                if options.accuracy == Accuracy::Exact {
                    let exact = &mut self.exact[lane];
                    exact.test_leaf(set, ray, leaf, options, query, &mut best.stop)
                } else {
                    test_leaf(set, ray, leaf, options, query, &mut self.sifted, best)
                }
            };
            if answered {
                // Answered: nothing left to visit.
                self.depth.0[lane] = 0;
            }
            self.stop.0[lane] = best.stop;
        }
        self.popping |= self.waiting;
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
                let exact = options.accuracy == Accuracy::Exact;
                let hit = if exact { self.exact[lane].hit(query) } else { self.best[lane].hit };
                answer(self.index[lane], hit);
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
            self.reversed &= !bit;
            if query == Query::Any {
                let interval = (ready.enter[from], ready.exit[from]);
                let solid = single::far_end_is_solid(&ready.ray(from), interval);
                self.reversed |= if solid { bit } else { 0 };
            }
            self.enter.0[lane] = ready.enter[from];
            self.exit.0[lane] = ready.exit[from];
            self.node.0[lane] = 0;
            self.depth.0[lane] = 0;
            self.stop.0[lane] = f32::INFINITY;
            self.best[lane] = Best::NONE;
            self.ray[lane] = ready.ray(from);
            self.index[lane] = index;
            if options.accuracy == Accuracy::Exact {
                let (ray, bounds) = (&source.rays[index], &source.scene.bounds);
                // Rays that can hit nothing are not handed out.
                let exact = ExactLane::new(ray, &self.ray[lane], bounds);
                self.exact[lane] = exact.unwrap_or(ExactLane::idle());
            }
            self.idle &= !bit;
            self.stepping |= bit;
        }
    }
}
