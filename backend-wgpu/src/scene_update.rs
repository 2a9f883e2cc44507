//! An update of a scene whose trees the device builds while the scene goes on answering.

use std::sync::Arc;

use splitplane_core::backend::BuildOptions;
use splitplane_core::backend::scene::{
    BuiltScene, FinishError, PendingUpdate, SceneAccelerator, UpdateReport,
};
use splitplane_core::error::{BuildError, DeviceError};
use splitplane_core::scene::{GeometryId, GeometryMesh, Scene, SceneBuildError};
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_core::watch::Progress;

use crate::backend::{CORNERS, WgpuBackend};
use crate::builder::source::Source;
use crate::builder::{DeviceBuild, PendingBuild};
use crate::device::host;
use crate::query::WgpuScene;

/// An update of a scene that was submitted: the device builds the trees of its meshes, one after the other, and the scene answers meanwhile as
/// before. It is a [`PendingUpdate`] whose builds nobody waits for.
///
/// Trees get new memory on the device: no spares of a [`SceneUpdater`](splitplane_core::backend::scene::SceneUpdater) are built into.
///
/// What the host has to do, which is to send a mesh and to look at its triangles, is done by the calls. Dropped, it leaves the scene as it was, and so does
/// every error.
///
/// ```no_run
/// # use splitplane_core::backend::scene::{FinishError, SceneAccelerator};
/// # use splitplane_core::scene::Scene;
/// # use splitplane_wgpu::PendingSceneUpdate;
/// fn frame(
///     built: &mut dyn SceneAccelerator,
///     description: &Scene,
///     pending: &mut PendingSceneUpdate,
/// ) -> Result<(), FinishError> {
///     if pending.poll()? {
///         pending.finish(built, description)?;
///     }
///     // Rays through `built`, the old scene or the new one.
///     Ok(())
/// }
/// ```
pub struct PendingSceneUpdate {
    backend: WgpuBackend,
    update: PendingUpdate,
    options: BuildOptions<'static>,
    running: Option<Running>,
}

/// The build that is under way.
struct Running {
    geometry: GeometryId,
    mesh: Arc<GeometryMesh>,
    pending: PendingBuild,
    /// Corners of all triangles, for the host.
    triangles: Vec<Triangle>,
}

