//! A scene of many objects on a device behind the core's `SceneAccelerator`.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use splitplane_core::backend::scene::{
    BuildGeometry, BuiltScene, SceneAccelerator, SceneAllHits, SceneAllHitsOptions, SceneAnswer,
    SceneClosestPoint, SceneClosestPointOptions, SceneOverlapOptions, SceneOverlaps, UpdateReport,
    bytes_of,
};
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::error::{BuildError, DeviceError, QueryError};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::inside::{LocateOptions, Located};
use splitplane_core::query::overlap::Volume;
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Ray};
use splitplane_core::report::QueryReport;
use splitplane_core::scene::{Scene, SceneBuildError, SceneHit, SceneOptions, SceneReport};
use splitplane_float_state::{Standard, standard};

use super::bindings::SceneBindings;
use super::failed::failed;
use super::gone::Gone;
use super::held::HeldScene;
use super::near;
use super::reserved::{Reserved, Room};
use super::waves::{WaveMemory, Waves};
use crate::device::wait::{Wait, blocking};
use crate::error::GpuError;
use crate::query::error::DeviceQueryError;
use crate::query::layout::UNFINISHED;
use crate::query::pipelines::Queries;

/// A scene on a device.
///
/// Batches of accuracy `watertight` without a filter are answered there: rays find the instances that they enter in the tree over
/// them, and are traced in the geometries' trees, all of which lie in shared buffers besides the geometries' own. Rays that the driver does
/// not let finish are answered by the CPU, and counted. Other batches, and all of a scene that the device cannot hold, go to the
/// geometries' accelerators in waves, for which the CPU finds the instances: see
/// [`SceneAccelerator::placed_by_cpu`] and [`SceneReport::placed_by_cpu`].
pub struct WgpuScene {
    built: BuiltScene,
    queries: Arc<Queries>,
    /// What the device holds, or why it holds nothing.
    held: Result<HeldScene, String>,
    gone: Gone,
    memory: WaveMemory,
}

/// Why a device holds nothing of a scene whose update was dropped.
const UNTOLD: &str = "its last update was dropped before the device told whether it took the scene; the next one sends all again";

impl WgpuScene {
    /// Builds a scene.
    ///
    /// # Errors
    /// As for [`BuiltScene::build`]; a device without memory for the scene. One that fails when the scene is sent leaves it to the
    /// CPU, and [`SceneAccelerator::placed_by_cpu`] says why.
    pub(crate) fn build(
        queries: Arc<Queries>,
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
    ) -> Result<WgpuScene, SceneBuildError> {
        let mut own = WgpuScene::empty(queries);
        own.update_by(scene, options, build)?;
        Ok(own)
    }

    /// A scene of nothing.
    pub(crate) fn empty(queries: Arc<Queries>) -> WgpuScene {
        WgpuScene {
            built: BuiltScene::default(),
            queries,
            held: Err("nothing was built yet".into()),
            gone: Gone::default(),
            memory: WaveMemory::default(),
        }
    }

    /// Brings the scene up to date with geometries that are built: those that [`BuiltScene::unbuilt`] names. What the device refuses when the scene is
    /// sent to it is an error, and the scene then needs another update.
    pub(crate) async fn update_with(
        &mut self,
        scene: &Scene,
        options: &BuildOptions<'_>,
        mut ready: VecDeque<Box<dyn Accelerator>>,
    ) -> Result<UpdateReport, SceneBuildError> {
        let mut next = |_: &Mesh<'_>, options: &BuildOptions<'_>| {
            let lacking = || DeviceError::Failed("a geometry was not built before".into());
            let tree = ready.pop_front().ok_or_else(|| BuildError::Device(lacking()))?;
            // Trees over shapes, which are built only now, leave less room than there was.
            let needed = bytes_of(&*tree);
            match options.max_memory {
                Some(limit) if needed > limit => Err(BuildError::OutOfMemory { needed, limit }),
                _ => Ok(tree),
            }
        };
        self.settled(|own| own.update_by(scene, options, &mut next)).await
    }

