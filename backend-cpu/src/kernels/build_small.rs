//! `build_small`: one workgroup a small root.
//!
//! Reads: small roots and their references. Writes: nodes and references of each root's subtree.
//! Ties: least cost, then axis, then position.
//!
//! The small-node stage of Zhou et al. 2008 on 64-bit masks: the candidates are the faces of the
//! references' bounds as they stand in the root; a candidate counts only where its own triangle is
//! in the node and the plane lies strictly inside. Depth first, left before right. A root emits at
//! most [`SMALL_ROOT_NODES`] nodes and [`SMALL_ROOT_REFERENCES`] references: a node whose split
//! would exceed either becomes a leaf. A root of more than T references is one leaf.

use rayon::prelude::*;
use splitplane_core::aabb::{Aabb, max, min};
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::config::{BuildConfig, MAX_DEPTH, SMALL_ROOT_NODES, SMALL_ROOT_REFERENCES};
use splitplane_core::layout::{Extent, Reference, SmallRoot};
use splitplane_core::mask::TriangleMask;
use splitplane_core::node::{Axis, KdNode};
use splitplane_core::sah::Extents;
use splitplane_core::split::{Rank, SplitPlane, goes_left, goes_right, strictly_inside};

use crate::lookout::Lookout;
use crate::query::InstructionSet;

/// Roots of one task. Their subtrees share two vectors.
pub const BATCH: usize = 32;

/// The subtrees of one batch, one behind the other. Indices count from each subtree's start.
#[derive(Debug, Default)]
pub struct Subtrees {
    /// Nodes.
    pub nodes: Vec<KdNode>,
    /// References.
    pub references: Vec<u32>,
}

impl Subtrees {
    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        (self.nodes.capacity() * size_of::<KdNode>() + self.references.capacity() * 4) as u64
    }
}

/// Runs the kernel. `subtrees` holds one element for each [`BATCH`] roots.
pub fn run<A: Arithmetic>(
    look: &Lookout<'_>,
    config: &BuildConfig,
    set: InstructionSet,
    roots: &[SmallRoot],
    references: &[Reference],
    sizes: &mut [Extent],
    subtrees: &mut [Subtrees],
) {
    roots.par_chunks(BATCH).zip(sizes.par_chunks_mut(BATCH)).zip(subtrees).for_each(
        |((roots, sizes), out)| {
            if look.is_over() {
                return;
            }
            let count = roots.len() as u64;
            match set {
                #[cfg(target_arch = "x86_64")]
                // SAFETY: the executor holds only sets that the processor has.
                InstructionSet::Avx512 => unsafe {
                    batch_16::<A>(config, roots, references, sizes, out);
                },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: as above.
                InstructionSet::Avx2 => unsafe {
                    batch_8::<A>(config, roots, references, sizes, out);
                },
                _ => batch::<A, Loops>(config, roots, references, sizes, out),
            }
            look.advance(count);
            // A root takes some tens of microseconds.
            look.worked(256 * count);
        },
    );
}

/// [`batch`], compiled for AVX-512.
///
/// # Safety
/// The processor must have it.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,bmi1,bmi2,popcnt")]
unsafe fn batch_16<A: Arithmetic>(
    config: &BuildConfig,
    roots: &[SmallRoot],
    references: &[Reference],
    sizes: &mut [Extent],
    out: &mut Subtrees,
) {
    batch::<A, Avx512>(config, roots, references, sizes, out);
}

/// [`batch`], compiled for AVX2.
///
/// # Safety
/// The processor must have it.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
unsafe fn batch_8<A: Arithmetic>(
    config: &BuildConfig,
    roots: &[SmallRoot],
    references: &[Reference],
    sizes: &mut [Extent],
    out: &mut Subtrees,
) {
    batch::<A, Loops>(config, roots, references, sizes, out);
}

