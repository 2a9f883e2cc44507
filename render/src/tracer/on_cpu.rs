//! Frames on the cores of this machine.

use super::{Moved, Shading, TracerError, TreeSize};
use crate::cpu::CpuRenderer;
use crate::frame::{FrameInput, FrameStats};
use crate::layout::{FirstCost, FirstHit};
use crate::plan::Room;
use crate::scene_data::SceneData;
use crate::settings::RenderSettings;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Accuracy;
use splitplane_core::report::{BackendInfo, BuildSummary};
use splitplane_core::tree::digest::Digest;
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use std::borrow::Cow;

#[derive(Debug)]
pub(super) struct OnCpu {
    backend: CpuBackend,
    accelerator: CpuAccelerator,
    renderer: CpuRenderer,
    /// A frame that was submitted and not asked for yet.
    submitted: Option<FrameStats>,
}

impl OnCpu {
    pub(super) fn load(
        backend: CpuBackend,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<OnCpu, TracerError> {
        let accelerator = backend.build_accelerator(mesh, options)?;
        Ok(OnCpu { backend, accelerator, renderer: CpuRenderer::new(), submitted: None })
    }

    pub(super) fn describe(&self) -> BackendInfo {
        self.backend.describe()
    }

    pub(super) fn room(&self, _shading: Shading, _accuracy: Accuracy) -> Room {
        Room::CPU
    }

    pub(super) fn shading(&self, _scene: &SceneData, _settings: &RenderSettings) -> Shading {
        Shading::Cpu
    }

    pub(super) fn rebuild(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        Ok(self.backend.rebuild_accelerator(&mut self.accelerator, mesh, options)?)
    }

    pub(super) fn rebuild_for_queries(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        self.rebuild(mesh, options)
    }

    pub(super) fn accelerator(&self) -> Option<&dyn Accelerator> {
        Some(&self.accelerator)
    }

    pub(super) fn summary(&self) -> BuildSummary {
        *self.accelerator.summary()
    }

    pub(super) fn tree_size(&self) -> TreeSize {
        let tree = self.accelerator.tree();
        let bytes = self.accelerator.query_bytes();
        TreeSize { nodes: tree.nodes.len(), references: tree.references.len(), bytes }
    }

    pub(super) fn digest(&self) -> Result<Digest, TracerError> {
        Ok(self.accelerator.tree().digest())
    }

    pub(super) fn frame(&mut self, input: &FrameInput<'_>) -> Result<FrameStats, TracerError> {
        self.submitted = None;
        Ok(self.renderer.render(&self.accelerator, input)?)
    }

    /// The cores do one thing after the other: a tree is built when it is asked for.
    pub(super) fn submit_rebuild(
        &mut self,
        moved: &Moved<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        self.rebuild(&moved.mesh, options)
    }

    pub(super) fn finish_rebuild(&mut self) -> Result<(), TracerError> {
        Ok(())
    }

    pub(super) fn forget_keyframes(&mut self) {}

    /// A frame too is rendered when it is asked for. Its outputs stay where they are until the next one.
    pub(super) fn submit_frame(&mut self, input: &FrameInput<'_>) -> Result<(), TracerError> {
        self.submitted = Some(self.frame(input)?);
        Ok(())
    }

    pub(super) fn finish_frame(&mut self) -> Result<FrameStats, TracerError> {
        self.submitted.take().ok_or(TracerError::NothingSubmitted)
    }

    pub(super) fn is_frame_done(&mut self) -> bool {
        true
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
