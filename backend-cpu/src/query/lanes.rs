//! Batches by lanes: one ray a SIMD lane, 16 in a group, several groups in flight (AVX-512).
//!
//! Lanes step through interior nodes and empty leaves together, each at a node of its own; nodes are
//! gathered, stacks scattered. When too few lanes of all groups still step, each lane that reached a
//! leaf tests its triangles, 16 at once, and goes on; a lane whose ray is answered takes the next
//! one. Groups take turns, so that one's gathers are under way while another computes.

use core::arch::x86_64::*;

use splitplane_core::arithmetic::Strict;
use splitplane_core::config::MAX_DEPTH;
use splitplane_core::intersect::{PLANE_SLACK, PreparedRay, SceneScale};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::traverse::Query;

use super::blocks::Blocks;
use super::leaf::InstructionSet;
use super::single::{self, Best, test_leaf};

/// Rays of a group.
const LANES: usize = 16;
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
    stack_node: [Row<u32>; MAX_DEPTH as usize + 1],
    stack_enter: [Row<f32>; MAX_DEPTH as usize + 1],
    stack_exit: [Row<f32>; MAX_DEPTH as usize + 1],
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
    let mut source = Source { scene, blocks, rays, next: 0 };
    let blank = PreparedRay {
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
    let mut groups: [Group; GROUPS] = core::array::from_fn(|_| Group {
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
        stepping: 0,
        waiting: 0,
        idle: u16::MAX,
        best: [Best::NONE; LANES],
        ray: [blank; LANES],
        index: [usize::MAX; LANES],
        stack_node: [Row([0; LANES]); MAX_DEPTH as usize + 1],
        stack_enter: [Row([0.0; LANES]); MAX_DEPTH as usize + 1],
        stack_exit: [Row([0.0; LANES]); MAX_DEPTH as usize + 1],
    });
    loop {
        let mut alive = 0;
        for group in &mut groups {
            // SAFETY: the instruction set, by contract.
            unsafe {
                group.test_leaves(blocks, options, query);
                group.refill(&mut source, options, query, answer);
            }
            alive |= group.stepping | group.waiting;
        }
        if alive == 0 {
            return;
        }
        let enough = if source.next < rays.len() { ENOUGH } else { 1 };
        loop {
            let mut stepping = 0;
            for group in &mut groups {
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

/// Where lanes get their rays.
struct Source<'a> {
    scene: &'a SceneScale,
    blocks: &'a Blocks,
    rays: &'a [Ray],
    next: usize,
}

impl Source<'_> {
    /// The next ray that needs a lane. Those that miss the bounds, and those whose exponents call
    /// for the scaled test, are answered on the way.
    fn next(
        &mut self,
        options: &QueryOptions,
        query: Query,
        answer: &mut impl FnMut(usize, Hit),
    ) -> Option<(usize, PreparedRay, (f32, f32))> {
        while let Some(ray) = self.rays.get(self.next) {
            let index = self.next;
            self.next += 1;
            let prepared = PreparedRay::new::<Strict>(ray, self.scene);
            let interval =
                prepared.as_ref().and_then(|ray| ray.enter::<Strict>(&self.scene.bounds));
            match (prepared, interval) {
                (Some(prepared), Some(interval)) if !prepared.wide => {
                    return Some((index, prepared, interval));
                }
                (Some(prepared), Some(interval)) => {
                    let set = InstructionSet::Portable;
                    // SAFETY: every processor has the portable set.
                    let hit = unsafe {
                        single::trace(set, self.blocks, &prepared, interval, options, query)
                    };
                    answer(index, hit);
                }
                _ => answer(index, Hit::MISS),
            }
        }
        None
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
        // SAFETY: lanes that step stand at nodes of the tree; a node is 8 bytes.
        let (word, tagged) = unsafe {
            (
                _mm512_mask_i32gather_epi32::<8>(zero, active, node, base.cast()),
                _mm512_mask_i32gather_epi32::<8>(zero, active, node, base.add(4).cast()),
            )
        };
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
            let depth = load_words(&self.depth);
            let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
            let slot = _mm512_add_epi32(_mm512_slli_epi32::<4>(depth), lanes);
            // SAFETY: a lane's stack holds at most one entry a level, and a valid tree has at most
            // MAX_DEPTH levels.
            unsafe {
                _mm512_mask_i32scatter_epi32::<4>(
                    self.stack_node.as_mut_ptr().cast(),
                    both,
                    slot,
                    far,
                );
                _mm512_mask_i32scatter_ps::<4>(
                    self.stack_enter.as_mut_ptr().cast(),
                    both,
                    slot,
                    _mm512_max_ps(least, enter),
                );
                _mm512_mask_i32scatter_ps::<4>(
                    self.stack_exit.as_mut_ptr().cast(),
                    both,
                    slot,
                    exit,
                );
            }
            store_words(
                &mut self.depth,
                _mm512_mask_add_epi32(depth, both, depth, _mm512_set1_epi32(1)),
            );
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
            if empty != 0 {
                // SAFETY: the instruction set, by contract.
                unsafe { self.pop(empty) };
            }
        }
    }

    /// Takes these lanes to their next stack entries that may still hold a nearer hit; lanes
    /// without any are answered.
    ///
    /// # Safety
    /// AVX-512.
    #[target_feature(enable = "avx512f,avx512dq")]
    #[inline]
    unsafe fn pop(&mut self, lanes: __mmask16) {
        let mut seeking = lanes;
        let one = _mm512_set1_epi32(1);
        let numbers = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        let stop = load(&self.stop);
        let mut depth = load_words(&self.depth);
        let (mut node, mut enter, mut exit) =
            (load_words(&self.node), load(&self.enter), load(&self.exit));
        loop {
            let done = _mm512_mask_cmpeq_epi32_mask(seeking, depth, _mm512_setzero_si512());
            self.stepping &= !done;
            self.idle |= done;
            seeking &= !done;
            if seeking == 0 {
                break;
            }
            depth = _mm512_mask_sub_epi32(depth, seeking, depth, one);
            let slot = _mm512_add_epi32(_mm512_slli_epi32::<4>(depth), numbers);
            // SAFETY: depth counts entries that `step` wrote.
            unsafe {
                enter = _mm512_mask_i32gather_ps::<4>(
                    enter,
                    seeking,
                    slot,
                    self.stack_enter.as_ptr().cast(),
                );
                let found = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(seeking, enter, stop);
                node = _mm512_mask_i32gather_epi32::<4>(
                    node,
                    found,
                    slot,
                    self.stack_node.as_ptr().cast(),
                );
                exit = _mm512_mask_i32gather_ps::<4>(
                    exit,
                    found,
                    slot,
                    self.stack_exit.as_ptr().cast(),
                );
                self.stepping |= found;
                seeking &= !found;
            }
        }
        store_words(&mut self.depth, depth);
        store_words(&mut self.node, node);
        store(&mut self.enter, enter);
        store(&mut self.exit, exit);
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
                self.depth.0[lane] = 0;
            }
            self.stop.0[lane] = best.stop;
        }
        // SAFETY: as above.
        unsafe { self.pop(self.waiting) };
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
            let Some((index, ray, (enter, exit))) = source.next(options, query, answer) else {
                continue;
            };
            let bit = 1 << lane;
            for axis in 0..3 {
                self.origin[axis].0[lane] = ray.origin[axis];
                self.reciprocal[axis].0[lane] = ray.reciprocal[axis];
                self.slack[axis].0[lane] = ray.slack[axis];
                self.backwards[axis] &= !bit;
                self.backwards[axis] |= if ray.direction[axis] < 0.0 { bit } else { 0 };
            }
            self.enter.0[lane] = enter;
            self.exit.0[lane] = exit;
            self.stop.0[lane] = f32::INFINITY;
            self.node.0[lane] = 0;
            self.depth.0[lane] = 0;
            self.best[lane] = Best::NONE;
            self.ray[lane] = ray;
            self.index[lane] = index;
            self.idle &= !bit;
            self.stepping |= bit;
        }
    }
}
