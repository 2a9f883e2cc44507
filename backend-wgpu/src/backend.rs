//! The GPU as a [`Backend`].

use std::collections::VecDeque;
use std::num::NonZeroU32;
use std::sync::Arc;

use splitplane_core::backend::scene::{SceneAccelerator, UpdateReport, bytes_of};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions};
use splitplane_core::cancel::go_on;
use splitplane_core::config::BuildConfig;
use splitplane_core::error::BuildError;
use splitplane_core::kernel::{Buffer, Kernel, QueryKernel, RayQueries, TreeBuilder};
use splitplane_core::mesh::Mesh;
use splitplane_core::points::build::{PointBuildError, PointOptions};
use splitplane_core::report::{BackendInfo, BuildSummary};
use splitplane_core::scene::file::SceneFile;
use splitplane_core::scene::{Scene, SceneBuildError};
use splitplane_core::tree::KdTree;
use splitplane_core::tree::validate::validate_mesh_while;
use splitplane_core::triangle::{Prepared, Triangle, prepare};
use splitplane_core::watch::{Progress, Stage};
use splitplane_float_state::Standard;

use crate::builder::buffers::{Buffers, POOL_AT_START};
use crate::builder::capacities::Capacities;
use crate::builder::executor::first_counters;
use crate::builder::shared::Shared;
use crate::builder::source::Source;
use crate::builder::{
    DeviceBuild, DeviceMesh, MovedMesh, MovedMeshError, PendingBuild, WgpuExecutor,
};
use crate::device::gpu::Gpu;
use crate::device::host;
use crate::device::wait::{Wait, blocking};
use crate::device::{Instrument, Pipelines};
use crate::error::GpuError;
use crate::parity::Parity;
use crate::query::{DeviceTree, Queries, WgpuAccelerator, WgpuPointTree, WgpuScene};
use crate::selftest;

/// The GPU backend: builds trees on one device and answers rays there. Buffers are kept between
/// builds; pipelines are compiled when they are first used. A clone is the same backend: it shares device, pipelines and kept buffers.
#[derive(Clone, Debug)]
pub struct WgpuBackend {
    shared: Arc<Shared>,
    /// `None` before the self-test.
    parity: Option<Parity>,
}

impl WgpuBackend {
    /// A backend on this device. Runs a self-test: the guarded operations, a small build and some
    /// rays, compared with the CPU's bits. Only the pipelines that the self-test needs are made; those of
    /// other queries follow when they are first used.
    ///
    /// # Errors
    /// A device whose limits are too low, that fails, or whose trees are not valid; a driver that takes too
    /// long or too much memory for the pipelines.
    pub fn new(gpu: Gpu) -> Result<WgpuBackend, GpuError> {
        blocking(WgpuBackend::new_by(Wait::Blocking, gpu))
    }

    /// As [`WgpuBackend::new`], without blocking while the device works. Where it is no browser's, a thread of the
    /// driver's is waited for while it compiles a pipeline.
    ///
    /// # Errors
    /// As for [`WgpuBackend::new`].
    pub async fn new_async(gpu: Gpu) -> Result<WgpuBackend, GpuError> {
        WgpuBackend::new_by(Wait::Yielding, gpu).await
    }

    async fn new_by(wait: Wait, gpu: Gpu) -> Result<WgpuBackend, GpuError> {
        gpu.check_limits()?;
        let mut backend = WgpuBackend::without_selftest(gpu);
        let parity = {
            let opening = backend.gpu().opening();
            match selftest::run(wait, &backend.shared).await {
                Ok(parity) => parity,
                Err(error) => {
                    let error = opening.exceeded().unwrap_or(error);
                    return Err(backend.gpu().cause(error).await);
                }
            }
        };
        backend.queries().set_parity(&parity);
        backend.parity = Some(parity);
        Ok(backend)
    }

    /// A backend without the self-test, which would refuse a device that builds broken trees: for
    /// finding out what is wrong with one.
    pub fn without_selftest(gpu: Gpu) -> WgpuBackend {
        WgpuBackend { shared: Arc::new(Shared::new(gpu)), parity: None }
    }

