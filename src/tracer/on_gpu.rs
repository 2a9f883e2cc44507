//! Frames on a GPU.

use super::{FrameRequest, TracerError};
use splitplane_core::backend::{Accelerator, Backend, BackendInfo, BuildOptions, BuildSummary};
use splitplane_core::digest::Digest;
use splitplane_core::mesh::Mesh;
use splitplane_core::watch::Watch;
use splitplane_render::layout::{FirstCost, FirstHit};
use splitplane_render::wgpu::WgpuRenderer;
use splitplane_render::{FrameInput, FrameStats, RenderError, Room, SceneData};
use splitplane_wgpu::wgpu::Buffer;
use splitplane_wgpu::{DeviceTree, WgpuAccelerator, WgpuBackend};
use std::borrow::Cow;

#[derive(Debug)]
pub(super) struct OnGpu {
    backend: WgpuBackend,
    tree: Option<Tree>,
    /// Opened with the first frame.
    renderer: Option<WgpuRenderer>,
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
    pub(super) fn new(backend: WgpuBackend) -> OnGpu {
        OnGpu { backend, tree: None, renderer: None }
    }

    pub(super) fn describe(&self) -> BackendInfo {
        self.backend.describe()
    }

    pub(super) fn room(&self) -> Room {
        splitplane_render::wgpu::room(self.backend.gpu())
    }

    pub(super) fn build(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
    ) -> Result<(), TracerError> {
        let accelerator = self.backend.build_accelerator(mesh, options)?;
        self.replace(Tree::Copied(Box::new(accelerator)));
        Ok(())
    }

    pub(super) fn build_watched(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
        watch: &dyn Watch,
    ) -> Result<(), TracerError> {
        let accelerator = self.backend.build_accelerator_watched(mesh, options, watch)?;
        self.replace(Tree::Copied(Box::new(accelerator)));
        Ok(())
    }

    pub(super) fn rebuild(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
    ) -> Result<(), TracerError> {
        let built = self.backend.build_on_device(mesh, options)?;
        self.replace(Tree::OnDevice(Box::new(built.tree), built.summary));
        Ok(())
    }

    /// Takes a tree in place of another, whose buffers the next build gets.
    fn replace(&mut self, tree: Tree) {
        if let Some(Tree::OnDevice(old, _)) = self.tree.replace(tree) {
            self.backend.recycle(*old);
        }
    }

    pub(super) fn accelerator(&self) -> Option<&dyn Accelerator> {
        match self.tree.as_ref()? {
            Tree::Copied(accelerator) => Some(accelerator.as_ref()),
            Tree::OnDevice(..) => None,
        }
    }

    pub(super) fn summary(&self) -> Option<BuildSummary> {
        match self.tree.as_ref()? {
            Tree::Copied(accelerator) => Some(*accelerator.summary()),
            Tree::OnDevice(_, summary) => Some(*summary),
        }
    }

    pub(super) fn digest(&self) -> Result<Digest, TracerError> {
        match self.tree.as_ref().ok_or(TracerError::NothingBuilt)? {
            Tree::Copied(accelerator) => Ok(accelerator.tree().digest()),
            Tree::OnDevice(tree, _) => {
                Ok(tree.read(self.backend.gpu()).map_err(RenderError::from)?.digest())
            }
        }
    }

    pub(super) fn frame(
        &mut self,
        mesh: Mesh<'_>,
        looks: &SceneData,
        request: &FrameRequest<'_>,
    ) -> Result<FrameStats, TracerError> {
        let (renderer, tree) = self.ready()?;
        Ok(renderer.render(tree.on_device(), &input(mesh, looks, request))?)
    }

    /// With the picture in a buffer of the device.
    #[cfg(feature = "wgpu")]
    pub(super) fn frame_into(
        &mut self,
        mesh: Mesh<'_>,
        looks: &SceneData,
        request: &FrameRequest<'_>,
        target: &Buffer,
    ) -> Result<FrameStats, TracerError> {
        let (renderer, tree) = self.ready()?;
        Ok(renderer.render_into(target, tree.on_device(), &input(mesh, looks, request))?)
    }

    /// What makes frames, and of what.
    fn ready(&mut self) -> Result<(&mut WgpuRenderer, &Tree), TracerError> {
        let tree = self.tree.as_ref().ok_or(TracerError::NothingBuilt)?;
        if self.renderer.is_none() {
            self.renderer = Some(WgpuRenderer::new(self.backend.queries().gpu().clone())?);
        }
        let renderer = self.renderer.as_mut().ok_or(TracerError::NoFrame)?;
        Ok((renderer, tree))
    }

    fn renderer(&self) -> Result<&WgpuRenderer, TracerError> {
        self.renderer.as_ref().ok_or(TracerError::NoFrame)
    }

    pub(super) fn pixels(&self) -> Result<Cow<'_, [u32]>, TracerError> {
        Ok(Cow::Owned(self.renderer()?.pixels()?))
    }

    pub(super) fn radiance(&self) -> Result<Cow<'_, [[f32; 4]]>, TracerError> {
        Ok(Cow::Owned(self.renderer()?.radiance()?))
    }

    pub(super) fn first_hits(&self) -> Result<Cow<'_, [FirstHit]>, TracerError> {
        Ok(Cow::Owned(self.renderer()?.first_hits()?))
    }

    pub(super) fn first_costs(&self) -> Result<Cow<'_, [FirstCost]>, TracerError> {
        Ok(Cow::Owned(self.renderer()?.first_costs()?))
    }
}

fn input<'a>(
    mesh: Mesh<'a>,
    looks: &'a SceneData,
    request: &'a FrameRequest<'_>,
) -> FrameInput<'a> {
    FrameInput {
        mesh,
        scene: looks,
        camera: request.camera.pinhole(request.size),
        size: request.size,
        settings: &request.settings,
        outputs: request.outputs,
        query: request.query,
    }
}
