//! Frames on the cores of this machine.

use super::{FrameRequest, TracerError};
use splitplane_core::backend::{Accelerator, Backend, BackendInfo, BuildOptions, BuildSummary};
use splitplane_core::digest::Digest;
use splitplane_core::mesh::Mesh;
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_render::cpu::CpuRenderer;
use splitplane_render::layout::{FirstCost, FirstHit};
use splitplane_render::{FrameInput, FrameStats, Room, SceneData};
use std::borrow::Cow;

#[derive(Debug)]
pub(super) struct OnCpu {
    backend: CpuBackend,
    accelerator: Option<CpuAccelerator>,
    renderer: CpuRenderer,
}

impl OnCpu {
    pub(super) fn new(backend: CpuBackend) -> OnCpu {
        OnCpu { backend, accelerator: None, renderer: CpuRenderer::new() }
    }

    pub(super) fn describe(&self) -> BackendInfo {
        self.backend.describe()
    }

    pub(super) fn room(&self) -> Room {
        Room::CPU
    }

    pub(super) fn build(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        match &mut self.accelerator {
            Some(accelerator) => self.backend.rebuild_accelerator(accelerator, mesh, options)?,
            None => self.accelerator = Some(self.backend.build_accelerator(mesh, options)?),
        }
        Ok(())
    }

    pub(super) fn rebuild(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        self.build(mesh, options)
    }

    pub(super) fn accelerator(&self) -> Option<&dyn Accelerator> {
        Some(self.accelerator.as_ref()?)
    }

    pub(super) fn summary(&self) -> Option<BuildSummary> {
        self.accelerator.as_ref().map(|accelerator| *accelerator.summary())
    }

    pub(super) fn digest(&self) -> Result<Digest, TracerError> {
        let accelerator = self.accelerator.as_ref().ok_or(TracerError::NothingBuilt)?;
        Ok(accelerator.tree().digest())
    }

    pub(super) fn frame(
        &mut self,
        mesh: Mesh<'_>,
        looks: &SceneData,
        request: &FrameRequest<'_>,
    ) -> Result<FrameStats, TracerError> {
        let accelerator = self.accelerator.as_ref().ok_or(TracerError::NothingBuilt)?;
        let input = FrameInput {
            mesh,
            scene: looks,
            camera: request.camera.pinhole(request.size),
            size: request.size,
            settings: &request.settings,
            outputs: request.outputs,
            query: request.query,
        };
        Ok(self.renderer.render(accelerator, &input)?)
    }

    pub(super) fn pixels(&self) -> Result<Cow<'_, [u32]>, TracerError> {
        Ok(Cow::Borrowed(self.renderer.pixels()))
    }

    pub(super) fn radiance(&self) -> Result<Cow<'_, [[f32; 4]]>, TracerError> {
        Ok(Cow::Borrowed(self.renderer.radiance()))
    }

    pub(super) fn first_hits(&self) -> Result<Cow<'_, [FirstHit]>, TracerError> {
        Ok(Cow::Borrowed(self.renderer.first_hits()))
    }

    pub(super) fn first_costs(&self) -> Result<Cow<'_, [FirstCost]>, TracerError> {
        Ok(Cow::Borrowed(self.renderer.first_costs()))
    }
}
