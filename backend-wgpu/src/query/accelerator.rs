//! A tree on the device behind the core's `Accelerator`.

use std::ops::Range;
use std::sync::Arc;

use splitplane_core::error::QueryError;
use splitplane_core::ray::{Accuracy, QueryOptions, Undecided};
use splitplane_core::report::{BuildSummary, QueryReport};
use splitplane_core::tree::KdTree;
use splitplane_core::triangle::Triangle;
use splitplane_core::watch::Watch;

use super::marked::Marked;
use super::pipelines::Queries;
use super::settle::{Asking, HostScene};
use super::tree::DeviceTree;
use crate::error::GpuError;

/// A tree over a mesh on a device, with a copy of tree and snapped corners in host memory.
///
/// Batches are traced on the device. Single rays are answered from the host copy by the core's
/// reference traversal: a round trip to the device takes longer than the ray. Under watertight
/// accuracy both give the same bits where the device's parity is bitwise. Rays that the driver does
/// not let finish (see [`UNFINISHED`](super::UNFINISHED)) are answered from the host copy too, and
/// counted in the report.
///
/// For all hits the device lists the triangles that matter to each ray, and the host decides them exactly. It counts hits, and
/// windings around points, where it is certain of every crossing; what it is not certain of is answered as all hits are.
///
/// Under accuracy `exact` the device names the triangles of which it is certain and leaves the
/// other rays undecided; the options say how to treat those, and the report counts them. Distances
/// and weights come from the host copy, so that hits are the CPU backend's, bit for bit. Where the
/// device's parity is only structural its bounds of error hold for nothing, and all rays are
/// undecided.
#[derive(Debug)]
pub struct WgpuAccelerator {
    pub(super) queries: Arc<Queries>,
    pub(super) device: DeviceTree,
    pub(super) tree: KdTree,
    pub(super) triangles: Vec<Triangle>,
    pub(super) summary: BuildSummary,
}

impl WgpuAccelerator {
    /// Puts a tree that is on the device and its host copy together. `tree` and `triangles` (snapped
    /// corners, dropped triangles included) must be what `device` holds.
    pub fn new(
        queries: Arc<Queries>,
        device: DeviceTree,
        tree: KdTree,
        triangles: Vec<Triangle>,
        summary: BuildSummary,
    ) -> WgpuAccelerator {
        debug_assert_eq!(device.node_count() as usize, tree.nodes.len());
        debug_assert_eq!(device.triangle_count() as usize, triangles.len());
        WgpuAccelerator { queries, device, tree, triangles, summary }
    }

    /// Uploads a tree built elsewhere; see [`DeviceTree::upload`].
    ///
    /// # Errors
    /// As for [`DeviceTree::upload`].
    ///
    /// # Panics
    /// As for [`DeviceTree::upload`].
    pub fn upload(
        queries: Arc<Queries>,
        tree: KdTree,
        triangles: Vec<Triangle>,
        summary: BuildSummary,
    ) -> Result<WgpuAccelerator, GpuError> {
        let device = DeviceTree::upload(&queries, &tree.view(), &triangles)?;
        Ok(WgpuAccelerator::new(queries, device, tree, triangles, summary))
    }

    /// The tree on the device, for hosts that trace rays in their own shaders or keep rays there.
    pub fn device_tree(&self) -> &DeviceTree {
        &self.device
    }

    /// Lets batches of accuracy `watertight` go through compressed wide nodes, which are made now: see
    /// [`DeviceTree::compress`]. After a rebuild the tree has such as the device makes.
    ///
    /// # Errors
    /// As for [`DeviceTree::compress`]; nothing has changed then.
    pub fn compress(&mut self) -> Result<(), GpuError> {
        self.device.compress(&self.queries, &self.tree.view(), &self.triangles)
    }

    /// The same with nodes that the device makes, which takes no thread of the host: see [`DeviceTree::compress_on_device`].
    ///
    /// # Errors
    /// As for [`DeviceTree::compress_on_device`]; nothing has changed then.
    pub fn compress_on_device(&mut self) -> Result<(), GpuError> {
        self.device.compress_on_device(&self.queries)
    }