/// Builds the subtrees of a batch.
#[inline(always)]
fn batch<A: Arithmetic, C: CountSides>(
    config: &BuildConfig,
    roots: &[SmallRoot],
    references: &[Reference],
    sizes: &mut [Extent],
    out: &mut Subtrees,
) {
    out.nodes.clear();
    out.references.clear();
    let costs = Costs::of(config);
    let mut scratch = Root::new();
    for (root, size) in roots.iter().zip(sizes) {
        let mine = &references[root.first as usize..(root.first + root.count) as usize];
        let before = (out.nodes.len(), out.references.len());
        if root.count <= config.small_node_limit {
            scratch.load(mine);
            scratch.build::<A, C>(&costs, root, out);
        } else {
            out.nodes.push(KdNode::leaf(0, root.count));
            out.references.extend(mine.iter().map(|reference| reference.triangle));
        }
        *size = Extent {
            nodes: (out.nodes.len() - before.0) as u32,
            references: (out.references.len() - before.1) as u32,
        };
    }
}

/// A small root in cache: the bounds of its references, by axis.
struct Root {
    count: usize,
    triangles: [u32; 64],
    lo: [[f32; 64]; 3],
    hi: [[f32; 64]; 3],
}

/// A node not yet decided.
#[derive(Clone, Copy)]
struct Pending {
    mask: u64,
    cell: Aabb,
    depth: u32,
    /// The interior node whose right child this is; `u32::MAX` for a left child.
    parent: u32,
}

/// The bounds of one node's references on one axis, side by side, padded to whole blocks.
struct Faces {
    lo: [f32; 64],
    hi: [f32; 64],
}

impl Root {
    fn new() -> Root {
        Root { count: 0, triangles: [0; 64], lo: [[0.0; 64]; 3], hi: [[0.0; 64]; 3] }
    }

    fn load(&mut self, references: &[Reference]) {
        self.count = references.len();
        for (i, reference) in references.iter().enumerate() {
            self.triangles[i] = reference.triangle;
            for axis in 0..3 {
                self.lo[axis][i] = reference.lo[axis];
                self.hi[axis][i] = reference.hi[axis];
            }
        }
    }

    #[inline(always)]
    fn build<A: Arithmetic, C: CountSides>(
        &self,
        costs: &Costs,
        root: &SmallRoot,
        out: &mut Subtrees,
    ) {
        let first_node = out.nodes.len();
        let first_reference = out.references.len();
        let mask = TriangleMask::first(self.count as u32).bits();
        // Allocated so far, those pending included: what the caps of a root count.
        let (mut nodes, mut references) = (1, root.count);
        let mut stack = [Pending { mask, cell: root.cell(), depth: root.depth, parent: u32::MAX };
            MAX_DEPTH as usize + 2];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let node = stack[top];
            let index = out.nodes.len() - first_node;
            if node.parent != u32::MAX {
                // The parent was written with its right child unknown.
                let parent = &mut out.nodes[first_node + node.parent as usize];
                let [split, tagged] = parent.words();
                *parent = KdNode::from_words([split, tagged | (index as u32) << 2]);
            }
            let count = node.mask.count_ones();
            let plane = if node.depth < costs.max_depth {
                self.best_split::<A, C>(costs, &node)
            } else {
                None
            };
            if let Some(plane) = plane {
                let (left, right) = self.sides(node.mask, plane);
                let after = references + left.count_ones() + right.count_ones() - count;
                if nodes + 2 <= SMALL_ROOT_NODES && after <= SMALL_ROOT_REFERENCES {
                    nodes += 2;
                    references = after;
                    out.nodes.push(KdNode::interior(
                        Axis::from_index(plane.axis as u32),
                        plane.position,
                        0,
                    ));
                    let (mut left_cell, mut right_cell) = (node.cell, node.cell);
                    left_cell.hi[plane.axis] = plane.position;
                    right_cell.lo[plane.axis] = plane.position;
                    let depth = node.depth + 1;
                    stack[top] =
                        Pending { mask: right, cell: right_cell, depth, parent: index as u32 };
                    stack[top + 1] =
                        Pending { mask: left, cell: left_cell, depth, parent: u32::MAX };
                    top += 2;
                    continue;
                }
            }
            let first = (out.references.len() - first_reference) as u32;
            out.nodes.push(KdNode::leaf(first, count));
            let mut rest = node.mask;
            while rest != 0 {
                out.references.push(self.triangles[rest.trailing_zeros() as usize]);
                rest &= rest - 1;
            }
        }
    }

    /// The masks of a plane: which triangles of a node go left, which right. The paper makes them
    /// for every candidate beforehand; here only a chosen plane needs them.
    #[inline(always)]
    fn sides(&self, mask: u64, plane: SplitPlane) -> (u64, u64) {
        let (lo, hi) = (&self.lo[plane.axis], &self.hi[plane.axis]);
        let (mut left, mut right) = (0, 0);
        for j in 0..self.count {
            left |= u64::from(goes_left(lo[j], hi[j], plane.position)) << j;
            right |= u64::from(goes_right(hi[j], plane.position)) << j;
        }
        (left & mask, right & mask)
    }

    /// The split of least rank, if it costs less than a leaf.
    #[inline(always)]
    fn best_split<A: Arithmetic, C: CountSides>(
        &self,
        costs: &Costs,
        node: &Pending,
    ) -> Option<SplitPlane> {
        let count = node.mask.count_ones();
        if count == 0 {
            return None;
        }
        let extents = Extents::of::<A>(&node.cell)?;
        let area = Extents::half_area(extents.cells);
        let leaf = costs.intersection * costs.blocks(count) * area;
        if leaf <= costs.traversal * area {
            return None;
        }
        let mut best = Candidate { rank: Rank { cost: leaf, axis: 0, position: 0 }, plane: None };
        if count <= costs.block_width {
            self.cut_empty::<A>(costs, node, &extents, area, &mut best);
            return best.plane;
        }
        let mut faces = Faces { lo: [0.0; 64], hi: [0.0; 64] };
        let n = count as usize;
        for axis in 0..3 {
            let mut rest = node.mask;
            for k in 0..n {
                let i = rest.trailing_zeros() as usize & 63;
                rest &= rest.wrapping_sub(1);
                faces.lo[k] = self.lo[axis][i];
                faces.hi[k] = self.hi[axis][i];
            }
            for start in (0..n).step_by(BLOCK) {
                let end = (start + BLOCK).min(n);
                for positions in [&faces.lo[start..end], &faces.hi[start..end]] {
                    let cell = &node.cell;
                    consider::<A, C>(costs, cell, &extents, axis, positions, &faces, n, &mut best);
                }
            }
        }
        best.plane
    }
}