    /// A backend in which one build kernel has another text, without a self-test: for tests that
    /// plant faults.
    #[doc(hidden)]
    pub fn with_replaced_kernel(gpu: Gpu, kernel: Kernel, source: String) -> WgpuBackend {
        let backend = WgpuBackend::without_selftest(gpu);
        backend.shared.pipelines.replace::<TreeBuilder>(kernel, Some(source));
        backend
    }

    /// Gives one build kernel another text from now on, or its own again; the others stay compiled.
    #[doc(hidden)]
    pub fn replace_kernel(&self, kernel: Kernel, source: Option<String>) {
        self.shared.pipelines.replace::<TreeBuilder>(kernel, source);
    }

    /// As [`WgpuBackend::with_replaced_kernel`], with another text of what finishes the kernel's work.
    #[doc(hidden)]
    pub fn with_replaced_retry(gpu: Gpu, kernel: Kernel, source: String) -> WgpuBackend {
        let backend = WgpuBackend::without_selftest(gpu);
        backend.shared.pipelines.replace_retry::<TreeBuilder>(kernel, Some(source));
        backend
    }

    /// A backend that takes this to be what the self-test found: for tests of devices that are not there.
    #[doc(hidden)]
    pub fn with_parity(gpu: Gpu, parity: Parity) -> WgpuBackend {
        let backend = WgpuBackend::without_selftest(gpu);
        backend.queries().set_parity(&parity);
        WgpuBackend { parity: Some(parity), ..backend }
    }

    /// As [`WgpuBackend::with_replaced_kernel`], for a kernel of queries.
    #[doc(hidden)]
    pub fn with_replaced_query(gpu: Gpu, kernel: QueryKernel, source: String) -> WgpuBackend {
        let backend = WgpuBackend::without_selftest(gpu);
        backend.shared.pipelines.replace::<RayQueries>(kernel, Some(source));
        backend
    }

    /// A backend whose kernels are changed, without a self-test: for tools that count what kernels do.
    #[doc(hidden)]
    pub fn instrumented(gpu: Gpu, instrument: Instrument) -> WgpuBackend {
        let shared = Shared::with(gpu, Pipelines::instrumented(instrument));
        WgpuBackend { shared: Arc::new(shared), parity: None }
    }

    /// Limits the workgroups of every later dispatch of a build, and so the part of the device that
    /// is used: for measuring how builds scale. Trees are the same, since workgroups loop to
    /// counts; but a driver that ends long loops may then give up (Mesa's llvmpipe does). `None`
    /// lifts the limit.
    pub fn limit_workgroups(&self, most: Option<NonZeroU32>) {
        self.shared.limit_workgroups(most);
    }

    /// What the self-test found; `None` for a backend made without it.
    pub fn parity(&self) -> Option<&Parity> {
        self.parity.as_ref()
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.shared.gpu
    }

    /// Queries on this device, for trees built or loaded here.
    pub fn queries(&self) -> &Arc<Queries> {
        &self.shared.queries
    }

    /// A tree of points that the device builds, and that answers there: see [`WgpuPointTree`].
    ///
    /// # Errors
    /// See [`PointBuildError`]; [`PointBuildError::NotBitwise`] on a device whose parity is only structural: the order of points follows
    /// from its arithmetic, and nothing else holds what it builds to be a tree.
    pub fn points<const N: usize>(
        &self,
        points: &[[f32; N]],
        options: &PointOptions<'_>,
    ) -> Result<WgpuPointTree<N>, PointBuildError> {
        if let Some(Parity::Structural(difference)) = &self.parity {
            return Err(PointBuildError::NotBitwise { difference: difference.to_string() });
        }
        WgpuPointTree::build(Arc::clone(&self.shared.queries), points, options)
    }

