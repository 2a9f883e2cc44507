//! `scatter_references`: one workgroup a chunk, one invocation a reference.
//!
//! Reads: decisions, sides, counts, references, corners of those that a plane cuts. Writes:
//! the references of the children, clipped to their side, in order; bounds by chunk and child.

use splitplane_core::aabb::{Aabb, max, min};
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::layout::{Chunk, ChunkBounds, ChunkSides, Decision, Reference, Sides};
use splitplane_core::triangle::{Triangle, clip};

use super::GRAIN;
use crate::cancel::ProgressMeter;
use crate::memory::Scatter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::span;

/// What the kernel reads.
#[derive(Debug)]
pub(crate) struct Inputs<'a> {
    /// T: a child of at most this many references is small.
    pub small_node_limit: u32,
    /// Whether references are clipped; if not, their bounds are cut at the plane.
    pub clip: bool,
    /// The chunks.
    pub chunks: &'a [Chunk],
    /// Decisions of the active nodes.
    pub decisions: &'a [Decision],
    /// References of the active nodes.
    pub references: &'a [Reference],
    /// Sides of the references of each chunk.
    pub reference_sides: &'a [ChunkSides],
    /// What each chunk gives to its node's children.
    pub chunk_counts: &'a [Sides],
    /// Corners by triangle index.
    pub triangles: &'a [Triangle],
}

/// Runs the kernel. `offsets` is scratch memory, one for each chunk.
pub(crate) fn run<A: Arithmetic>(
    meter: &ProgressMeter<'_>,
    inputs: &Inputs<'_>,
    next_references: &mut [Reference],
    small_references: &mut [Reference],
    chunk_bounds: &mut [ChunkBounds],
    offsets: &mut [Sides],
) {
    scan(inputs, offsets);
    let next = Scatter::new(next_references);
    let small = Scatter::new(small_references);
    let _loop = span::pieces_of(GRAIN);
    inputs
        .chunks
        .par_iter()
        .zip(inputs.reference_sides)
        .zip(&*offsets)
        .zip(chunk_bounds)
        .with_min_len(GRAIN)
        .for_each(|(((chunk, sides), offsets), bounds)| {
            let _piece = span::piece();
            if meter.record_work(2 * u64::from(chunk.count)) {
                return;
            }
            let decision = &inputs.decisions[chunk.node as usize];
            let (first, count) = (chunk.first as usize, chunk.count as usize);
            let references = &inputs.references[first..first + count];
            if decision.axis == Decision::TRANSFER {
                let offset = chunk.first - decision.source_first;
                let to = (decision.first.left + offset) as usize;
                // SAFETY: a transferred node has a range of its own, its chunks parts of it.
                unsafe { small.part(to, count) }.copy_from_slice(references);
                *bounds = ChunkBounds { sides: [Aabb::EMPTY; 2] };
                return;
            }
            let (axis, position) = (decision.axis as usize, decision.position);
            let going = sides.counts();
            let place = |total: u32, first: u32, offset: u32, count: usize| {
                let destination = if total > inputs.small_node_limit { &next } else { &small };
                // SAFETY: `allocate_children` gives each child a range of its own in the buffer of
                // its class, and the scan each chunk a part of that range.
                unsafe { destination.part((first + offset) as usize, count) }
            };
            let (Sides { left, right }, to) = (decision.counts, decision.first);
            let lefts = place(left, to.left, offsets.left, going.left as usize);
            let rights = place(right, to.right, offsets.right, going.right as usize);
            let (mut next_left, mut next_right) = (0, 0);
            let mut found = [EMPTY; 2];
            for (index, reference) in references.iter().enumerate() {
                let goes = |words: &[u32; 8]| words[index / 32] >> (index % 32) & 1 == 1;
                // A reference that goes to one side only may still have bounds that cross the plane:
                // its part on the other side came out empty.
                let crosses = reference.lo[axis] < position && position < reference.hi[axis];
                let parts = if crosses && !inputs.clip {
                    let mut parts = [*reference; 2];
                    parts[0].hi[axis] = position;
                    parts[1].lo[axis] = position;
                    parts
                } else if crosses {
                    let corners = &inputs.triangles[reference.triangle as usize];
                    clip::<A>(corners, &reference.bounds(), axis, position)
                        .map(|bounds| Reference::new(&bounds, reference.triangle))
                } else {
                    [*reference; 2]
                };
                if goes(&sides.left) {
                    enclose(&mut found[0], &parts[0]);
                    lefts[next_left] = parts[0];
                    next_left += 1;
                }
                if goes(&sides.right) {
                    enclose(&mut found[1], &parts[1]);
                    rights[next_right] = parts[1];
                    next_right += 1;
                }
            }
            let bounds_of = |found: &[[f32; 4]; 2]| Aabb {
                lo: [found[0][0], found[0][1], found[0][2]],
                hi: [found[1][0], found[1][1], found[1][2]],
            };
            let found = [bounds_of(&found[0]), bounds_of(&found[1])];
            *bounds = ChunkBounds { sides: found };
        });
}

/// Where the references of each chunk begin within its node's children: an exclusive scan over the node's chunks. Serial: it adds
/// two numbers for 256 references.
fn scan(inputs: &Inputs<'_>, offsets: &mut [Sides]) {
    let (mut node, mut before) = (None, Sides::default());
    for ((chunk, counts), offset) in inputs.chunks.iter().zip(inputs.chunk_counts).zip(offsets) {
        if node != Some(chunk.node) {
            (node, before) = (Some(chunk.node), Sides::default());
        }
        *offset = before;
        before.left += counts.left;
        before.right += counts.right;
    }
}

/// [`Aabb::EMPTY`], with a fourth column.
const EMPTY: [[f32; 4]; 2] = [[f32::MAX; 4], [-f32::MAX; 4]];

/// Widens bounds of four columns, of which the last is noise: the shape of a vector register.
#[cfg_attr(not(unoptimised), inline(always))]
fn enclose(bounds: &mut [[f32; 4]; 2], reference: &Reference) {
    let words: &[[f32; 4]; 2] = bytemuck::cast_ref(reference);
    for k in 0..4 {
        bounds[0][k] = min(bounds[0][k], words[0][k]);
        bounds[1][k] = max(bounds[1][k], words[1][k]);
    }
}