    /// The device and its query pipelines; with typed errors, and queries over device buffers.
    pub fn queries(&self) -> &Arc<Queries> {
        &self.queries
    }

    /// The snapped corners, in the order of the mesh.
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    /// The tree on the device alone, for [`WgpuBackend::recycle`](crate::WgpuBackend::recycle).
    pub fn into_device_tree(self) -> DeviceTree {
        self.device
    }

    pub(super) fn host_scene(&self) -> HostScene<'_> {
        HostScene { tree: self.tree.view(), triangles: &self.triangles }
    }

    /// The report on a batch whose marked rays the host has answered.
    pub(super) fn report(&self, marked: Marked, options: &QueryOptions<'_>) -> QueryReport {
        let mut report = QueryReport::default();
        report.unfinished = marked.unfinished.len() as u64;
        report.undecided = marked.undecided.len() as u64;
        report.answered_by_cpu = report.unfinished;
        match options.undecided {
            Undecided::Flag => report.flagged = marked.undecided,
            _ => report.answered_by_cpu += report.undecided,
        }
        report
    }
}

/// Rays of a slice whose answers the host makes exact before the next, if there is a watch.
const SLICE: usize = 1 << 16;

/// The slices of a batch. If the host processes all rays after the device and there is a watch, there are several, so that
/// rays reported as done are done.
pub(super) struct Slices<'a> {
    asking: &'a Asking<'a>,
    /// Whether the host works after the device, and is watched.
    several: bool,
    /// Lengths that must be equal; the device's queries say so where they are not.
    rays: usize,
    hits: usize,
    watch: Option<&'a dyn Watch>,
    next: usize,
    began: bool,
    report: QueryReport,
}

/// One of them.
pub(super) struct Slice<'a> {
    pub(super) rays: Range<usize>,
    pub(super) hits: Range<usize>,
    /// For the device.
    pub(super) watch: Option<&'a dyn Watch>,
}

impl<'a> Slices<'a> {
    pub(super) fn new(
        rays: usize,
        hits: usize,
        options: &QueryOptions<'a>,
        asking: &'a Asking<'a>,
    ) -> Result<Slices<'a>, QueryError> {
        let watch = options.watch;
        let several = watch.is_some() && options.accuracy == Accuracy::Exact && rays == hits;
        if several {
            asking.check()?;
        } else {
            // The device calls the watch itself, or returns its error; after it all but a few rays are
            // done.
            asking.advance(rays);
        }
        let report = QueryReport::default();
        Ok(Slices { asking, several, rays, hits, watch, next: 0, began: false, report })
    }

    pub(super) fn next(&mut self) -> Option<Slice<'a>> {
        if !self.several {
            let is_first = !std::mem::replace(&mut self.began, true);
            let all = Slice { rays: 0..self.rays, hits: 0..self.hits, watch: self.watch };
            return is_first.then_some(all);
        }
        let rays = self.next..self.rays.min(self.next + SLICE);
        let asking: &'a Asking<'a> = self.asking;
        (!rays.is_empty()).then(|| Slice { hits: rays.clone(), rays, watch: Some(asking) })
    }

    pub(super) fn done(
        &mut self,
        slice: Slice<'a>,
        answered: Result<QueryReport, QueryError>,
    ) -> Result<(), QueryError> {
        if !self.several {
            self.report = answered?;
            return Ok(());
        }
        let part = answered.map_err(|error| match error {
            QueryError::Cancelled { .. } => self.asking.cancelled(),
            error => error,
        })?;
        // Before these rays count as done.
        self.asking.check()?;
        self.report.append(part, slice.rays.start)?;
        self.asking.advance(slice.rays.len());
        self.next = slice.rays.end;
        Ok(())
    }

    pub(super) fn end(self) -> Result<QueryReport, QueryError> {
        if self.several {
            self.asking.check()?;
        }
        Ok(self.report)
    }
}
