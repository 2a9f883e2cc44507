//! Frames on a GPU.

use super::TracerError;
use crate::error::RenderError;
use crate::frame::{FrameInput, FrameStats};
use crate::layout::{FirstCost, FirstHit};
use crate::plan::Room;
use crate::wgpu::WgpuRenderer;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::report::{BackendInfo, BuildSummary};
use splitplane_core::tree::digest::Digest;
use splitplane_wgpu::{DeviceTree, WgpuAccelerator, WgpuBackend};
use std::borrow::Cow;

#[derive(Debug)]
pub(super) struct OnGpu {
    backend: WgpuBackend,
    tree: Tree,
    renderer: WgpuRenderer,
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
        let renderer = WgpuRenderer::new(backend.queries().gpu().clone())?;
        Ok(OnGpu { backend, tree: Tree::Copied(Box::new(accelerator)), renderer })
    }

    pub(super) fn describe(&self) -> BackendInfo {
        self.backend.describe()
    }

    pub(super) fn room(&self) -> Room {
        crate::wgpu::room(self.backend.gpu())
    }

    pub(super) fn rebuild(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        let built = self.backend.build_on_device(mesh, options)?;
        self.take(Tree::OnDevice(Box::new(built.tree), built.summary));
        Ok(())
    }

    pub(super) fn rebuild_for_queries(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        let accelerator = self.backend.build_accelerator(mesh, options)?;
        self.take(Tree::Copied(Box::new(accelerator)));
        Ok(())
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

    pub(super) fn digest(&self) -> Result<Digest, TracerError> {
        match &self.tree {
            Tree::Copied(accelerator) => Ok(accelerator.tree().digest()),
            Tree::OnDevice(tree, _) => {
                Ok(tree.read(self.backend.gpu()).map_err(RenderError::from)?.digest())
            }
        }
    }

    pub(super) fn frame(&mut self, input: &FrameInput<'_>) -> Result<FrameStats, TracerError> {
        Ok(self.renderer.render(self.tree.on_device(), input)?)
    }

    /// With the picture in a buffer of the device.
    pub(super) fn frame_into(
        &mut self,
        input: &FrameInput<'_>,
        target: &wgpu::Buffer,
    ) -> Result<FrameStats, TracerError> {
        Ok(self.renderer.render_into(target, self.tree.on_device(), input)?)
    }

    pub(super) fn pixels(&self) -> Result<Cow<'_, [u32]>, TracerError> {
        Ok(Cow::Owned(self.renderer.pixels()?))
    }

    pub(super) fn radiance(&self) -> Result<Cow<'_, [[f32; 4]]>, TracerError> {
        Ok(Cow::Owned(self.renderer.radiance()?))
    }

    pub(super) fn first_hits(&self) -> Result<Cow<'_, [FirstHit]>, TracerError> {
        Ok(Cow::Owned(self.renderer.first_hits()?))
    }

    pub(super) fn first_costs(&self) -> Result<Cow<'_, [FirstCost]>, TracerError> {
        Ok(Cow::Owned(self.renderer.first_costs()?))
    }
}
