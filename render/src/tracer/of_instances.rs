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
use splitplane_core::scene::{Changes, Edits, Scene};
use splitplane_float_state::Standard;
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
    appearance: SceneData,
    renderer: CpuRenderer,
    /// Up to which edits table and appearance are up to date; `None` after an error between the two.
    edits: Option<Edits>,
    written: ShownUpdate,
}

/// What the last load or update of an [`InstanceTracer`] made anew of what frames read, besides what its report says of the scene itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ShownUpdate {
    /// Rows of instances that were written: of those that were edited, or whose material is another.
    /// All rows, where the description does not know what was edited, or a geometry is elsewhere among the triangles of all.
    pub rows_written: u32,
    /// Whether the triangles and shapes that shine were searched for in all instances. They are where one that changed, or whose geometry has other arrays, shines or shone, since the
    /// probability of each depends on all.
    pub emitters_searched: bool,
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
        let _state = Standard::set();
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
        let edits = Some(scene.edits());
        let written = ShownUpdate { rows_written: table.len() as u32, emitters_searched: true };
        Ok(InstanceTracer { backend, built, table, appearance, renderer, edits, written })
    }

    /// Brings what answers rays up to date with the description. Only what changed is made anew: see
    /// [`Backend::update_scene`](splitplane_core::backend::Backend::update_scene). Of the look it takes where the triangles of geometries are, the materials of instances,
    /// and, of instances that changed, which triangles shine; [`InstanceTracer::update_appearance`] takes all of it.
    /// [`InstanceTracer::last_update`] says what of this was written.
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
        let _state = Standard::set();
        let report = self.backend.as_backend().update_scene(&mut *self.built, scene, options)?;
        // After an error below, the next update takes nothing for known.
        let edits = self.edits.take();
        let edited = edits.as_ref().map_or(Changes::Unknown, |edits| scene.changes_since(edits));
        let InstancedLook { mesh, appearance, geometries } = look;
        let built = self.built.scene();
        let triangles = mesh.len() as u32;
        let (lines, changed) = self.table.changed(built, geometries, triangles, edited)?;
        // Which triangles shine, and how much, depends on where they are and on which are there: on what was as on what is.
        let needs_emitters = |data: &SceneData, table: &InstanceTable| {
            data.needs_emitters_of(mesh, appearance, table, &changed)
        };
        let shone = needs_emitters(&self.appearance, &self.table);
        let rows_written = self.table.write(built, geometries, lines, &changed);
        let emitters_searched = shone || needs_emitters(&self.appearance, &self.table);
        if emitters_searched {
            self.appearance.update_emitters(mesh, appearance, &self.table)?;
        }
        self.edits = Some(scene.edits());
        self.written = ShownUpdate { rows_written, emitters_searched };
        Ok(report)
    }

    /// Takes over another appearance.
    ///
    /// # Errors
    /// More than can be addressed; the previous appearance is kept.
    pub fn update_appearance(&mut self, look: &InstancedLook<'_>) -> Result<(), TracerError> {
        let _state = Standard::set();
        let InstancedLook { mesh, appearance, .. } = look;
        Ok(self.appearance.describe_instances(mesh, appearance, &self.table)?)
    }

    /// What the last load or update wrote of what frames read.
    pub fn last_update(&self) -> ShownUpdate {
        self.written
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
        let _state = Standard::set();
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
        let _state = Standard::set();
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