    /// Updates the scene by `work`, and waits until it is known what the device refused meanwhile, which a browser tells later. That is an error, and
    /// takes the scene from the device: the next update sends everything again. So does the next update where this future is dropped before the device has
    /// told.
    pub(crate) async fn settled<T, E: From<SceneBuildError>>(
        &mut self,
        work: impl FnOnce(&mut WgpuScene) -> Result<T, E>,
    ) -> Result<T, E> {
        let gpu = Arc::clone(self.queries.gpu());
        let from = gpu.mark();
        let done = work(self)?;
        // The scene has nothing of the device's until that has told what it took: who drops this future leaves the scene so.
        let held = std::mem::replace(&mut self.held, Err(UNTOLD.into()));
        let gone = self.gone;
        if let Ok(own) = &held {
            self.gone.add(&own.buffers, None);
        }
        if let Err(error) = gpu.settle(Wait::Yielding, from).await {
            let error = gpu.cause(error).await;
            self.held = Err(error.to_string());
            return Err(failed(error).into());
        }
        (self.held, self.gone) = (held, gone);
        Ok(done)
    }

    /// As [`SceneAccelerator::closest_hits`], without blocking while the device works: batches of accuracy `watertight` without a filter, with a scene that
    /// the device holds.
    ///
    /// # Errors
    /// As there; a batch that takes the CPU ([`WgpuScene::needs_cpu`] says why).
    pub async fn closest_hits_async(
        &self,
        rays: &[Ray],
        hits: &mut [SceneHit],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        self.answer_async(rays, hits, options, |hit| *hit).await
    }

    /// The same for [`SceneAccelerator::any_hits`].
    ///
    /// # Errors
    /// As for [`WgpuScene::closest_hits_async`].
    pub async fn any_hits_async(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        self.answer_async(rays, occluded, options, SceneHit::is_hit).await
    }

    /// Why a batch of these options goes to the geometries' accelerators in waves, for which the CPU finds the instances; `None` where the device
    /// answers it by itself.
    pub fn needs_cpu(&self, options: &SceneOptions<'_>) -> Option<&str> {
        match &self.held {
            Err(reason) => Some(reason),
            Ok(_) if options.filter.is_some() => Some("filters are called on the CPU"),
            Ok(_) if options.accuracy != Accuracy::Watertight => {
                Some("of scenes a device answers batches of accuracy watertight alone")
            }
            Ok(_) => None,
        }
    }

    async fn answer_async<T: SceneAnswer>(
        &self,
        rays: &[Ray],
        answers: &mut [T],
        options: &SceneOptions<'_>,
        of: impl Fn(&SceneHit) -> T,
    ) -> Result<SceneReport, QueryError> {
        if let Some(reason) = self.needs_cpu(options) {
            let text = format!("the batch cannot be answered without blocking: {reason}");
            return Err(QueryError::Device(DeviceError::Failed(text)));
        }
        match self.answer(Wait::Yielding, rays, answers, options, of).await {
            Err(error @ QueryError::Device(_)) => Err(self.queries.gpu().cause(error).await),
            done => done,
        }
    }

    /// What a host's own shader binds to trace rays through the scene as it is now: see [`splitplane_shaders::scene_traversal`].
    ///
    /// # Errors
    /// [`GpuError::NotHeld`], with what [`SceneAccelerator::placed_by_cpu`] says, for a scene that the device does not hold; no memory; a device that fails.
    pub fn bindings(&self) -> Result<SceneBindings, GpuError> {
        match &self.held {
            Ok(held) => SceneBindings::new(self.queries.gpu(), held),
            Err(reason) => Err(GpuError::NotHeld(reason.clone())),
        }
    }

    /// Bytes that the device holds of the scene besides the geometries' own trees.
    pub fn bytes_on_device(&self) -> u64 {
        self.held.as_ref().map_or(0, HeldScene::bytes)
    }

    async fn answer<T: SceneAnswer>(
        &self,
        wait: Wait,
        rays: &[Ray],
        answers: &mut [T],
        options: &SceneOptions<'_>,
        of: impl Fn(&SceneHit) -> T,
    ) -> Result<SceneReport, QueryError> {
        let suits = self.needs_cpu(options).is_none();
        let (true, Ok(scene)) = (suits, &self.held) else {
            return self.built.answer_in_waves(rays, answers, options);
        };
        if rays.len() != answers.len() {
            return Err(QueryError::LengthMismatch { rays: rays.len(), results: answers.len() });
        }
        let (queries, memory) = (&*self.queries, &self.memory);
        let any = T::QUERY == Query::Any;
        let waves = Waves { queries, scene, memory, options, any };
        let mut report = SceneReport::default();
        let mut unfinished: Vec<usize> = Vec::new();
        let keep = |range: Range<usize>, bytes: &[u8]| {
            for (place, bytes) in range.zip(bytes.chunks_exact(size_of::<SceneHit>())) {
                let hit: SceneHit = bytemuck::pod_read_unaligned(bytes);
                answers[place] = of(&hit);
                if hit.triangle == UNFINISHED {
                    let needed = ((unfinished.len() + 1) * size_of::<usize>()) as u64;
                    let lacking = |_| DeviceQueryError::HostMemory { needed };
                    unfinished.try_reserve(1).map_err(lacking)?;
                    unfinished.push(place);
                }
            }
            Ok(())
        };
        report.entered = waves.answer(wait, rays, options.watch, keep).await?;
        for &ray in &unfinished {
            answers[ray] = self.built.answer_one(&rays[ray], options);
        }
        report.geometries.unfinished = unfinished.len() as u64;
        report.geometries.answered_by_cpu = unfinished.len() as u64;
        Ok(report)
    }
}

