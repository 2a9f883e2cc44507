//! Every query by name: what the device is asked, what its words mean, and what the host answers after it.

use core::any::Any;
use core::ops::Range;

use splitplane_core::backend::Accelerator;
use splitplane_core::error::QueryError;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::query::cast::{Cast, CastOptions, Impact};
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
use splitplane_core::query::inside::{LocateOptions, Located};
use splitplane_core::query::overlap::{OverlapOptions, Overlaps, Volume};
use splitplane_core::query::traverse;
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray, Undecided};
use splitplane_core::report::{BuildSummary, QueryReport};
use splitplane_core::tree::KdTree;
use splitplane_core::tree::node::KdNode;
use splitplane_core::triangle::Triangle;
use splitplane_core::watch::Watch;
use splitplane_float_state::{Standard, standard};

use super::accelerator::{Slices, WgpuAccelerator};
use super::asked::Asked;
use super::error::DeviceQueryError;
use super::marked::Marked;
use super::pipelines::Queries;
use super::settle::{Asking, list};
use super::tree::DeviceTree;
use crate::device::wait::{Wait, blocking};

impl Queries {
    /// The hit of least `(t, triangle)` of every ray; [`Hit::MISS`] where there is none.
    ///
    /// Rays cross to the device in slices that respect its limits and its watchdog; while one slice
    /// is traced, the next is uploaded.
    ///
    /// # Errors
    /// `rays` and `hits` of different length, a driver that ends traversals early, rays that are
    /// left undecided, or a device that fails; then some of `hits` may hold answers and others
    /// their old contents; treat all of them as undefined.
    pub fn closest_hits(
        &self,
        tree: &DeviceTree,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<(), DeviceQueryError> {
        self.closest_hits_marking(tree, rays, hits, options)?.none()
    }

    /// As [`Queries::closest_hits`], without blocking while the device works. A future that is dropped cancels the batch.
    ///
    /// # Errors
    /// As for [`Queries::closest_hits`].
    pub async fn closest_hits_async(
        &self,
        tree: &DeviceTree,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<(), DeviceQueryError> {
        self.may_answer(options)?;
        let asked = self.closest_hits_under(Wait::Yielding, tree, rays, hits, options, None);
        self.explained(asked.await).await?.none()
    }

    /// For every ray, whether it hits anything. As [`Queries::closest_hits`].
    ///
    /// # Errors
    /// As for [`Queries::closest_hits`].
    pub fn any_hits(
        &self,
        tree: &DeviceTree,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<(), DeviceQueryError> {
        self.any_hits_marking(tree, rays, occluded, options)?.none()
    }

    /// As [`Queries::any_hits`], without blocking while the device works. A future that is dropped cancels the batch.
    ///
    /// # Errors
    /// As for [`Queries::closest_hits`].
    pub async fn any_hits_async(
        &self,
        tree: &DeviceTree,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<(), DeviceQueryError> {
        self.may_answer(options)?;
        let asked = self.any_hits_under(Wait::Yielding, tree, rays, occluded, options, None);
        self.explained(asked.await).await?.none()
    }

    /// An outcome whose error is the loss of the device where that is the cause.
    async fn explained<T>(
        &self,
        outcome: Result<T, DeviceQueryError>,
    ) -> Result<T, DeviceQueryError> {
        match outcome {
            Err(error @ DeviceQueryError::Gpu(_)) => Err(self.gpu().cause(error).await),
            outcome => outcome,
        }
    }

    /// As [`Queries::closest_hits`], but rays without an answer are no error: returns their indices
    /// in the batch. Their `hits` must not be used.
    ///
    /// Under accuracy `exact` the triangles of the others are the exact ones; `t` and weights are what
    /// the device computed, see [`splitplane_core::query::certify`].
    ///
    /// # Errors
    /// `rays` and `hits` of different length, a device that fails, or accuracy `exact` on one whose
    /// arithmetic is not known to be the CPU's.
    pub fn closest_hits_marking(
        &self,
        tree: &DeviceTree,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<Marked, DeviceQueryError> {
        self.may_answer(options)?;
        blocking(self.closest_hits_under(Wait::Blocking, tree, rays, hits, options, None))
    }

    /// As [`Queries::closest_hits_marking`], with a watch.
    pub(crate) async fn closest_hits_under(
        &self,
        wait: Wait,
        tree: &DeviceTree,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
        watch: Option<&dyn Watch>,
    ) -> Result<Marked, DeviceQueryError> {
        same_length(rays.len(), hits.len())?;
        let mut out = Marked::default();
        let asked = Asked::Hit(Query::Closest);
        let answer = |range: Range<usize>, bytes: &[u8]| {
            let first = range.start;
            let hits = &mut hits[range];
            bytemuck::cast_slice_mut::<Hit, u8>(hits).copy_from_slice(bytes);
            for (place, hit) in hits.iter().enumerate() {
                out.note_hit(first + place, hit)?;
            }
            Ok(())
        };
        self.trace_slices(wait, tree, rays, options, asked, watch, answer).await?;
        Ok(out)
    }

    /// As [`Queries::any_hits`], but rays without an answer are no error: returns their indices in
    /// the batch. Their answers must not be used.
    ///
    /// # Errors
    /// As for [`Queries::closest_hits_marking`].
    pub fn any_hits_marking(
        &self,
        tree: &DeviceTree,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<Marked, DeviceQueryError> {
        self.may_answer(options)?;
        blocking(self.any_hits_under(Wait::Blocking, tree, rays, occluded, options, None))
    }

    /// As [`Queries::any_hits_marking`], with a watch.
    pub(crate) async fn any_hits_under(
        &self,
        wait: Wait,
        tree: &DeviceTree,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
        watch: Option<&dyn Watch>,
    ) -> Result<Marked, DeviceQueryError> {
        same_length(rays.len(), occluded.len())?;
        let mut out = Marked::default();
        let asked = Asked::Hit(Query::Any);
        let answer = |range: Range<usize>, bytes: &[u8]| {
            for (place, word) in range.zip(bytes.chunks_exact(4)) {
                let word = [word[0], word[1], word[2], word[3]];
                occluded[place] = out.note_any(place, u32::from_ne_bytes(word))?;
            }
            Ok(())
        };
        self.trace_slices(wait, tree, rays, options, asked, watch, answer).await?;
        Ok(out)
    }
}

impl WgpuAccelerator {
    /// As the trait's function, without blocking while the device works. A future that is dropped cancels the batch. What is left
    /// to the host it does when the future is polled: all of it under accuracy `exact`, and the rays that a driver does not finish.
    ///
    /// # Errors
    /// As for the trait's function.
    pub async fn closest_hits_async(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let found = self.find_closest_hits(Wait::Yielding, rays, hits, options);
        self.explained(found.await).await
    }

    /// The same for [`Accelerator::any_hits`].
    ///
    /// # Errors
    /// As for the trait's function.
    pub async fn any_hits_async(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let found = self.find_any_hits(Wait::Yielding, rays, occluded, options);
        self.explained(found.await).await
    }

    /// The same for [`Accelerator::all_hits`]. The device lists triangles; which of them are crossed, and in which order, the host decides when the
    /// future is polled.
    ///
    /// # Errors
    /// As for the trait's function.
    pub async fn all_hits_async(
        &self,
        rays: &[Ray],
        options: &AllHitsOptions<'_>,
    ) -> Result<AllHits, QueryError> {
        let found = self.find_all_hits(Wait::Yielding, rays, options);
        self.explained(found.await).await
    }

    /// An outcome whose error is the loss of the device where that is the cause.
    async fn explained<T>(&self, outcome: Result<T, QueryError>) -> Result<T, QueryError> {
        match outcome {
            Err(error @ QueryError::Device(_)) => Err(self.queries.gpu().cause(error).await),
            outcome => outcome,
        }
    }

    async fn find_closest_hits(
        &self,
        wait: Wait,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let asking = Asking::new(options.watch, rays.len());
        let mut slices = Slices::new(rays.len(), hits.len(), options, &asking)?;
        while let Some(part) = slices.next() {
            let (some, found) = (&rays[part.rays.clone()], &mut hits[part.hits.clone()]);
            let answered = self.closest_of(wait, some, found, options, part.watch, &asking).await;
            slices.done(part, answered)?;
        }
        slices.end()
    }

    async fn closest_of(
        &self,
        wait: Wait,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
        watch: Option<&dyn Watch>,
        asking: &Asking<'_>,
    ) -> Result<QueryReport, QueryError> {
        let queries = &self.queries;
        let marked = queries.closest_hits_under(wait, &self.device, rays, hits, options, watch);
        let mut marked = marked.await?;
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
    }

    async fn find_any_hits(
        &self,
        wait: Wait,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let asking = Asking::new(options.watch, rays.len());
        let mut slices = Slices::new(rays.len(), occluded.len(), options, &asking)?;
        while let Some(part) = slices.next() {
            let (some, found) = (&rays[part.rays.clone()], &mut occluded[part.hits.clone()]);
            let answered = self.any_of(wait, some, found, options, part.watch, &asking).await;
            slices.done(part, answered)?;
        }
        slices.end()
    }

    async fn any_of(
        &self,
        wait: Wait,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
        watch: Option<&dyn Watch>,
        asking: &Asking<'_>,
    ) -> Result<QueryReport, QueryError> {
        let queries = &self.queries;
        let marked = queries.any_hits_under(wait, &self.device, rays, occluded, options, watch);
        let mut marked = marked.await?;
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
    }
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

    /// Bytes on the device and of the host's copies.
    fn held_bytes(&self) -> u64 {
        let KdTree { nodes, references, .. } = &self.tree;
        let tree =
            nodes.capacity() * size_of::<KdNode>() + references.capacity() * size_of::<u32>();
        let triangles = self.triangles.capacity() * size_of::<Triangle>();
        self.device.bytes() + (tree + triangles) as u64
    }

    /// Calls the watch between slices and while the device works on one.
    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        blocking(self.find_closest_hits(Wait::Blocking, rays, hits, options))
    }

    /// Calls the watch between slices and while the device works on one.
    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        blocking(self.find_any_hits(Wait::Blocking, rays, occluded, options))
    }

    /// The device lists the triangles that a ray may meet, and the host decides which of them are crossed, and where:
    /// the CPU's answers, bit for bit. Rays of which the device can tell nothing are the host's, and counted.
    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        blocking(self.find_all_hits(Wait::Blocking, rays, options))
    }

    /// The device counts the crossings of which it is certain. The other rays are asked for all hits.
    fn count_hits(
        &self,
        rays: &[Ray],
        counts: &mut [u32],
        options: &AllHitsOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let _state = Standard::set();
        self.find_counts(rays, counts, options)
    }

    /// The device counts windings where it is certain of all crossings. Of the other points it lists the triangles, and the
    /// host decides.
    fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        let _state = Standard::set();
        self.find_windings(points, options)
    }

    /// From the host copy, on all cores: the device has no such query. All points are counted as answered by the CPU.
    fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [ClosestPoint],
        options: &ClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let _state = Standard::set();
        self.find_closest_points(points, closest, options)
    }

    fn impacts(
        &self,
        casts: &[Cast],
        impacts: &mut [Impact],
        options: &CastOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let _state = Standard::set();
        self.find_impacts(casts, impacts, options)
    }

    fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &OverlapOptions<'_>,
    ) -> Result<Overlaps, QueryError> {
        let _state = Standard::set();
        self.find_overlaps(volumes, options)
    }

    fn overlaps_any(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &OverlapOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let _state = Standard::set();
        self.find_any_overlaps(volumes, found, options)
    }

    fn as_any_mut(&mut self) -> Option<&mut dyn Any> {
        Some(self)
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        standard(|| {
            let scale = self.device.scene_scale();
            traverse::closest_hit(&self.tree.view(), &self.triangles[..], scale, ray, options)
        })
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        standard(|| {
            let scale = self.device.scene_scale();
            traverse::any_hit(&self.tree.view(), &self.triangles[..], scale, ray, options)
        })
    }
}

/// Adds a place to a list.
fn same_length(rays: usize, results: usize) -> Result<(), DeviceQueryError> {
    if rays == results { Ok(()) } else { Err(DeviceQueryError::LengthMismatch { rays, results }) }
}