impl PendingSceneUpdate {
    /// Begins an update of a scene to a description: submits the build of the first mesh that needs one. The options' watch is not called.
    ///
    /// # Errors
    /// Shapes that the backend does not answer, and what a device or a limit refuses.
    pub fn begin(
        backend: &WgpuBackend,
        scene: &BuiltScene,
        description: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<PendingSceneUpdate, SceneBuildError> {
        let update = PendingUpdate::begin(backend, scene, description)?;
        let (backend, options) = (backend.clone(), options.unwatched());
        let mut own = PendingSceneUpdate { backend, update, options, running: None };
        own.submit_next()?;
        Ok(own)
    }

    /// Begins again: see [`PendingUpdate::renew`]. A build under way goes on where it is still needed, and is cancelled where it is not.
    ///
    /// # Errors
    /// As there, and as for [`PendingSceneUpdate::begin`].
    pub fn renew(
        &mut self,
        scene: &BuiltScene,
        description: &Scene,
    ) -> Result<(), SceneBuildError> {
        self.update.renew(scene, description)?;
        if let Some(running) = self.running.take() {
            match self.update.waits_for(&running.mesh) {
                Some(geometry) => self.running = Some(Running { geometry, ..running }),
                None => running.pending.cancel(),
            }
        }
        self.submit_next().map(drop)
    }

    /// Submits the build of the next mesh, where none is under way. False where no mesh is left.
    fn submit_next(&mut self) -> Result<bool, SceneBuildError> {
        if self.running.is_some() {
            return Ok(true);
        }
        let Some((geometry, mesh)) = self.update.next_mesh() else { return Ok(false) };
        let mesh = Arc::clone(mesh);
        let options = self.update.options_for_next(&self.options);
        let submitted = self.submit(&mesh, &options);
        let (pending, triangles) = submitted.map_err(|error| self.error_of(geometry, error))?;
        self.running = Some(Running { geometry, mesh, pending, triangles });
        Ok(true)
    }

    fn submit(
        &self,
        mesh: &GeometryMesh,
        options: &BuildOptions<'_>,
    ) -> Result<(PendingBuild, Vec<Triangle>), BuildError> {
        let mesh = mesh.mesh();
        let mut triangles = host::room(mesh.len(), CORNERS)?;
        let pending = self.backend.submit(&Source::Host(mesh), options, true, false)?;
        // While the device builds.
        triangles.extend((0..mesh.len()).map(|i| prepare(&mesh.triangle(i)).corners));
        Ok((pending, triangles))
    }

    fn error_of(&self, geometry: GeometryId, error: BuildError) -> SceneBuildError {
        self.update.error_of(geometry, error, &self.options)
    }

    /// Takes what came of the build under way. One that the caller does not wait for any longer goes on.
    fn take(&mut self, built: Result<DeviceBuild, BuildError>) -> Result<(), SceneBuildError> {
        if let (Some(running), Err(error)) = (&self.running, &built)
            && matches!(error, BuildError::Device(DeviceError::TimedOut { .. }))
        {
            return Err(self.error_of(running.geometry, error.clone()));
        }
        let Some(Running { geometry, mesh, triangles, .. }) = self.running.take() else {
            return Ok(());
        };
        let built = built.map_err(|error| self.error_of(geometry, error))?;
        let tree = self.backend.accelerator(built, triangles);
        self.update.give(&mesh, Box::new(tree)).map_err(|error| self.error_of(geometry, error))
    }

    /// Looks whether the device is done, and submits the next build when it is done with one; true when all trees are there. Never waits.
    ///
    /// # Errors
    /// What a device or a limit refuses; the next call tries again.
    pub fn poll(&mut self) -> Result<bool, SceneBuildError> {
        loop {
            self.submit_next()?;
            let Some(running) = &mut self.running else { return Ok(true) };
            match running.pending.poll() {
                Ok(None) => return Ok(false),
                Ok(Some(built)) => self.take(Ok(built))?,
                Err(error) => self.take(Err(error))?,
            }
        }
    }

    /// Waits until all trees are there.
    ///
    /// # Errors
    /// As for [`PendingSceneUpdate::poll`], and a device that takes longer than its time-out: the build goes on, and the next call waits for it again.
    pub fn wait(&mut self) -> Result<(), SceneBuildError> {
        loop {
            self.submit_next()?;
            let Some(running) = &mut self.running else { return Ok(()) };
            let built = running.pending.wait();
            self.take(built)?;
        }
    }

    /// As [`PendingSceneUpdate::wait`], without blocking. A future that is dropped leaves the update as it is.
    ///
    /// # Errors
    /// As for [`PendingSceneUpdate::wait`].
    pub async fn wait_async(&mut self) -> Result<(), SceneBuildError> {
        loop {
            self.submit_next()?;
            let Some(running) = &mut self.running else { return Ok(()) };
            let built = running.pending.wait_async().await;
            self.take(built)?;
        }
    }

    /// How many trees are there, of how many.
    pub fn progress(&self) -> Progress {
        self.update.progress()
    }

    /// Puts the update in place: see [`PendingUpdate::finish`]. Never waits for a build: while one is under way, it is [`FinishError::NotBuilt`]. The
    /// geometries that changed are sent to the buffers that the scene's rays read. With a limit of memory that has no place for old and new buffers side by
    /// side it waits until the device has freed the old ones, and so for what else was submitted before.
    ///
    /// What the device refuses when they are sent is known at once, and leaves the scene to the CPU: see
    /// [`SceneAccelerator::placed_by_cpu`]. In a browser it is told later, and nothing would say so:
    /// there take [`PendingSceneUpdate::finish_async`].
    ///
    /// # Errors
    /// As there.
    pub fn finish(
        &mut self,
        scene: &mut dyn SceneAccelerator,
        description: &Scene,
    ) -> Result<UpdateReport, FinishError> {
        self.update.finish(&self.backend, scene, description, &self.options)
    }

    /// As [`PendingSceneUpdate::finish`] of a scene of this backend's, and waits, without blocking, until it is known what the device refused when the scene was sent to it.
    /// Outside of a browser it blocks where [`PendingSceneUpdate::finish`] waits for old buffers, within a limit of memory that has no place for both.
    ///
    /// # Errors
    /// As for [`PendingSceneUpdate::finish`]: the scene is then what it was. What the device refused is an error too. The update is then in place on the host,
    /// and the scene needs another one, which sends everything again; the trees are the scene's.
    ///
    /// A future that is dropped before it is known leaves the scene so too: updated on the host, and answered by the CPU until the next update has sent everything.
    pub async fn finish_async(
        &mut self,
        scene: &mut WgpuScene,
        description: &Scene,
    ) -> Result<UpdateReport, FinishError> {
        let PendingSceneUpdate { backend, update, options, .. } = self;
        scene.settled(|scene| update.finish(&*backend, scene, description, options)).await
    }

    /// Cancels it: the next build uses the buffers of the one under way.
    pub fn cancel(self) {
        if let Some(running) = self.running {
            running.pending.cancel();
        }
    }
}

#[cfg(all(test, not(target_family = "wasm")))]
mod tests {
    use std::pin::pin;
    use std::sync::atomic::AtomicBool;
    use std::sync::atomic::Ordering::Relaxed;
    use std::task::{Context, Poll, Waker};

