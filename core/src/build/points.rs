//! The build of a tree of points as a schedule of kernels, for executors: the bytes are those of [`build`](crate::points::build::build).
//!
//! *Large nodes*, those of more than a chunk, are divided level by level. The coordinate of a node's plane is found eight bits at a time: the
//! points of each chunk are counted by their next digit, and the node's digit is where the number of points before the plane is reached. A
//! chunk belongs to one node, since both begin at places known before. Then points are moved to the children, below the plane, on it and above, in the
//! order that they have: so they always stand by index, and of those on the plane the first go to the left.
//!
//! *Small nodes*: one workgroup finishes the subtree of a chunk.
//!
//! Order comes from sums and scans of whole numbers alone.

mod reference;

pub use reference::Reference;

use crate::build::schedule::Executor;
use crate::kernel::{PointBuffer, PointBuilder, PointCounter, PointKernel};
use crate::layout::{POINT_CHUNK, SMALL_HEIGHT};
use crate::points::tree::{Axes, BLOCK, height};

const _: () = assert!(POINT_CHUNK as usize == BLOCK << SMALL_HEIGHT);

/// Levels of large nodes in a tree of so many points.
pub fn large_levels(points: usize) -> u32 {
    height(points).saturating_sub(SMALL_HEIGHT)
}

/// Builds a tree. The executor must hold the points, and its counters must be as
/// [`PointCounters::at_start`](crate::layout::PointCounters::at_start) makes them. An executor that cannot read its counters must run
/// [`large_levels`] rounds of the points that are kept.
///
/// # Errors
/// The executor's.
pub fn build<E: Executor<PointBuilder>>(executor: &mut E, axes: Axes) -> Result<(), E::Error> {
    executor.dispatch(PointKernel::MeasurePoints)?;
    executor.dispatch(PointKernel::ScanPoints)?;
    executor.dispatch(PointKernel::GatherPoints)?;
    let mut level = 0;
    while executor.pending(PointCounter::Large, level)? {
        divide_large_nodes(executor, axes)?;
        level += 1;
    }
    executor.dispatch(PointKernel::BuildSmallPoints)
}

/// One level.
fn divide_large_nodes<E: Executor<PointBuilder>>(
    executor: &mut E,
    axes: Axes,
) -> Result<(), E::Error> {
    if axes == Axes::Widest {
        executor.dispatch(PointKernel::PointExtents)?;
    }
    executor.dispatch(PointKernel::ChooseAxes)?;
    for _ in 0..4 {
        executor.dispatch(PointKernel::CountDigits)?;
        executor.dispatch(PointKernel::PickDigits)?;
    }
    executor.dispatch(PointKernel::CountSides)?;
    executor.dispatch(PointKernel::PlaceSides)?;
    executor.dispatch(PointKernel::ScatterPoints)?;
    executor.dispatch(PointKernel::NextHeight)?;
    executor.swap(PointBuffer::Records, PointBuffer::NextRecords)
}
