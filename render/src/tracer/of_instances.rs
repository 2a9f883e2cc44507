//! Frames of a scene of instances: rays through its geometries' trees on the backend, shading on the cores of this machine.

use super::{FrameRequest, RenderBackend, Shading, TracerError};
use crate::cpu::CpuRenderer;
use crate::frame::{FrameInput, FrameStats};
use crate::layout::{FirstCost, FirstHit};
use crate::plan::{Plan, Room};
use crate::scene_data::instances::{Geometries, InstanceTable};
use crate::scene_data::{Appearance, SceneData};
use splitplane_core::backend::BuildOptions;
use splitplane_core::backend::scene::{SceneAccelerator, UpdateReport};
use splitplane_core::mesh::Mesh;
use splitplane_core::report::BackendInfo;
use splitplane_core::scene::{Edits, Scene};
#[cfg(feature = "wgpu")]
use std::sync::Arc;

/// What a scene of instances looks like, borrowed.
#[derive(Clone, Copy, Debug)]
pub struct InstancedLook<'a> {
    /// The triangles of all geometries, one geometry after the other.
    pub mesh: Mesh<'a>,
    /// Their appearance, and lights in the world.
    pub appearance: Appearance<'a>,
    /// Which of them are whose, and materials of instances.
    pub geometries: Geometries<'a>,
}

/// Renders frames of a scene of instances. What answers its rays is kept and brought up to date: an update remakes only what changed.
///
/// On a GPU that can hold the scene its rays are traced there, and photons looked up; the CPU shades. Frames
/// are equal on all backends, bit for bit, in accuracies watertight and exact.
pub struct InstanceTracer {
    backend: RenderBackend,
    built: Box<dyn SceneAccelerator>,
    table: InstanceTable,
    /// The place in the description's edits that the table shows.
    shown: Edits,
    rows_written: u64,
    appearance: SceneData,
    renderer: CpuRenderer,
}

impl core::fmt::Debug for InstanceTracer {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("InstanceTracer")
            .field("instances", &self.table.len())
            .finish_non_exhaustive()
    }
}

