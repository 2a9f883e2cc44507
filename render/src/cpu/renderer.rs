//! Renders frames, one at a time, in the same memory.

use super::buffers::Buffers;
use super::executor::CpuExecutor;
use super::photons::{PhotonReport, PointTrees};
use super::traced::{ByCpu, Traced};
use crate::error::RenderError;
use crate::frame::{FrameInput, FrameStats};
use crate::kernel::Counter;
use crate::layout::{FirstCost, FirstHit};
use crate::plan::{Plan, Room};
use crate::scene_data::instances::InstanceTable;
use crate::schedule;
use splitplane_core::backend::Accelerator;
use splitplane_core::backend::scene::SceneAccelerator;
#[cfg(feature = "wgpu")]
use splitplane_wgpu::Queries;
#[cfg(feature = "wgpu")]
use std::sync::Arc;

/// Renders frames on the CPU. Work runs in the rayon pool of the calling thread; memory is kept
/// between frames and grows only when a frame needs more than all earlier ones.
#[derive(Debug)]
pub struct CpuRenderer {
    buffers: Buffers,
    room: Room,
    photons: Option<PhotonReport>,
    trees: PointTrees,
}

impl Default for CpuRenderer {
    fn default() -> CpuRenderer {
        CpuRenderer::with_room(Room::CPU)
    }
}

impl CpuRenderer {
    /// A renderer without memory yet.
    pub fn new() -> CpuRenderer {
        CpuRenderer::default()
    }

    /// A renderer whose queues have other capacities. Pictures do not depend on them.
    pub fn with_room(room: Room) -> CpuRenderer {
        CpuRenderer { buffers: Buffers::default(), room, photons: None, trees: PointTrees::Cpu }
    }

    /// Has a device build the trees of photons and look photons up in them, for frames whose rays it answers too. Shading stays on the
    /// CPU. Pictures have the same bits, where the device's parity is bitwise.
    #[cfg(feature = "wgpu")]
    pub fn with_photons_on(self, queries: Arc<Queries>) -> CpuRenderer {
        CpuRenderer { trees: PointTrees::Device(queries), ..self }
    }

    /// Renders a frame. `accelerator` must be built over the mesh of `input`; it may be a device's, which then gets the rays of
    /// each wave as a batch.
    ///
    /// # Errors
    /// Settings out of range, an appearance of another mesh, a backend that fails.
    pub fn render(
        &mut self,
        accelerator: &dyn Accelerator,
        input: &FrameInput<'_>,
    ) -> Result<FrameStats, RenderError> {
        let by_cpu = ByCpu::default();
        let stats = self.render_traced(Traced::Mesh(accelerator, Some(&by_cpu)), input)?;
        Ok(FrameStats { redone: by_cpu.redone.into_inner(), ..stats })
    }

    /// Renders a frame of a scene of instances. The mesh of `input` has the triangles of all its geometries, one after the other, its
    /// appearance is that of [`SceneData::describe_instances`](crate::SceneData::describe_instances), and `table` is up to date with
    /// the scene.
    ///
    /// # Errors
    /// As for [`CpuRenderer::render`].
    pub fn render_scene(
        &mut self,
        scene: &dyn SceneAccelerator,
        table: &InstanceTable,
        input: &FrameInput<'_>,
    ) -> Result<FrameStats, RenderError> {
        let by_cpu = ByCpu::default();
        let stats = self.render_traced(Traced::Scene(scene, table, &by_cpu), input)?;
        Ok(FrameStats { placed_by_cpu: by_cpu.placed.into_inner(), ..stats })
    }

    fn render_traced(
        &mut self,
        traced: Traced<'_>,
        input: &FrameInput<'_>,
    ) -> Result<FrameStats, RenderError> {
        let FrameInput { scene, size, settings, outputs, .. } = *input;
        let mut plan = Plan::new(scene, size, settings, outputs, self.room)?;
        loop {
            let on = (traced, &self.trees);
            let mut executor = CpuExecutor::of(*input, on, plan, &mut self.buffers)?;
            for pass in 0..settings.passes {
                executor.begin_pass(pass)?;
                schedule::pass(&mut executor, &if pass == 0 { plan } else { plan.repeated() })?;
                // The other passes would be thrown away.
                if executor.counters()[Counter::Overflow] != 0 {
                    break;
                }
            }
            schedule::finish(&mut executor, &plan)?;
            let (counters, tracing) = (*executor.counters(), executor.tracing());
            self.photons = executor.photons();
            if counters[Counter::Overflow] == 0 {
                let photon_rays = self.photons.map_or(0, |photons| photons.rays);
                let stats = FrameStats::new(plan, &counters, tracing);
                return Ok(FrameStats { photon_rays, ..stats });
            }
            plan = plan.halved().ok_or(RenderError::PixelTooDeep {
                paths: plan.path_room(),
                shadow_rays: plan.shadow_room(),
            })?;
        }
    }

    /// The pixels for a screen, from the top left: red in the low byte, green, blue, 255.
    pub fn pixels(&self) -> &[u32] {
        &self.buffers.pixels
    }

    /// Linear radiance by pixel; the fourth component is 0.
    pub fn radiance(&self) -> &[[f32; 4]] {
        &self.buffers.radiance
    }

    /// The hit of the first ray of each pixel.
    pub fn first_hits(&self) -> &[FirstHit] {
        &self.buffers.first_hits
    }

    /// The cost of the first ray of each pixel.
    pub fn first_costs(&self) -> &[FirstCost] {
        &self.buffers.first_costs
    }

    /// What became of the photons of the last frame; `None` where it needed none.
    pub fn photons(&self) -> Option<&PhotonReport> {
        self.photons.as_ref()
    }

    /// Bytes that are held between frames.
    pub fn bytes(&self) -> u64 {
        self.buffers.bytes()
    }
}
