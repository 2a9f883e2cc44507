//! Frames on a GPU.

#[cfg(feature = "cpu")]
use super::host_shaded::{HostShaded, check, copied};
use super::{Moved, Shading, TracerError, TreeSize};
use crate::error::RenderError;
use crate::frame::{FrameInput, FrameStats};
use crate::kernel::Buffer;
use crate::layout::{FirstCost, FirstHit};
use crate::plan::Room;
use crate::scene_data::SceneData;
use crate::settings::RenderSettings;
#[cfg(feature = "cpu")]
use crate::wgpu::check_target;
use crate::wgpu::{Keyframes, WgpuRenderer, beyond_device};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Accuracy;
use splitplane_core::report::{BackendInfo, BuildSummary};
use splitplane_core::tree::digest::Digest;
use splitplane_wgpu::{DeviceTree, PendingBuild, Traffic, WgpuAccelerator, WgpuBackend};
use std::borrow::Cow;

#[derive(Debug)]
pub(super) struct OnGpu {
    backend: WgpuBackend,
    tree: Tree,
    renderer: WgpuRenderer,
    /// Vertices on the device.
    keyframes: Keyframes,
    /// The tree for the next frame.
    building: Option<PendingBuild>,
    /// A submitted frame that had to be waited for before it was asked for.
    settled: Option<Result<FrameStats, TracerError>>,
    /// For frames that the device's kernels do not shade.
    #[cfg(feature = "cpu")]
    host: HostShaded,
    /// Whether trees get compressed nodes.
    compressed: bool,
}

/// A tree on the device.
#[derive(Debug)]
enum Tree {
    /// With a copy in host memory, for queries from there.
    Copied(Box<WgpuAccelerator>),
    /// For frames alone.
    OnDevice(Box<DeviceTree>, BuildSummary),
}

impl Tree {
    fn on_device(&self) -> &DeviceTree {
        match self {
            Tree::Copied(accelerator) => accelerator.device_tree(),
            Tree::OnDevice(tree, _) => tree,
        }
    }
}