impl Root {
    /// Candidates of a node that fits one block. With triangles on both sides a split costs no less
    /// than the leaf's one block, since the parts' areas add up to more than the whole's. Only
    /// planes with nothing on one side can win, and the best of those touch the outermost bounds.
    #[inline(always)]
    fn cut_empty<A: Arithmetic>(
        &self,
        costs: &Costs,
        node: &Pending,
        extents: &Extents,
        area: u32,
        best: &mut Candidate,
    ) {
        let traversal = costs.traversal * area;
        for axis in 0..3 {
            let (lo, hi) = (&self.lo[axis], &self.hi[axis]);
            let (mut lowest, mut highest, mut first_end) = (f32::MAX, -f32::MAX, f32::MAX);
            let mut rest = node.mask;
            while rest != 0 {
                let i = rest.trailing_zeros() as usize & 63;
                rest &= rest - 1;
                lowest = min(lowest, lo[i]);
                highest = max(highest, hi[i]);
                first_end = min(first_end, hi[i]);
            }
            // A triangle planar in the lowest plane goes left of it, which is then not empty.
            for (position, full_side, empty) in
                [(lowest, 2, first_end > lowest), (highest, 1, true)]
            {
                if !(empty && strictly_inside(&node.cell, axis, position)) {
                    continue;
                }
                let offset = extents.offset::<A>(node.cell.lo[axis], position);
                let full = extents.split_areas(axis, offset)[full_side];
                let rank = Rank::new(traversal + costs.intersection * full, axis, position);
                if rank < best.rank {
                    *best = Candidate { rank, plane: Some(SplitPlane { axis, position }) };
                }
            }
        }
    }
}

/// Candidates evaluated together.
const BLOCK: usize = 16;

/// Counts, for each of [`BLOCK`] planes, the references that go left and those that end at or before
/// the plane: all others go right.
trait CountSides {
    fn count(faces: &Faces, count: usize, planes: &[f32; BLOCK]) -> [[u32; BLOCK]; 2];
}

/// By loops that a compiler may turn into vector instructions.
struct Loops;

