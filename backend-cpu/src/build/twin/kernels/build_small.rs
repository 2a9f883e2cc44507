//! `build_small`: one workgroup a small root.
//!
//! Reads: small roots and their references. Writes: nodes and references of each root's subtree.
//! Ties: least cost, then axis, then position. A root of more than T references is one leaf.

use core::marker::PhantomData;
use std::collections::TryReserveError;

use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::config::BuildConfig;
use splitplane_core::layout::{Extent, Reference, SmallRoot};

use crate::build::twin::small_root::{SmallRootBuilder, SmallRootCosts};
use crate::build::twin::subtrees::Subtrees;
use crate::cancel::ProgressMeter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::simd::InstructionSet;
use crate::simd::references::ReferenceOps;
use crate::simd::{Compiled, Simd};
use crate::span;

/// Roots of one task. Their subtrees share two vectors.
pub(crate) const BATCH: usize = 32;

/// Runs the kernel. `subtrees` holds one element for each [`BATCH`] roots.
///
/// # Errors
/// Less memory than the subtrees take.
pub(crate) fn run<A: Arithmetic>(
    meter: &ProgressMeter<'_>,
    config: &BuildConfig,
    set: InstructionSet,
    roots: &[SmallRoot],
    references: &[Reference],
    sizes: &mut [Extent],
    subtrees: &mut [Subtrees],
) -> Result<(), TryReserveError> {
    let _loop = span::pieces_of(1);
    roots.par_chunks(BATCH).zip(sizes.par_chunks_mut(BATCH)).zip(subtrees).try_for_each(
        |((roots, sizes), out)| {
            let _piece = span::piece();
            if meter.is_cancelled() {
                return Ok(());
            }
            let count = roots.len() as u64;
            let batch =
                RootBatch::<A> { config, roots, references, sizes, out, arithmetic: PhantomData };
            // SAFETY: the executor holds only sets that the processor has.
            unsafe { set.run(batch) }?;
            meter.advance(count);
            // A root takes some tens of microseconds.
            meter.record_work(256 * count);
            Ok(())
        },
    )
}

/// [`batch`], compiled for each set.
struct RootBatch<'a, A> {
    config: &'a BuildConfig,
    roots: &'a [SmallRoot],
    references: &'a [Reference],
    sizes: &'a mut [Extent],
    out: &'a mut Subtrees,
    arithmetic: PhantomData<A>,
}

impl<A: Arithmetic> Compiled for RootBatch<'_, A> {
    type Output = Result<(), TryReserveError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<(), TryReserveError> {
        let RootBatch { config, roots, references, sizes, out, .. } = self;
        batch::<A, S>(config, roots, references, sizes, out)
    }
}

/// Builds the subtrees of a batch.
#[cfg_attr(not(unoptimised), inline(always))]
fn batch<A: Arithmetic, S: ReferenceOps>(
    config: &BuildConfig,
    roots: &[SmallRoot],
    references: &[Reference],
    sizes: &mut [Extent],
    out: &mut Subtrees,
) -> Result<(), TryReserveError> {
    out.clear();
    let costs = SmallRootCosts::of(config);
    let mut scratch = SmallRootBuilder::new();
    for (root, size) in roots.iter().zip(sizes) {
        let mine = &references[root.first as usize..(root.first + root.count) as usize];
        let before = (out.nodes.len(), out.references.len());
        if root.count <= config.small_node_limit() {
            scratch.load(mine);
            let base = [before.0, before.1];
            scratch.build::<A, S>(&costs, &root.cell(), root.depth, base, out)?;
        } else {
            out.leaf(before.1, mine.iter().map(|reference| reference.triangle))?;
        }
        *size = Extent {
            nodes: (out.nodes.len() - before.0) as u32,
            references: (out.references.len() - before.1) as u32,
        };
    }
    Ok(())
}