    /// Builds a tree that stays on the device. One submission and one readback of 256 bytes, except
    /// for scenes that outgrow the estimated capacities.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub fn build_on_device(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<DeviceBuild, BuildError> {
        let _state = Standard::set();
        self.submit_build(mesh, options)?.wait_watched(options.watch)
    }

    /// As [`WgpuBackend::build_on_device`], without blocking while the device builds: the thread may do other work
    /// meanwhile, and a page stays alive. The watch is called whenever the build is looked at. A future that is dropped
    /// cancels the build.
    ///
    /// Work of the host's own is done when the future is polled: the mesh is sent, and the first build of its kind has
    /// its pipelines compiled (in a browser by another process).
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub async fn build_on_device_async(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<DeviceBuild, BuildError> {
        self.submit_build(mesh, options)?.wait_watched_by(Wait::Yielding, options.watch).await
    }

    /// Sends the mesh, submits the build and returns at once; [`PendingBuild::poll`] gives the tree
    /// when it is done. Trees built before can be queried meanwhile. The options' watch is not
    /// called: [`PendingBuild::cancel`] cancels the build.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub fn submit_build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<PendingBuild, BuildError> {
        let _state = Standard::set();
        self.submit(&Source::Host(*mesh), options, false, false)
    }

    /// As [`WgpuBackend::submit_build`], over a mesh that is on the device already: nothing of it
    /// crosses to the host or back.
    ///
    /// # Errors
    /// As for [`Backend::build`]; [`BuildError::InvalidMesh`] for counts that do not fit the buffers.
    pub fn submit_build_from(
        &self,
        mesh: &DeviceMesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<PendingBuild, BuildError> {
        let _state = Standard::set();
        self.submit(&Source::Device(*mesh), options, false, false)
    }

    /// Sends a mesh to the device, where a kernel then moves its vertices by groups: see [`MovedMesh::place`]. `group_of` has the group of
    /// each vertex, a number below `groups`.
    ///
    /// # Errors
    /// A vertex without a group, or whose coordinates are not finite; more than the device can bind or hold.
    pub fn moved_mesh(
        &self,
        mesh: &Mesh<'_>,
        group_of: &[u32],
        groups: usize,
    ) -> Result<MovedMesh, MovedMeshError> {
        let _state = Standard::set();
        MovedMesh::new(&self.shared, mesh, group_of, groups)
    }

    /// Submits a build; with `tree_to_host` the tree is read back too.
    pub(crate) fn submit(
        &self,
        source: &Source<'_>,
        options: &BuildOptions<'_>,
        tree_to_host: bool,
        profiled: bool,
    ) -> Result<PendingBuild, BuildError> {
        PendingBuild::submit(Arc::clone(&self.shared), source, options, tree_to_host, profiled)
    }

    /// As [`WgpuBackend::build_on_device`], with the time of every kernel where the device has
    /// timestamps. Slower: each dispatch is a pass of its own.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub fn build_profiled(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<DeviceBuild, BuildError> {
        self.submit(&Source::Host(*mesh), options, false, true)?.wait_watched(options.watch)
    }

    /// Gives the buffers of a tree that is no longer needed to the next build. This saves their
    /// allocation when rebuilding each frame. Commands that read the tree must have been submitted
    /// before.
    pub fn recycle(&self, tree: DeviceTree) {
        if let Some(mut pooled) = self.shared.take_buffers() {
            let (parts, scene) = tree.into_buffers();
            pooled.buffers.scene = Some(scene);
            pooled.buffers.put(Buffer::Nodes, parts.nodes);
            pooled.buffers.put(Buffer::LeafReferences, parts.leaf_references);
            pooled.buffers.put(Buffer::Triangles, parts.triangles);
            self.shared.keep_buffers(pooled);
        }
    }

    /// Builds a tree on the device, with copies of tree and corners in host memory; the accelerator
    /// by its own type. The host's copy of the corners is made while the device builds.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub fn build_accelerator(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<WgpuAccelerator, BuildError> {
        let _state = Standard::set();
        blocking(self.build_accelerator_by(Wait::Blocking, mesh, options))
    }

    /// As [`WgpuBackend::build_accelerator`], without blocking while the device builds; see
    /// [`WgpuBackend::build_on_device_async`]. The host's copy of the corners is made in one piece.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub async fn build_accelerator_async(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<WgpuAccelerator, BuildError> {
        self.build_accelerator_by(Wait::Yielding, mesh, options).await
    }

    async fn build_accelerator_by(
        &self,
        wait: Wait,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<WgpuAccelerator, BuildError> {
        wait.check()?;
        let watch = options.watch;
        let start = |done: usize| Progress {
            stage: Stage::Start,
            done: done as u64,
            total: mesh.len() as u64,
        };
        go_on(watch, start(0))?;
        let mut triangles = host::room(mesh.len(), CORNERS)?;
        let pending = self.submit(&Source::Host(*mesh), options, true, false)?;
        while triangles.len() < mesh.len() {
            let piece = triangles.len()..mesh.len().min(triangles.len() + PIECE);
            triangles.extend(piece.map(|i| prepare(&mesh.triangle(i)).corners));
            if let Err(cancelled) = go_on(watch, start(triangles.len())) {
                pending.cancel();
                return Err(cancelled);
            }
        }
        let built = pending.wait_watched_by(wait, watch).await?;
        Ok(self.accelerator(built, triangles))
    }

    /// As [`WgpuBackend::build_accelerator`], in place of an accelerator that is no longer needed,
    /// whose buffers the next build of this backend gets. Where it has compressed nodes, the device makes those of the new tree. After an error the accelerator is
    /// unchanged: the memory of both is held for a while, and counts towards the limit.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub fn rebuild_accelerator(
        &self,
        accelerator: &mut WgpuAccelerator,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), BuildError> {
        let _state = Standard::set();
        let held = accelerator.held_bytes();
        let built = self.build_accelerator(mesh, &options.beside(held));
        let mut built = built.map_err(|error| error.beside(held, options.max_memory))?;
        if accelerator.device_tree().is_compressed() {
            built.compress_on_device()?;
        }
        let old = core::mem::replace(accelerator, built);
        self.recycle(old.into_device_tree());
        Ok(())
    }

    /// As [`Backend::build_scene`], as this backend's own type: for [`WgpuScene::bindings`].
    ///
    /// # Errors
    /// As there.
    pub fn build_wgpu_scene(
        &self,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<WgpuScene, SceneBuildError> {
        let _state = Standard::set();
        self.check_shapes(scene)?;
        let queries = Arc::clone(&self.shared.queries);
        let mut build = |mesh: &Mesh<'_>, options: &BuildOptions<'_>| self.build(mesh, options);
        WgpuScene::build(queries, scene, options, &mut build)
    }

    /// As [`Backend::load_scene`], as this backend's own type: for [`WgpuScene::bindings`].
    ///
    /// # Errors
    /// As there.
    pub fn load_wgpu_scene(
        &self,
        file: &SceneFile<'_>,
        options: &LoadOptions<'_>,
    ) -> Result<(Scene, WgpuScene), SceneBuildError> {
        let _state = Standard::set();
        let mut built = WgpuScene::empty(Arc::clone(&self.shared.queries));
        let scene = self.load_scene_into(&mut built, file, options)?;
        Ok((scene, built))
    }

    /// As [`Backend::build_scene`], without blocking while the device builds geometries. Trees over shapes are built on the CPU, in one piece,
    /// after all others. `max_memory` is the same limit as there.
    ///
    /// # Errors
    /// As for [`Backend::build_scene`].
    pub async fn build_scene_async(
        &self,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<WgpuScene, SceneBuildError> {
        let mut own = WgpuScene::empty(Arc::clone(&self.shared.queries));
        self.update_scene_async(&mut own, scene, options).await?;
        Ok(own)
    }

    /// As [`SceneAccelerator::update_by`] of a scene of this backend's, without blocking while the device builds geometries. What the device refuses when
    /// the scene is sent to it is an error too, and the scene then needs another update. Outside of a browser it blocks until the device has freed the old buffers
    /// where a limit of memory has no place for old and new ones side by side.
    ///
    /// A future that is dropped while geometries are built leaves the scene as it was. One that is dropped later, before the device has told whether it took what was sent, leaves the
    /// new scene to the CPU ([`SceneAccelerator::placed_by_cpu`] says so) until the next update has sent everything.
    ///
    /// # Errors
    /// As for [`Backend::build_scene`]. After any other error than that one the scene is what it was.
    pub async fn update_scene_async(
        &self,
        built: &mut WgpuScene,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        self.check_shapes(scene)?;
        let new = built.scene().unbuilt(scene)?.map(|(name, mesh)| (name, Arc::clone(mesh)));
        let new: Vec<_> = new.collect();
        let mut held = if options.max_memory.is_some() { built.scene().bytes() } else { 0 };
        let mut ready: VecDeque<Box<dyn Accelerator>> = VecDeque::new();
        let total = new.len() as u64;
        for (name, mesh) in new {
            let done = ready.len() as u64;
            let progress = Progress { stage: Stage::Geometries, done, total };
            go_on(options.watch, progress).map_err(|_| SceneBuildError::Cancelled { progress })?;
            let one = self.build_accelerator_async(&mesh.mesh(), &options.beside(held)).await;
            let one = one.map_err(|error| match error {
                BuildError::Cancelled { .. } => SceneBuildError::Cancelled { progress },
                error => {
                    let error = error.beside(held, options.max_memory);
                    SceneBuildError::Geometry { geometry: name.0, error }
                }
            })?;
            held = held.saturating_add(bytes_of(&one));
            ready.push_back(Box::new(one));
        }
        built.update_with(scene, options, ready).await
    }

    /// What answers rays, of a build whose tree was read back, and the mesh's corners as they were prepared.
    pub(crate) fn accelerator(
        &self,
        built: DeviceBuild,
        triangles: Vec<Triangle>,
    ) -> WgpuAccelerator {
        let tree = built.host_tree.expect("a build for the host reads the tree back");
        let queries = Arc::clone(&self.shared.queries);
        WgpuAccelerator::new(queries, built.tree, tree, triangles, built.summary)
    }

    /// Calls `run` with an executor over fresh buffers that submits every step and whose buffers
    /// can be read in between: for [`splitplane_core::build::lockstep::Lockstep`]. The buffers have the
    /// capacity for everything that the configuration allows, within the limits of the device.
    ///
    /// # Errors
    /// A configuration out of range, a preset that devices do not build, or a device that cannot hold
    /// the scene.
    pub fn with_executor<T>(
        &self,
        mesh: &Mesh<'_>,
        config: &BuildConfig,
        run: impl FnOnce(WgpuExecutor<'_>) -> T,
    ) -> Result<T, BuildError> {
        self.with_executor_of(Capacities::roomy(mesh.len() as u32, config), mesh, config, run)
    }

    /// As [`WgpuBackend::with_executor`], with the middle stage. The build may then turn out void: see
    /// [`splitplane_core::build::middle`].
    ///
    /// # Errors
    /// As for [`WgpuBackend::with_executor`].
    pub fn with_middle_executor<T>(
        &self,
        mesh: &Mesh<'_>,
        config: &BuildConfig,
        run: impl FnOnce(WgpuExecutor<'_>) -> T,
    ) -> Result<T, BuildError> {
        let roomy = Capacities::roomy(mesh.len() as u32, config).with_middle_stage();
        let roomy = roomy.with_room_for_any_growth(self.shared.gpu.limits());
        self.with_executor_of(roomy, mesh, config, run)
    }

    /// As [`WgpuBackend::with_executor`], with the capacities that a first build estimates, which most scenes fit: then
    /// grids are those of builds.
    #[doc(hidden)]
    pub fn with_estimated_executor<T>(
        &self,
        mesh: &Mesh<'_>,
        config: &BuildConfig,
        run: impl FnOnce(WgpuExecutor<'_>) -> T,
    ) -> Result<T, BuildError> {
        let estimate = Capacities::estimate(mesh.len() as u32, config).with_middle_stage();
        self.with_executor_of(estimate, mesh, config, run)
    }

    fn with_executor_of<T>(
        &self,
        capacities: Capacities,
        mesh: &Mesh<'_>,
        config: &BuildConfig,
        run: impl FnOnce(WgpuExecutor<'_>) -> T,
    ) -> Result<T, BuildError> {
        config.validate()?;
        let preset = config.preset();
        preset.planes().ok_or(BuildError::PresetNotOnDevice { preset })?;
        let gpu = &self.shared.gpu;
        let [positions, indices] = Source::Host(*mesh).bytes();
        let capacities = Capacities { input_bytes: positions + indices, ..capacities };
        let capacities = capacities.within(gpu.limits(), None, config)?;
        gpu.guard(|| self.run_executor(mesh, config, capacities, run))?
    }

    fn run_executor<T>(
        &self,
        mesh: &Mesh<'_>,
        config: &BuildConfig,
        capacities: Capacities,
        run: impl FnOnce(WgpuExecutor<'_>) -> T,
    ) -> Result<T, BuildError> {
        let gpu = &self.shared.gpu;
        let triangles = mesh.len() as u32;
        let mut buffers = Buffers::new(gpu)?;
        buffers.reserve(gpu, &capacities, false)?;
        let source = Source::Host(*mesh);
        buffers.upload(gpu, &capacities, &source)?;
        let parameters = capacities.parameters(config, source.first_index());
        buffers.write_parameters(gpu, &capacities, &parameters);
        let counters = first_counters(triangles);
        let bytes = bytemuck::bytes_of(&counters);
        gpu.queue().write_buffer(buffers.get(Buffer::Counters), 0, bytes);
        gpu.queue().write_buffer(buffers.get(Buffer::MiddleNodes), 0, &POOL_AT_START);
        let pipelines = &self.shared.pipelines;
        Ok(run(WgpuExecutor::inspected(gpu, pipelines, &mut buffers, capacities)))
    }
}

impl Backend for WgpuBackend {
    fn describe(&self) -> BackendInfo {
        let info = self.shared.gpu.info();
        let driver = format!("{} {}", info.driver, info.driver_info);
        let mut described = BackendInfo::new("wgpu");
        described.adapter = Some(info.name.clone());
        described.detail = format!(
            "{}, driver {}, parity {}",
            info.backend.to_str(),
            driver.trim(),
            self.parity.as_ref().map_or("not tested", Parity::name)
        );
        described
    }

    /// A device calls no functions of the host's.
    fn answers_own_shapes(&self) -> bool {
        false
    }

    /// Rays in batches are traced on the device, single ones on the CPU from a copy of the tree.
    /// Calls the watch while the mesh is prepared, then every half millisecond while the device
    /// builds.
    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        Ok(Box::new(self.build_accelerator(mesh, options)?))
    }

    /// As [`WgpuBackend::rebuild_accelerator`]; an accelerator of another backend is replaced.
    fn rebuild(
        &self,
        accelerator: &mut Box<dyn Accelerator>,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), BuildError> {
        match accelerator.downcast_mut::<WgpuAccelerator>() {
            Some(own) => self.rebuild_accelerator(own, mesh, options),
            None => {
                let held = accelerator.held_bytes();
                let built = self.build(mesh, &options.beside(held));
                *accelerator = built.map_err(|error| error.beside(held, options.max_memory))?;
                Ok(())
            }
        }
    }

    /// A scene that answers rays on the device: see [`WgpuScene`].
    fn build_scene(
        &self,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn SceneAccelerator>, SceneBuildError> {
        Ok(Box::new(self.build_wgpu_scene(scene, options)?))
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        let _state = Standard::set();
        let watch = options.watch;
        // Each triangle is checked, then prepared.
        let total = 2 * mesh.len() as u64;
        let ask = |done: u64| go_on(watch, Progress { stage: Stage::Start, done, total });
        ask(0)?;
        let (mut done, mut ended) = (0, Ok(()));
        validate_mesh_while(&tree.view(), mesh, |triangles| {
            done += u64::from(triangles);
            ended = ask(done);
            ended.is_ok()
        })
        .map_err(|violation| BuildError::WrongMesh { reason: violation.to_string() })?;
        ended?;
        // Corners on the device and on the host, the tree on the device.
        let needed = 2 * (mesh.len() * size_of::<Triangle>()) as u64
            + (8 * tree.nodes.len() + 4 * tree.references.len()) as u64;
        if let Some(limit) = options.max_memory
            && needed > limit
        {
            return Err(BuildError::OutOfMemory { needed, limit });
        }
        let mut summary = BuildSummary::default();
        (summary.triangles, summary.peak_bytes) = (mesh.len() as u32, needed);
        let mut triangles = host::room(mesh.len(), CORNERS)?;
        for i in 0..mesh.len() {
            let Prepared { corners, kept, snapped } = prepare(&mesh.triangle(i));
            summary.dropped += u32::from(!kept);
            summary.snapped += u32::from(snapped);
            triangles.push(corners);
            if (i + 1) % PIECE == 0 {
                ask((mesh.len() + i + 1) as u64)?;
            }
        }
        ask(total)?;
        let queries = Arc::clone(&self.shared.queries);
        Ok(Box::new(WgpuAccelerator::upload(queries, tree, triangles, summary)?))
    }
}

/// Triangles that are prepared between two calls of the watch.
const PIECE: usize = 4096;
/// What host memory is asked for.
pub(crate) const CORNERS: &str = "a copy of the triangles' corners";