impl CountSides for Loops {
    #[inline(always)]
    fn count(faces: &Faces, count: usize, planes: &[f32; BLOCK]) -> [[u32; BLOCK]; 2] {
        let (mut left, mut ended) = ([0u32; BLOCK], [0u32; BLOCK]);
        for j in 0..count {
            let (lo, hi) = (faces.lo[j], faces.hi[j]);
            for k in 0..BLOCK {
                left[k] += u32::from(goes_left(lo, hi, planes[k]));
                ended[k] += u32::from(!goes_right(hi, planes[k]));
            }
        }
        [left, ended]
    }
}

/// By AVX-512: [`batch_16`] alone uses it.
#[cfg(target_arch = "x86_64")]
struct Avx512;

#[cfg(target_arch = "x86_64")]
impl CountSides for Avx512 {
    #[inline(always)]
    fn count(faces: &Faces, count: usize, planes: &[f32; BLOCK]) -> [[u32; BLOCK]; 2] {
        use core::arch::x86_64::*;
        let mut out = [[0u32; BLOCK]; 2];
        // SAFETY: only `batch_16` is instantiated with this type, and it demands AVX-512; loads and
        // stores are of arrays of 16 words.
        unsafe {
            let planes = _mm512_loadu_ps(planes.as_ptr());
            let one = _mm512_set1_epi32(1);
            let (mut left, mut ended) = (_mm512_setzero_si512(), _mm512_setzero_si512());
            for j in 0..count {
                let (lo, hi) = (_mm512_set1_ps(faces.lo[j]), _mm512_set1_ps(faces.hi[j]));
                let ends = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(hi, planes);
                let starts = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(lo, planes);
                left = _mm512_mask_add_epi32(left, starts | ends, left, one);
                ended = _mm512_mask_add_epi32(ended, ends, ended, one);
            }
            _mm512_storeu_si512(out[0].as_mut_ptr().cast(), left);
            _mm512_storeu_si512(out[1].as_mut_ptr().cast(), ended);
        }
        out
    }
}

/// The least candidate so far.
struct Candidate {
    rank: Rank,
    plane: Option<SplitPlane>,
}

/// What of the configuration costs depend on, with the division by W made a multiplication.
struct Costs {
    traversal: u32,
    intersection: u32,
    block_width: u32,
    max_depth: u32,
    /// 2^16 / W, rounded up past any fraction: exact for numerators below 1,024.
    reciprocal: u32,
}

impl Costs {
    fn of(config: &BuildConfig) -> Costs {
        Costs {
            traversal: config.traversal_cost,
            intersection: config.intersection_cost,
            block_width: config.block_width,
            max_depth: config.max_depth,
            reciprocal: (1 << 16) / config.block_width + 1,
        }
    }

    /// `ceil(count / W)` for counts of at most 64.
    #[inline(always)]
    fn blocks(&self, count: u32) -> u32 {
        ((count + self.block_width - 1) * self.reciprocal) >> 16
    }
}

