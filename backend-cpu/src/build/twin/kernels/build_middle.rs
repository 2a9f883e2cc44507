//! `build_middle`: one workgroup a node that the levels have handed over.
//!
//! Reads: these nodes, their references, corners of those that a plane cuts. Writes: the tree of each node, its leaves
//! and their references, in regions of its own; what it counts. Ties: as in `split_median`.

use std::sync::Mutex;

use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::build::middle::{LEVEL_REFERENCES, Region};
use splitplane_core::build::reference::Parts;
use splitplane_core::build::reference::kernels as reference;
use splitplane_core::config::BuildConfig;
use splitplane_core::layout::{MiddleRoot, Reference, SmallRoot, TopNode};
use splitplane_core::triangle::Triangle;

use crate::cancel::ProgressMeter;
use crate::parallel::{Parallel, ParallelSlice};

/// The regions of all roots.
#[derive(Debug)]
pub(crate) struct Regions<'a> {
    pub references: &'a mut [Reference],
    pub nodes: &'a mut [TopNode],
    pub leaves: &'a mut [SmallRoot],
}

/// References of scratch: of two levels for each thread.
pub(crate) fn scratch() -> usize {
    2 * LEVEL_REFERENCES as usize * rayon::current_num_threads()
}

/// Runs the kernel. `scratch` has as many references as [`scratch()`] says.
#[allow(clippy::too_many_arguments, reason = "the buffers it reads and writes")]
pub(crate) fn run<A: Arithmetic>(
    meter: &ProgressMeter<'_>,
    config: &BuildConfig,
    small_roots: &[SmallRoot],
    small_references: &[Reference],
    triangles: &[Triangle],
    scratch: &mut [Reference],
    regions: &mut Regions<'_>,
    middle_roots: &mut [MiddleRoot],
) {
    let mut references = Parts::new(regions.references);
    let mut nodes = Parts::new(regions.nodes);
    let mut leaves = Parts::new(regions.leaves);
    let roots = small_roots.iter().zip(middle_roots).enumerate().map(|(index, (root, out))| {
        let (start, length) = (Region::start(root.first, index as u32), Region::of(root.count));
        let part = |first: u32, count: u32| first as usize..(first + count) as usize;
        let references = references.take(part(start.references, length.references));
        let nodes = nodes.take(part(start.nodes, length.nodes));
        let leaves = leaves.take(part(start.leaves, length.leaves));
        (index, references, nodes, leaves, out)
    });
    let roots = Mutex::new(roots);
    scratch.par_chunks_mut(2 * LEVEL_REFERENCES as usize).for_each(|lists| {
        let (one, other) = lists.split_at_mut(LEVEL_REFERENCES as usize);
        while !meter.is_cancelled() {
            let next = roots.lock().map_or(None, |mut roots| roots.next());
            let Some((index, references, nodes, leaves, out)) = next else { return };
            let mut region = reference::MiddleRegion {
                levels: [&mut *one, &mut *other],
                references,
                nodes,
                leaves,
            };
            *out = reference::build_middle::<A>(
                config,
                index,
                small_roots,
                small_references,
                triangles,
                &mut region,
            );
            meter.record_work(16 * u64::from(small_roots[index].count.min(LEVEL_REFERENCES)));
        }
    });
}