    use splitplane_core::backend::Backend;
    use splitplane_core::mesh::Mesh;
    use splitplane_core::scene::{Instance, SceneHit, SceneOptions, translation};
    use splitplane_cpu::CpuBackend;
    use splitplane_test_support::objects::{self, Kind};
    use splitplane_test_support::scenes;

    use super::*;
    use crate::error::GpuError;
    use crate::{Gpu, OpenOptions};

    /// A browser tells later what it refused. Here that is planted, since a device of this system tells at once.
    #[test]
    #[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
    fn what_is_refused_later_is_an_error_and_takes_the_scene_from_the_device() {
        let adapter = std::env::var("SPLITPLANE_ADAPTER").ok();
        let open = OpenOptions { default_limits: true, adapter, ..OpenOptions::default() };
        let gpu = Gpu::open(&open).expect("a device");
        let backend = WgpuBackend::new(Gpu::clone(&gpu)).expect("a backend");
        let options = BuildOptions::default();
        let mut scene = Scene::new();
        let triangle = |x| [[[x, 0.0, 0.0], [x, 1.0, 0.0], [x, 0.0, 1.0]]];
        let name = scene.add_mesh(&Mesh::soup(&triangle(0.0)).unwrap()).unwrap();
        scene.add_instance(Instance::in_place(name)).unwrap();
        let work = backend.build_scene_async(&scene, &options);
        let mut built = pollster::block_on(work).expect("a scene");
        for late in [false, true, false] {
            scene.replace_mesh(name, &Mesh::soup(&triangle(1.0)).unwrap()).unwrap();
            let begin = PendingSceneUpdate::begin(&backend, built.scene(), &scene, &options);
            let mut pending = begin.unwrap();
            pending.wait().unwrap();
            if late {
                gpu.refuse_later(GpuError::Refused("planted".into()));
            }
            let finished = pollster::block_on(pending.finish_async(&mut built, &scene));
            let reason = built.placed_by_cpu().map(str::to_owned);
            if late {
                let error = finished.unwrap_err();
                assert!(error.to_string().contains("planted"), "{error}");
                assert!(reason.is_some_and(|reason| reason.contains("planted")));
                gpu.forget_refused();
                // Another update, of the same description, sends everything again.
                backend.update_scene(&mut built, &scene, &options).unwrap();
            } else {
                assert_eq!(finished.unwrap().geometries_built, 1);
            }
            assert_eq!(built.placed_by_cpu(), None);
        }
    }

