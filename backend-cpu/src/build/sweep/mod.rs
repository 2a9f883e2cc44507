//! Preset `best`: the offline builder, greedy SAH over all planes with perfect splits (Wald and Havran
//! 2006, *On building fast kd-trees for ray tracing, and on doing that in O(N log N)*).
//!
//! # What is built
//! The candidates of a node are the faces of its references' bounds that lie strictly inside its
//! cell. The node is split by the candidate of least (cost, axis, position); the cost is Equation 6
//! of [`splitplane_core::sah`] with blocks of W triangles and K_T and K_I apart, times
//! `1 - empty_bonus / 256` where a side is empty. Candidates are compared with children that cost
//! what [`splitplane_core::sah::expected_quarters`] says; whether a split pays is decided with
//! children as leaves, and where the first does not pay, the one that is least with leaves is
//! tried. References planar in the plane go left together or right together, whichever costs less,
//! left on a tie. A straddling reference goes to both sides, its bounds those of what the triangle
//! has in either child's cell ([`clip`]).
//!
//! A node becomes a leaf when no split costs less than it would as a leaf, except that up to
//! `bad_splits` splits in a row that cost more are tried; when it is at the greatest depth; when it
//! is too small for its extents to differ; or when its references after the split would
//! exceed its share of the reference cap. A node of at most W references is split only to cut off
//! empty space where that pays: a plane with triangles on both sides adds to its one block. A
//! finished subtree that costs no less than its node would as a leaf is retracted to that leaf.
//!
//! # How it is found
//! Wald and Havran keep three sorted lists of events and carry them down the tree. Here a node sorts only
//! the few events that matter. Its references are counted into bins; from the counts follow a lower and
//! an upper bound of the cost of every candidate in a bin. Bins whose lower bound exceeds the
//! least upper bound cannot hold the least candidate. The events of the others are sorted and swept. The
//! plane is the one that a sweep over all events finds; the tests hold it against one that looks at every
//! plane. Where bounds rule nothing out (all events in few bins) all events are
//! sorted, at most twice a node. Nodes of up to 128 references sort their faces instead (`small.rs`).
//!
//! # Tasks
//! Nodes of many references are counted, swept and divided by many tasks, in parts of their lists;
//! only bounding the bins of a node is left to one task. Smaller ones are built by one task each,
//! depth first (`subtree.rs`). Scratch and finished subtrees are in memory that is kept between
//! builds; the nodes above the subtrees are in a few small lists, which each build allocates anew.
//!
//! # Order
//! All decisions are functions of the node's references, cell, depth and shares, never of threads or
//! time: costs are `f64` operations that round once, in a fixed order.

mod atomic_memory;
mod bins;
pub(crate) mod clip;
mod context;
mod cost;
mod emit;
mod events;
mod grid;
mod matches;
mod node;
#[cfg(test)]
mod oracle;
mod partition;
mod small;
mod subtree;
mod thread_scratch;
mod top;

use core::sync::atomic::AtomicUsize;

use splitplane_core::config::{BuildConfig, Sweep};
use splitplane_core::error::BuildError;
use splitplane_core::kernel::Counter;
use splitplane_core::watch::Stage;

use crate::build::twin::buffers::Buffers;
use crate::build::{Lists, MUCH};
use crate::cancel::ProgressMeter;
use crate::memory::Memory;
use crate::simd::InstructionSet;
use atomic_memory::AtomicMemory;
use context::BuildContext;
use cost::SplitCosts;
use node::OpenNode;

pub(super) use context::SweepScratch;

/// Builds the tree over the references in `buffers`, which [`splitplane_core::build::schedule::start`] has made,
/// into its nodes and leaf references. Returns how many there are of each.
///
/// # Errors
/// More memory than the limit allows, more nodes or references than the format can address, or a build
/// that was cancelled.
pub(crate) fn build(
    (config, sweep): (&BuildConfig, &Sweep),
    set: InstructionSet,
    (buffers, scratch, lists): (&mut Buffers, &mut SweepScratch, Lists),
    memory: &mut Memory,
    meter: &ProgressMeter<'_>,
) -> Result<(usize, usize), BuildError> {
    let references = buffers.counters[Counter::ActiveReferences] as usize;
    // The root's list becomes one of the lists that nodes hand on to one another.
    let list = core::mem::take(&mut buffers.references);
    let shared = AtomicMemory::new(*memory);
    let workers = AtomicUsize::new(scratch.begin());
    // Tens of kilobytes that are never moved: unless this is optimised they would be on the stack
    // twice.
    let costs = SplitCosts::both(config, sweep);
    let built = {
        let builder = BuildContext {
            costs: &costs,
            clip: config.clip,
            set,
            triangles: &buffers.triangles,
            memory: &shared,
            scratch,
            workers,
            meter,
        };
        let count = references as u32;
        let root = OpenNode::root(buffers.root_bounds, u64::from(config.reference_cap(count)));
        // The shares of the leaves add up to the root's.
        meter.begin_stage(Stage::Offline, root.budget);
        builder.build(list, references, &root)?.0
    };
    meter.finish_stage();
    *memory = shared.total();
    let held = scratch.bytes();
    // In a browser there is nobody to give them back to.
    let system = cfg!(not(target_arch = "wasm32"));
    if system && lists == Lists::GiveBack && held > MUCH {
        scratch.give_back_lists();
        memory.held -= held - scratch.bytes();
    } else {
        buffers.references = scratch.longest_list();
    }
    meter.check()?;
    let (nodes, references) = built.check_size()?;
    meter.begin_stage(Stage::Output, nodes as u64);
    memory.grow_watched(&mut buffers.nodes, nodes, meter)?;
    memory.grow_watched(&mut buffers.leaf_references, references, meter)?;
    let workers = scratch.workers().map_err(|_| memory.lacking())?;
    let out = (&mut buffers.nodes[..nodes], &mut buffers.leaf_references[..references]);
    built.emit(meter, &workers, out.0, out.1).map_err(|_| memory.lacking())?;
    meter.finish_stage();
    meter.check()?;
    // What has been emitted is dropped here.
    memory.held -= built.bytes();
    Ok((nodes, references))
}