impl InstanceTracer {
    /// Builds a scene and takes over what it looks like.
    ///
    /// # Errors
    /// A scene that cannot be built; an appearance that cannot be addressed, or that lacks a geometry.
    pub fn load(
        backend: impl Into<RenderBackend>,
        scene: &Scene,
        look: &InstancedLook<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<InstanceTracer, TracerError> {
        let backend = backend.into();
        let built = backend.as_backend().build_scene(scene, options)?;
        let triangles = look.mesh.len() as u32;
        let table = InstanceTable::new(built.scene(), &look.geometries, triangles)?;
        let mut appearance = SceneData::default();
        appearance.describe_instances(&look.mesh, &look.appearance, &table)?;
        let renderer = match &backend {
            #[cfg(feature = "wgpu")]
            RenderBackend::Wgpu(device) => {
                CpuRenderer::new().with_photons_on(Arc::clone(device.queries()))
            }
            RenderBackend::Cpu(_) => CpuRenderer::new(),
        };
        let (shown, rows_written) = (scene.edits(), table.len() as u64);
        Ok(InstanceTracer { backend, built, table, shown, rows_written, appearance, renderer })
    }

    /// Brings what answers rays up to date with the description. Only what changed is made anew: see
    /// [`Backend::update_scene`](splitplane_core::backend::Backend::update_scene). Of the look it takes where the triangles of geometries are, the materials of instances,
    /// and which triangles shine; [`InstanceTracer::update_appearance`] takes all of it.
    ///
    /// # Errors
    /// As for [`InstanceTracer::load`]. A scene that cannot be built leaves the old one; after another error, repeat the call
    /// with what can be shown.
    pub fn update(
        &mut self,
        scene: &Scene,
        look: &InstancedLook<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, TracerError> {
        let report = self.backend.as_backend().update_scene(&mut *self.built, scene, options)?;
        let changes = scene.changes_since(&self.shown);
        let (built, triangles) = (self.built.scene(), look.mesh.len() as u32);
        self.rows_written =
            self.table.update_changed(built, &look.geometries, triangles, changes)?;
        self.shown = scene.edits();
        // Which triangles shine, and how much, depends on where they are and on which are there.
        self.appearance.update_emitters(&look.mesh, &look.appearance, &self.table)?;
        Ok(report)
    }

    /// Takes over another appearance.
    ///
    /// # Errors
    /// More than can be addressed; the previous appearance is kept.
    pub fn update_appearance(&mut self, look: &InstancedLook<'_>) -> Result<(), TracerError> {
        let InstancedLook { mesh, appearance, .. } = look;
        Ok(self.appearance.describe_instances(mesh, appearance, &self.table)?)
    }

    /// How many instances the last update took over for shading, or the load: those that changed, and all of them where the numbers of a geometry's triangles changed or it is not known what did.
    pub fn rows_written(&self) -> u64 {
        self.rows_written
    }

    /// What answers rays.
    pub fn scene(&self) -> &dyn SceneAccelerator {
        &*self.built
    }

    /// The appearance, as frames take it.
    pub fn appearance(&self) -> &SceneData {
        &self.appearance
    }

    /// A description of the backend.
    pub fn backend(&self) -> BackendInfo {
        self.backend.as_backend().describe()
    }

    /// Where frames are shaded, and where their rays are traced.
    pub fn shading(&self) -> Shading {
        match &self.backend {
            #[cfg(feature = "wgpu")]
            RenderBackend::Wgpu(_) => Shading::CpuWithRaysOnGpu,
            RenderBackend::Cpu(_) => Shading::Cpu,
        }
    }

    /// How a frame would be rendered: steps, queues and bytes.
    ///
    /// # Errors
    /// Settings out of range, too many lights, or a scene or picture that does not fit a buffer.
    pub fn plan(&self, request: &FrameRequest<'_>) -> Result<Plan, TracerError> {
        let FrameRequest { size, settings, outputs, .. } = request;
        Ok(Plan::new(&self.appearance, *size, settings, *outputs, Room::CPU)?)
    }

    /// Renders a frame. `mesh` has the triangles of all geometries, as for [`InstanceTracer::load`].
    ///
    /// # Errors
    /// Settings out of range, or a backend that fails.
    pub fn frame(
        &mut self,
        mesh: &Mesh<'_>,
        request: &FrameRequest<'_>,
    ) -> Result<FrameStats, TracerError> {
        let FrameRequest { camera, size, settings, outputs, query } = request;
        let (camera, size, outputs, query) = (*camera, *size, *outputs, *query);
        let scene = &self.appearance;
        let input = FrameInput { mesh: *mesh, scene, camera, size, settings, outputs, query };
        Ok(self.renderer.render_scene(&*self.built, &self.table, &input)?)
    }

    /// The pixels of the last frame for a screen, row by row from the top left: red in the lowest byte, then green, blue and 255.
    /// Empty when they were not requested.
    pub fn pixels(&self) -> &[u32] {
        self.renderer.pixels()
    }

    /// Linear radiance of the last frame by pixel: red, green, blue, 0.
    pub fn radiance(&self) -> &[[f32; 4]] {
        self.renderer.radiance()
    }

    /// The cost of the first ray of each pixel of the last frame, as [`BuiltScene::cost_of`](splitplane_core::backend::scene::BuiltScene::cost_of)
    /// counts it. Empty when they were not requested.
    pub fn first_costs(&self) -> &[FirstCost] {
        self.renderer.first_costs()
    }

    /// The hit of the first ray of each pixel of the last frame; its triangle is that of a geometry. Empty when they were not requested.
    pub fn first_hits(&self) -> &[FirstHit] {
        self.renderer.first_hits()
    }
}