    /// A browser tells later that it took everything, or that it did not; who asked is gone by then.
    #[test]
    #[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
    fn an_update_that_is_dropped_half_way_takes_the_scene_from_the_device() {
        let adapter = std::env::var("SPLITPLANE_ADAPTER").ok();
        let open = OpenOptions { default_limits: true, adapter, ..OpenOptions::default() };
        let gpu = Gpu::open(&open).expect("a device");
        let backend = WgpuBackend::new(Gpu::clone(&gpu)).expect("a backend");
        let options = BuildOptions::default();
        let (mut scene, names) = objects::scene(Kind::Ordinary, 12, 5);
        let rays = objects::rays(&scene, 300, 6);
        let work = backend.build_scene_async(&scene, &options);
        let mut built = pollster::block_on(work).expect("a scene");
        let query = SceneOptions::default();
        let hits_of = |scene: &dyn SceneAccelerator| -> Vec<[u32; 6]> {
            let mut hits = vec![SceneHit::MISS; rays.len()];
            scene.closest_hits(&rays, &mut hits, &query).expect("hits");
            hits.iter().map(|hit| bytemuck::cast(*hit)).collect()
        };
        let by_cpu = |scene: &Scene| {
            let fresh = CpuBackend::new().build_scene(scene, &options).expect("a scene");
            hits_of(&*fresh)
        };
        for (number, (pends, refuses)) in
            [(true, false), (true, true), (false, false), (false, true)].into_iter().enumerate()
        {
            let before = hits_of(&built);
            assert_eq!((&before, built.placed_by_cpu()), (&by_cpu(&scene), None));
            let place = translation([0.5, 0.25 * (number + 1) as f32, 0.0]);
            scene.move_instance(names[2], place).unwrap();
            let told = Arc::new(AtomicBool::new(false));
            let is_told = Arc::clone(&told);
            let check = std::future::poll_fn(move |_| match is_told.load(Relaxed) {
                true => Poll::Ready(refuses.then(|| GpuError::Refused("planted".into()))),
                false => Poll::Pending,
            });
            let mut pending = if pends {
                let geometry = scene.geometries().next().unwrap().0;
                let mesh = scenes::soup(50 + number, 0.5, 3);
                scene.replace_mesh(geometry, &mesh.mesh()).unwrap();
                let begun =
                    PendingSceneUpdate::begin(&backend, built.scene(), &scene, &options).unwrap();
                Some(begun)
            } else {
                None
            };
            if let Some(pending) = &mut pending {
                pending.wait().unwrap();
            }
            gpu.tell_later(Box::pin(check));
            {
                let mut context = Context::from_waker(Waker::noop());
                let is_pending = match &mut pending {
                    Some(pending) => {
                        let mut work = pin!(pending.finish_async(&mut built, &scene));
                        work.as_mut().poll(&mut context).is_pending()
                    }
                    None => {
                        let mut work =
                            pin!(backend.update_scene_async(&mut built, &scene, &options));
                        work.as_mut().poll(&mut context).is_pending()
                    }
                };
                assert!(is_pending);
            }
            told.store(true, Relaxed);
            assert_eq!(gpu.settled(gpu.mark()).is_err(), refuses);
            gpu.forget_refused();
            // Answers are those of the new scene, and not from arrays of which nothing is known.
            let reason = built.placed_by_cpu().map(str::to_owned);
            assert!(reason.as_ref().is_some_and(|own| own.contains("dropped")), "{reason:?}");
            let after = hits_of(&built);
            assert_eq!(after, by_cpu(&scene));
            assert_ne!(after, before);
            assert_eq!(built.bytes_on_device(), 0);
            assert!(
                matches!(built.bindings(), Err(GpuError::NotHeld(told)) if Some(&told) == reason.as_ref())
            );
            let mut hits = vec![SceneHit::MISS; rays.len()];
            let asked = pollster::block_on(built.closest_hits_async(&rays, &mut hits, &query));
            assert!(asked.unwrap_err().to_string().contains("dropped"));
            // Another update, of the same description, sends everything again.
            let report = backend.update_scene(&mut built, &scene, &options).unwrap();
            assert_eq!((report.geometries_built, report.instances_changed), (0, 0));
            let packed: u64 = built.scene().packed_sizes().bytes().iter().sum();
            assert!(report.bytes_sent > packed / 2, "{} {packed}", report.bytes_sent);
            assert_eq!((built.placed_by_cpu(), hits_of(&built)), (None, after));
        }
        // Dropped while trees are built, it leaves the scene where it is.
        let before = hits_of(&built);
        let geometry = scene.geometries().next().unwrap().0;
        scene.replace_mesh(geometry, &scenes::soup(70, 0.5, 3).mesh()).unwrap();
        let told = Arc::new(AtomicBool::new(false));
        let is_told = Arc::clone(&told);
        gpu.tell_later(Box::pin(std::future::poll_fn(move |_| match is_told.load(Relaxed) {
            true => Poll::Ready(None),
            false => Poll::Pending,
        })));
        {
            let mut work = pin!(backend.update_scene_async(&mut built, &scene, &options));
            let mut context = Context::from_waker(Waker::noop());
            assert!(work.as_mut().poll(&mut context).is_pending());
        }
        told.store(true, Relaxed);
        assert_eq!((hits_of(&built), built.placed_by_cpu()), (before, None));
        backend.update_scene(&mut built, &scene, &options).unwrap();
        assert_eq!((hits_of(&built), built.placed_by_cpu()), (by_cpu(&scene), None));
    }
}