impl OnGpu {
    pub(super) fn load(
        backend: WgpuBackend,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<OnGpu, TracerError> {
        let accelerator = backend.build_accelerator(mesh, options)?;
        OnGpu::with(backend, accelerator)
    }

    /// The same without blocking.
    pub(super) async fn load_async(
        backend: WgpuBackend,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<OnGpu, TracerError> {
        let accelerator = backend.build_accelerator_async(mesh, options).await?;
        OnGpu::with(backend, accelerator)
    }

    fn with(backend: WgpuBackend, accelerator: WgpuAccelerator) -> Result<OnGpu, TracerError> {
        let mut renderer = WgpuRenderer::new(backend.queries().gpu().clone())?;
        if let Some(parity) = backend.parity() {
            renderer.set_parity(parity);
        }
        Ok(OnGpu {
            #[cfg(feature = "cpu")]
            host: HostShaded::new(&backend),
            backend,
            tree: Tree::Copied(Box::new(accelerator)),
            renderer,
            keyframes: Keyframes::default(),
            building: None,
            settled: None,
            compressed: false,
        })
    }

    pub(super) fn describe(&self) -> BackendInfo {
        self.backend.describe()
    }

    pub(super) fn room(&self, shading: Shading, accuracy: Accuracy) -> Room {
        match shading {
            Shading::Gpu => self.renderer.room(accuracy),
            _ => Room::CPU,
        }
    }

    /// Who shades such frames. Without the feature `cpu` the device does, or refuses.
    pub(super) fn shading(&self, scene: &SceneData, settings: &RenderSettings) -> Shading {
        match beyond_device(scene, settings) {
            Some(_) if cfg!(feature = "cpu") => Shading::CpuWithRaysOnGpu,
            _ => Shading::Gpu,
        }
    }

    /// The same of a frame. What the host shades is done when it is asked for.
    #[cfg(feature = "cpu")]
    fn is_for_host(&mut self, input: &FrameInput<'_>) -> bool {
        let is_for_host = self.shading(input.scene, input.settings) != Shading::Gpu;
        self.host.is_last &= is_for_host;
        is_for_host
    }

    pub(super) fn rebuild(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        self.cancel();
        let built = self.backend.build_on_device(mesh, options)?;
        let tree = self.as_asked(built.tree)?;
        self.settle();
        self.take(Tree::OnDevice(Box::new(tree), built.summary));
        Ok(())
    }

    pub(super) fn rebuild_for_queries(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        self.cancel();
        let mut accelerator = self.backend.build_accelerator(mesh, options)?;
        if self.compressed {
            accelerator.compress_on_device().map_err(RenderError::from)?;
        }
        self.settle();
        self.take(Tree::Copied(Box::new(accelerator)));
        Ok(())
    }

    /// The same without blocking.
    pub(super) async fn rebuild_for_queries_async(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        self.cancel();
        let accelerator = self.backend.build_accelerator_async(mesh, options).await?;
        self.settle_async().await;
        self.take(Tree::Copied(Box::new(accelerator)));
        Ok(())
    }

    /// Lets the vertices of other scenes go.
    pub(super) fn forget_keyframes(&mut self) {
        self.keyframes.forget();
    }

    /// Submits the build of the next tree; the one that is there is left as it is.
    pub(super) fn submit_rebuild(
        &mut self,
        moved: &Moved<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        self.cancel();
        let gpu = self.backend.gpu();
        let mesh = self.keyframes.place(gpu, &moved.mesh, moved.name).map_err(BuildError::from)?;
        self.building = Some(self.backend.submit_build_from(&mesh, options)?);
        Ok(())
    }

    /// Waits for the next tree and takes it.
    pub(super) fn finish_rebuild(&mut self) -> Result<(), TracerError> {
        let Some(mut building) = self.building.take() else { return Ok(()) };
        // A frame that must be repeated needs the old tree.
        self.settle();
        let built = building.wait()?;
        let tree = self.as_asked(built.tree)?;
        self.take(Tree::OnDevice(Box::new(tree), built.summary));
        Ok(())
    }

    /// Whether trees get compressed nodes from now on, the one that is there included. It keeps those that it has.
    pub(super) fn set_compressed(&mut self, compressed: bool) -> Result<(), TracerError> {
        if compressed && !self.tree.on_device().is_compressed() {
            // A frame under way goes on with what it has bound.
            match &mut self.tree {
                Tree::Copied(accelerator) => accelerator.compress_on_device(),
                Tree::OnDevice(tree, _) => tree.compress_on_device(self.backend.queries()),
            }
            .map_err(RenderError::from)?;
        }
        self.compressed = compressed;
        Ok(())
    }

    /// A tree just built, with compressed nodes where these are asked for.
    fn as_asked(&self, mut tree: DeviceTree) -> Result<DeviceTree, TracerError> {
        if self.compressed {
            tree.compress_on_device(self.backend.queries()).map_err(RenderError::from)?;
        }
        Ok(tree)
    }

    /// The same without blocking. Compressing blocks, so the tree has no compressed nodes.
    async fn finish_rebuild_async(&mut self) -> Result<(), TracerError> {
        if self.building.is_none() {
            return Ok(());
        }
        self.settle_async().await;
        // Left in its place, so that nothing is lost where this is dropped in the middle.
        let Some(building) = &mut self.building else { return Ok(()) };
        let built = building.wait_async().await;
        self.building = None;
        let built = built?;
        self.take(Tree::OnDevice(Box::new(built.tree), built.summary));
        Ok(())
    }

    /// Nobody wants the next tree any more.
    fn cancel(&mut self) {
        if let Some(building) = self.building.take() {
            building.cancel();
        }
    }

    /// Submits a frame whose outputs come along.
    pub(super) fn submit_frame(&mut self, input: &FrameInput<'_>) -> Result<(), TracerError> {
        #[cfg(feature = "cpu")]
        if self.is_for_host(input) {
            let stats = self.frame_by_host(input)?;
            self.settled = Some(Ok(stats));
            return Ok(());
        }
        self.finish_rebuild()?;
        self.settled = None;
        Ok(self.renderer.submit_for_host(self.tree.on_device(), input)?)
    }

    /// Submits a frame into a buffer of the device.
    pub(super) fn submit_frame_into(
        &mut self,
        input: &FrameInput<'_>,
        target: &wgpu::Buffer,
    ) -> Result<(), TracerError> {
        #[cfg(feature = "cpu")]
        if self.is_for_host(input) {
            let stats = self.frame_by_host_into(input, target)?;
            self.settled = Some(Ok(stats));
            return Ok(());
        }
        self.finish_rebuild()?;
        self.settled = None;
        Ok(self.renderer.submit_into(target, self.tree.on_device(), input)?)
    }

    /// Waits for the submitted frame.
    pub(super) fn finish_frame(&mut self) -> Result<FrameStats, TracerError> {
        match self.settled.take() {
            Some(settled) => settled,
            None if self.renderer.is_pending() => Ok(self.renderer.wait()?),
            None => Err(TracerError::NothingSubmitted),
        }
    }

    /// Whether the submitted frame is done. Never waits.
    pub(super) fn is_frame_done(&mut self) -> bool {
        if self.settled.is_none() && self.renderer.is_pending() {
            self.settled = self.renderer.poll().map_err(TracerError::from).transpose();
        }
        self.settled.is_some() || !self.renderer.is_pending()
    }

    /// Waits for a frame that was submitted and not asked for yet.
    fn settle(&mut self) {
        if self.settled.is_none() && self.renderer.is_pending() {
            self.settled = Some(self.renderer.wait().map_err(TracerError::from));
        }
    }

    /// The same without blocking.
    async fn settle_async(&mut self) {
        if self.settled.is_none() && self.renderer.is_pending() {
            self.settled = Some(self.renderer.wait_async().await.map_err(TracerError::from));
        }
    }

    /// Replaces the tree; the next build gets the old one's buffers.
    fn take(&mut self, tree: Tree) {
        let old = match std::mem::replace(&mut self.tree, tree) {
            Tree::Copied(old) => old.into_device_tree(),
            Tree::OnDevice(old, _) => *old,
        };
        self.backend.recycle(old);
    }

    pub(super) fn accelerator(&self) -> Option<&dyn Accelerator> {
        match &self.tree {
            Tree::Copied(accelerator) => Some(accelerator.as_ref()),
            Tree::OnDevice(..) => None,
        }
    }

    pub(super) fn summary(&self) -> BuildSummary {
        match &self.tree {
            Tree::Copied(accelerator) => *accelerator.summary(),
            Tree::OnDevice(_, summary) => *summary,
        }
    }

    pub(super) fn tree_size(&self) -> TreeSize {
        let tree = self.tree.on_device();
        let [nodes, references] = [tree.node_count(), tree.reference_count()].map(|n| n as usize);
        TreeSize { nodes, references, bytes: tree.bytes() }
    }

    pub(super) fn digest(&self) -> Result<Digest, TracerError> {
        match &self.tree {
            Tree::Copied(accelerator) => Ok(accelerator.tree().digest()),
            Tree::OnDevice(tree, _) => {
                Ok(tree.read(self.backend.gpu()).map_err(RenderError::from)?.digest())
            }
        }
    }

    pub(super) fn frame(&mut self, input: &FrameInput<'_>) -> Result<FrameStats, TracerError> {
        #[cfg(feature = "cpu")]
        if self.is_for_host(input) {
            return self.frame_by_host(input);
        }
        self.finish_rebuild()?;
        self.settled = None;
        Ok(self.renderer.render(self.tree.on_device(), input)?)
    }

    /// The same without blocking; the outputs come along.
    pub(super) async fn frame_async(
        &mut self,
        input: &FrameInput<'_>,
    ) -> Result<FrameStats, TracerError> {
        #[cfg(feature = "cpu")]
        if self.is_for_host(input) {
            return self.frame_by_host(input);
        }
        self.finish_rebuild_async().await?;
        self.settled = None;
        Ok(self.renderer.render_for_host_async(self.tree.on_device(), input).await?)
    }

    /// With the picture in a buffer of the device.
    pub(super) fn frame_into(
        &mut self,
        input: &FrameInput<'_>,
        target: &wgpu::Buffer,
    ) -> Result<FrameStats, TracerError> {
        #[cfg(feature = "cpu")]
        if self.is_for_host(input) {
            return self.frame_by_host_into(input, target);
        }
        self.finish_rebuild()?;
        self.settled = None;
        Ok(self.renderer.render_into(target, self.tree.on_device(), input)?)
    }

    pub(super) fn limit_paths(&mut self, paths: u32) {
        self.renderer.limit_paths(paths);
    }

    /// Renders a frame that the device's kernels do not shade. A frame that was submitted before is forgotten.
    #[cfg(feature = "cpu")]
    fn frame_by_host(&mut self, input: &FrameInput<'_>) -> Result<FrameStats, TracerError> {
        self.host.is_last = false;
        self.finish_rebuild()?;
        self.renderer.forget();
        self.settled = None;
        check(self.tree.on_device(), input)?;
        if let Tree::OnDevice(tree, summary) = &self.tree {
            let copied = copied(&self.backend, (tree, *summary), &input.mesh)?;
            self.tree = Tree::Copied(Box::new(copied));
        }
        match &self.tree {
            Tree::Copied(accelerator) => self.host.frame(accelerator, input),
            Tree::OnDevice(..) => unreachable!("it was copied above"),
        }
    }

    /// The same, with the picture in a buffer of the device.
    #[cfg(feature = "cpu")]
    fn frame_by_host_into(
        &mut self,
        input: &FrameInput<'_>,
        target: &wgpu::Buffer,
    ) -> Result<FrameStats, TracerError> {
        check_target(target, input, (wgpu::BufferUsages::COPY_DST, "COPY_DST"))?;
        let stats = self.frame_by_host(input)?;
        let gpu = self.backend.gpu();
        let pixels = bytemuck::cast_slice(self.host.renderer.pixels());
        gpu.guard(|| gpu.write(target, 0, pixels)).map_err(RenderError::from)?;
        Ok(stats)
    }

    /// What has crossed between host and device.
    pub(super) fn traffic(&self) -> Traffic {
        self.backend.gpu().traffic()
    }

    pub(super) fn pixels(&self) -> Result<Cow<'_, [u32]>, TracerError> {
        #[cfg(feature = "cpu")]
        if self.host.is_last {
            return Ok(Cow::Borrowed(self.host.renderer.pixels()));
        }
        Ok(self.renderer.output(Buffer::Pixels, "picture")?)
    }

    pub(super) fn radiance(&self) -> Result<Cow<'_, [[f32; 4]]>, TracerError> {
        #[cfg(feature = "cpu")]
        if self.host.is_last {
            return Ok(Cow::Borrowed(self.host.renderer.radiance()));
        }
        Ok(self.renderer.output(Buffer::Radiance, "radiance")?)
    }

    pub(super) fn first_hits(&self) -> Result<Cow<'_, [FirstHit]>, TracerError> {
        #[cfg(feature = "cpu")]
        if self.host.is_last {
            return Ok(Cow::Borrowed(self.host.renderer.first_hits()));
        }
        Ok(self.renderer.output(Buffer::FirstHits, "record of first hits")?)
    }

    pub(super) fn first_costs(&self) -> Result<Cow<'_, [FirstCost]>, TracerError> {
        #[cfg(feature = "cpu")]
        if self.host.is_last {
            return Ok(Cow::Borrowed(self.host.renderer.first_costs()));
        }
        Ok(self.renderer.output(Buffer::FirstCosts, "record of first costs")?)
    }
}