impl SceneAccelerator for WgpuScene {
    fn scene(&self) -> &BuiltScene {
        &self.built
    }

    fn placed_by_cpu(&self) -> Option<&str> {
        self.held.as_ref().err().map(String::as_str)
    }

    /// As there. Where the device has no memory for the scene's buffers, that is an error, and the old scene answers. Where the limit has no place for them
    /// beside those of the old scene, these go first, once the scene is updated, and all is sent. A scene that exceeds the limits
    /// of the device's bindings, or `max_memory` with its buffers alone, is updated and answered in waves, and so is one that fails later, while it is packed and
    /// sent: [`SceneAccelerator::placed_by_cpu`] says why, and the next update tries again.
    fn update_by(
        &mut self,
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        let _state = Standard::set();
        let WgpuScene { built, queries, held, gone, .. } = self;
        let (gpu, limit) = (queries.gpu(), options.max_memory);
        let mut reserved = Reserved::Refused(String::new());
        let mut report = built.update_after(scene, options, build, &mut |becoming| {
            reserved = Room::reserve(gpu, held.as_ref().ok(), becoming, gone, options)?;
            Ok(())
        })?;
        // The scene is updated: what fails from here on leaves it to the CPU.
        let (sizes, bytes) = (built.packed_sizes(), built.bytes());
        if let Some(reason) = built.host_only() {
            reserved = Reserved::Refused(reason.into());
        }
        if let Reserved::Room(room) = reserved {
            reserved = room.grown(gpu, held.as_ref().ok(), &sizes, bytes, gone, limit);
        }
        let room = match reserved {
            Reserved::Room(room) => Ok(room),
            Reserved::Refused(reason) => Err(reason),
            Reserved::Afterwards => {
                if let Ok(old) = std::mem::replace(held, Err(String::new())) {
                    gone.add(&old.buffers, None);
                }
                let waited = gone.wait(gpu).map_err(|error| error.to_string());
                waited.and_then(|()| Room::alone(gpu, &sizes, bytes + gone.bytes(), limit))
            }
        };
        let sent = room.and_then(|room| {
            let put = HeldScene::put(gpu, held.as_ref().ok(), room, built);
            put.map_err(|error| error.to_string())
        });
        let new = sent.map(|(new, sent)| {
            report.bytes_sent = sent;
            new
        });
        if let Ok(old) = held {
            gone.add(&old.buffers, new.as_ref().ok().map(|new| &new.buffers));
        }
        *held = new;
        Ok(report)
    }

    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [SceneHit],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        blocking(self.answer(Wait::Blocking, rays, hits, options, |hit| *hit))
    }

    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        blocking(self.answer(Wait::Blocking, rays, occluded, options, SceneHit::is_hit))
    }

    fn closest_hit(&self, ray: &Ray, options: &SceneOptions<'_>) -> Option<SceneHit> {
        standard(|| self.built.answer_one::<SceneHit>(ray, options).some())
    }

    fn any_hit(&self, ray: &Ray, options: &SceneOptions<'_>) -> bool {
        standard(|| self.built.answer_one(ray, options))
    }

    fn all_hits(
        &self,
        rays: &[Ray],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<SceneAllHits, QueryError> {
        standard(|| self.built.all_hits(rays, options))
    }

    fn count_hits(
        &self,
        rays: &[Ray],
        counts: &mut [u64],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        standard(|| self.built.count_hits(rays, counts, options))
    }

    fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        standard(|| self.built.locate(points, options))
    }

    fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [SceneClosestPoint],
        options: &SceneClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let _state = Standard::set();
        near::closest_points(&self.built, points, closest, options)
    }

    fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<SceneOverlaps, QueryError> {
        let _state = Standard::set();
        near::overlaps(&self.built, volumes, options)
    }

    fn overlaps_any(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<(), QueryError> {
        let _state = Standard::set();
        near::overlaps_any(&self.built, volumes, found, options)
    }
}
