//! Frames of a mesh whose rays a device traces, in batches, and which the cores of this machine shade.

use super::TracerError;
use crate::cpu::CpuRenderer;
use crate::error::RenderError;
use crate::frame::{FrameInput, FrameStats};
use rayon::prelude::*;
use splitplane_core::error::refused;
use splitplane_core::mesh::Mesh;
use splitplane_core::report::BuildSummary;
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_float_state::standard;
use splitplane_wgpu::{DeviceTree, WgpuAccelerator, WgpuBackend};
use std::sync::Arc;

/// What shades them. Its memory is kept between frames.
#[derive(Debug)]
pub(super) struct HostShaded {
    pub(super) renderer: CpuRenderer,
    /// Whether the last frame was one of these.
    pub(super) is_last: bool,
}

impl HostShaded {
    pub(super) fn new(backend: &WgpuBackend) -> HostShaded {
        let renderer = CpuRenderer::new().with_photons_on(Arc::clone(backend.queries()));
        HostShaded { renderer, is_last: false }
    }

    pub(super) fn frame(
        &mut self,
        accelerator: &WgpuAccelerator,
        input: &FrameInput<'_>,
    ) -> Result<FrameStats, TracerError> {
        let stats = self.renderer.render(accelerator, input)?;
        self.is_last = true;
        Ok(stats)
    }
}

/// Refuses a mesh that has another number of triangles than its appearance or its tree.
///
/// # Errors
/// [`RenderError::WrongMesh`].
pub(super) fn check(tree: &DeviceTree, input: &FrameInput<'_>) -> Result<(), RenderError> {
    let described = input.scene.triangles();
    let counts = [input.mesh.len() as u32, tree.triangle_count()];
    match counts.into_iter().find(|own| *own != described) {
        Some(triangles) => Err(RenderError::WrongMesh { described, triangles }),
        None => Ok(()),
    }
}

/// A tree that is on the device alone, with a copy in host memory: batches have rays that the host answers.
///
/// # Errors
/// A device that fails, or no memory.
pub(super) fn copied(
    backend: &WgpuBackend,
    (tree, summary): (&DeviceTree, BuildSummary),
    mesh: &Mesh<'_>,
) -> Result<WgpuAccelerator, RenderError> {
    let copy = tree.read(backend.gpu())?;
    let mut corners: Vec<Triangle> = Vec::new();
    let bytes = (mesh.len() * size_of::<Triangle>()) as u64;
    corners.try_reserve_exact(mesh.len()).map_err(|_| refused(bytes))?;
    let prepared = (0..mesh.len()).into_par_iter().with_min_len(4096);
    corners.par_extend(prepared.map(|i| standard(|| prepare(&mesh.triangle(i)).corners)));
    let queries = Arc::clone(backend.queries());
    Ok(WgpuAccelerator::new(queries, tree.clone(), copy, corners, summary))
}