/// Evaluates up to [`BLOCK`] planes of one axis, all at once: loops without branches over arrays,
/// which compilers turn into vector instructions.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "one inner loop, cut out for reading")]
fn consider<A: Arithmetic, C: CountSides>(
    costs: &Costs,
    cell: &Aabb,
    extents: &Extents,
    axis: usize,
    positions: &[f32],
    faces: &Faces,
    count: usize,
    best: &mut Candidate,
) {
    let mut plane = [cell.lo[axis]; BLOCK];
    plane[..positions.len()].copy_from_slice(positions);
    let [left, ended] = C::count(faces, count, &plane);
    let (low, high) = (cell.lo[axis], cell.hi[axis]);
    let half_low = A::snapped_product(low, 0.5);
    let [_, b, c] = [0, 1, 2].map(|k| extents.cells[(axis + k) % 3].max(1));
    let (rim, cap) = (b + c, b * c);
    let whole = extents.cells[axis];
    let area = whole.max(1) * rim + cap;
    let mut cost = [0u32; BLOCK];
    for k in 0..BLOCK {
        let inside = (low < plane[k]) & (plane[k] < high);
        // Planes outside give any offset; it must only not overflow what follows.
        let half = A::snapped_difference(A::snapped_product(plane[k], 0.5), half_low);
        let offset = A::product(half, extents.scale) as i32 as u32;
        let offset = offset.min(whole);
        let left_area = offset.max(1) * rim + cap;
        let right_area = (whole - offset).max(1) * rim + cap;
        let sum =
            costs.blocks(left[k]) * left_area + costs.blocks(count as u32 - ended[k]) * right_area;
        let total = costs.traversal * area + costs.intersection * sum;
        cost[k] = if inside { total } else { u32::MAX };
    }
    let least = cost.iter().fold(u32::MAX, |m, &x| m.min(x));
    if least > best.rank.cost {
        return;
    }
    for k in 0..positions.len() {
        if cost[k] <= best.rank.cost {
            let rank = Rank::new(cost[k], axis, plane[k]);
            if rank < best.rank {
                *best = Candidate { rank, plane: Some(SplitPlane { axis, position: plane[k] }) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::arithmetic::Strict;
    use splitplane_core::sah::{leaf_cost, split_cost};

    /// The stage as the paper has it: every candidate of every triangle, costs by core's functions,
    /// counts from masks.
    fn by_masks(config: &BuildConfig, root: &Root, node: &Pending) -> Option<SplitPlane> {
        let extents = Extents::of::<Strict>(&node.cell)?;
        let area = Extents::half_area(extents.cells);
        let count = node.mask.count_ones();
        let mut best = Rank { cost: leaf_cost(config, area, count), axis: 0, position: 0 };
        let mut found = None;
        for axis in 0..3 {
            for triangle in TriangleMask::from_bits(node.mask).iter() {
                let i = triangle as usize;
                for position in [root.lo[axis][i], root.hi[axis][i]] {
                    if !strictly_inside(&node.cell, axis, position) {
                        continue;
                    }
                    let plane = SplitPlane { axis, position };
                    let (left, right) = root.sides(node.mask, plane);
                    let offset = extents.offset::<Strict>(node.cell.lo[axis], position);
                    let areas = extents.split_areas(axis, offset);
                    let cost = split_cost(config, areas, left.count_ones(), right.count_ones());
                    let rank = Rank::new(cost, axis, position);
                    if rank < best {
                        (best, found) = (rank, Some(plane));
                    }
                }
            }
        }
        found
    }

    #[test]
    fn the_same_planes_as_by_masks() {
        let mut state = 3u32;
        let mut next = move || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            // A coarse grid, so that planes coincide and triangles are planar.
            (state >> 24) as f32 / 16.0
        };
        let mut splits = 0;
        for round in 0..400 {
            let count = 1 + (round * 7) % 64;
            let mut root = Root::new();
            let references: Vec<Reference> = (0..count)
                .map(|triangle| {
                    let a = [next(), next(), next()];
                    let b = [a[0] + next() / 8.0, a[1] + next() / 8.0, a[2]];
                    Reference::new(&Aabb { lo: a, hi: b }, triangle)
                })
                .collect();
            root.load(&references);
            let cell = references.iter().fold(Aabb::EMPTY, |c, r| c.union(&r.bounds()));
            for (traversal, intersection, width) in [(1, 4, 16), (3, 2, 1), (1, 1, 4), (1, 8, 7)] {
                let config = BuildConfig {
                    traversal_cost: traversal,
                    intersection_cost: intersection,
                    block_width: width,
                    ..BuildConfig::default()
                };
                for mask in [u64::MAX, 0x5555_5555_5555_5555, 0x0f0f_00ff_0000_ffff] {
                    let mask = mask & TriangleMask::first(count).bits();
                    let node = Pending { mask, cell, depth: 0, parent: u32::MAX };
                    let found = root.best_split::<Strict, Loops>(&Costs::of(&config), &node);
                    assert_eq!(found, by_masks(&config, &root, &node));
                    splits += usize::from(found.is_some());
                }
            }
        }
        assert!(splits > 500, "{splits}");
    }

    #[test]
    fn division_by_w_is_exact() {
        for block_width in 1..=64 {
            let costs = Costs::of(&BuildConfig { block_width, ..BuildConfig::default() });
            for count in 0..=64 {
                assert_eq!(costs.blocks(count), count.div_ceil(block_width));
            }
        }
    }
}
