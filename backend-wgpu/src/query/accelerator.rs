//! A tree on the device behind the core's `Accelerator`.

use core::any::Any;
use std::sync::Arc;

use splitplane_core::backend::Accelerator;
use splitplane_core::error::QueryError;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::query::inside::{LocateOptions, Located};
use splitplane_core::query::{inside, traverse};
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray, Undecided};
use splitplane_core::report::{BuildSummary, QueryReport};
use splitplane_core::tree::KdTree;
use splitplane_core::triangle::Triangle;
use splitplane_core::watch::Watch;

use super::batch::Marked;
use super::pipelines::Queries;
use super::settle::{Asking, HostScene, list};
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
/// Under accuracy `exact` the device names the triangles of which it is certain and leaves the
/// other rays undecided; the options say how to treat those, and the report counts them. Distances
/// and weights come from the host copy, so that hits are the CPU backend's, bit for bit. Where the
/// device's parity is only structural its bounds of error hold for nothing, and all rays are
/// undecided.
#[derive(Debug)]
pub struct WgpuAccelerator {
    queries: Arc<Queries>,
    device: DeviceTree,
    tree: KdTree,
    triangles: Vec<Triangle>,
    summary: BuildSummary,
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

    fn host_scene(&self) -> HostScene<'_> {
        HostScene { tree: self.tree.view(), triangles: &self.triangles }
    }

    /// The report on a batch whose marked rays the host has answered.
    fn report(&self, marked: Marked, options: &QueryOptions<'_>) -> QueryReport {
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

    fn find_closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let watch = options.watch;
        let queries = &self.queries;
        in_slices(rays, hits, options, watch, |rays, hits, watch, asking| {
            let mut marked =
                queries.closest_hits_under(&self.device, rays, hits, options, watch)?;
            if options.accuracy == Accuracy::Exact {
                if !queries.is_certain() {
                    hits.fill(Hit { triangle: Hit::UNDECIDED, ..Hit::MISS });
                    marked = Marked::default();
                }
                marked.undecided = self.host_scene().settle(rays, hits, options, asking)?;
            }
            for &ray in &marked.unfinished {
                asking.check()?;
                hits[ray] = self.closest_hit(&rays[ray], options).unwrap_or(Hit::MISS);
            }
            Ok(self.report(marked, options))
        })
    }

    fn find_any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let watch = options.watch;
        let queries = &self.queries;
        in_slices(rays, occluded, options, watch, |rays, occluded, watch, asking| {
            let mut marked =
                queries.any_hits_under(&self.device, rays, occluded, options, watch)?;
            if options.accuracy == Accuracy::Exact {
                if !queries.is_certain() {
                    marked = Marked { undecided: list(rays.len())?, ..Marked::default() };
                    marked.undecided.extend(0..rays.len());
                }
                if options.undecided == Undecided::Redo {
                    let undecided = &marked.undecided;
                    self.host_scene().settle_any(rays, undecided, occluded, options, asking)?;
                }
            }
            for &ray in &marked.unfinished {
                asking.check()?;
                occluded[ray] = self.any_hit(&rays[ray], options);
            }
            Ok(self.report(marked, options))
        })
    }
}

/// Rays of a slice whose answers the host makes exact before the next, if there is a watch.
const SLICE: usize = 1 << 16;

/// Answers a batch. If the host processes all rays after the device and there is a watch, it works
/// in slices, so that rays reported as done are done.
fn in_slices<T>(
    rays: &[Ray],
    answers: &mut [T],
    options: &QueryOptions<'_>,
    watch: Option<&dyn Watch>,
    answer: impl Fn(
        &[Ray],
        &mut [T],
        Option<&dyn Watch>,
        &Asking<'_>,
    ) -> Result<QueryReport, QueryError>,
) -> Result<QueryReport, QueryError> {
    let asking = Asking::new(watch, rays.len());
    if watch.is_none() || options.accuracy != Accuracy::Exact || rays.len() != answers.len() {
        // The device calls the watch itself, or returns its error; after it all but a few rays are
        // done.
        asking.advance(rays.len());
        return answer(rays, answers, watch, &asking);
    }
    asking.check()?;
    let mut report = QueryReport::default();
    let slices = rays.chunks(SLICE).zip(answers.chunks_mut(SLICE));
    for (slice, (rays, answers)) in slices.enumerate() {
        let part = answer(rays, answers, Some(&asking), &asking);
        let part = part.map_err(|error| match error {
            QueryError::Cancelled { .. } => asking.cancelled(),
            error => error,
        })?;
        // Before these rays count as done.
        asking.check()?;
        report.append(part, slice * SLICE)?;
        asking.advance(rays.len());
    }
    asking.check()?;
    Ok(report)
}

impl Accelerator for WgpuAccelerator {
    fn tree(&self) -> &KdTree {
        &self.tree
    }

    fn summary(&self) -> &BuildSummary {
        &self.summary
    }

    /// Bytes on the device; the host copy is not counted.
    fn query_bytes(&self) -> u64 {
        self.device.bytes()
    }

    /// Calls the watch between slices and while the device works on one.
    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.find_closest_hits(rays, hits, options)
    }

    /// Calls the watch between slices and while the device works on one.
    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.find_any_hits(rays, occluded, options)
    }

    /// From the host copy, one ray at a time; the report says so.
    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        let (tree, triangles) = (self.tree.view(), &self.triangles[..]);
        let mut all = AllHits::one_by_one(&tree, triangles, rays, options)?;
        all.report.answered_by_cpu = rays.len() as u64;
        Ok(all)
    }

    /// From the host copy, one point at a time; the report says so.
    fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        let (tree, triangles) = (self.tree.view(), &self.triangles[..]);
        let mut located = inside::one_by_one(&tree, triangles, points, options)?;
        located.report.answered_by_cpu = points.len() as u64;
        Ok(located)
    }

    fn as_any_mut(&mut self) -> Option<&mut dyn Any> {
        Some(self)
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        let scale = self.device.scene_scale();
        traverse::closest_hit(&self.tree.view(), &self.triangles[..], scale, ray, options)
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        let scale = self.device.scene_scale();
        traverse::any_hit(&self.tree.view(), &self.triangles[..], scale, ray, options)
    }
}
