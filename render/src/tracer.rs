//! From triangles to pixels on one backend: builds and rebuilds trees and renders frames, in the
//! same memory.

mod error;
mod frame;
#[cfg(all(feature = "cpu", feature = "wgpu"))]
mod host_shaded;
mod moved;
#[cfg(feature = "cpu")]
mod of_instances;
#[cfg(feature = "cpu")]
mod on_cpu;
#[cfg(feature = "wgpu")]
mod on_gpu;
mod output;
mod shading;
mod tree_size;
#[cfg(all(feature = "cpu", feature = "wgpu"))]
mod trial;

pub use error::TracerError;
pub use frame::{Frame, FrameRequest};
pub use moved::Moved;
#[cfg(feature = "cpu")]
pub use of_instances::{InstanceTracer, InstancedLook, ShownUpdate};
pub use output::Output;
pub use shading::Shading;
pub use tree_size::TreeSize;
#[cfg(all(feature = "cpu", feature = "wgpu"))]
pub use trial::RayTrial;

use crate::frame::FrameInput;
use crate::plan::Plan;
use crate::scene_data::{Appearance, SceneData};
use crate::settings::RenderSettings;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::report::{BackendInfo, BuildSummary};
use splitplane_core::tree::digest::Digest;
use splitplane_float_state::Standard;

/// A backend that a [`Tracer`] can use, by its concrete type.
#[derive(Debug)]
#[non_exhaustive]
pub enum RenderBackend {
    /// The cores of this machine.
    #[cfg(feature = "cpu")]
    Cpu(splitplane_cpu::CpuBackend),
    /// A GPU.
    #[cfg(feature = "wgpu")]
    Wgpu(splitplane_wgpu::WgpuBackend),
}

impl RenderBackend {
    /// The backend for builds and queries.
    pub fn as_backend(&self) -> &dyn Backend {
        match self {
            #[cfg(feature = "cpu")]
            RenderBackend::Cpu(backend) => backend,
            #[cfg(feature = "wgpu")]
            RenderBackend::Wgpu(backend) => backend,
        }
    }
}

#[cfg(feature = "cpu")]
impl From<splitplane_cpu::CpuBackend> for RenderBackend {
    fn from(backend: splitplane_cpu::CpuBackend) -> RenderBackend {
        RenderBackend::Cpu(backend)
    }
}

#[cfg(feature = "wgpu")]
impl From<splitplane_wgpu::WgpuBackend> for RenderBackend {
    fn from(backend: splitplane_wgpu::WgpuBackend) -> RenderBackend {
        RenderBackend::Wgpu(backend)
    }
}

/// Renders frames of a scene on one backend. It always has a tree and an appearance; its memory is
/// kept and reused.
///
#[cfg_attr(feature = "cpu", doc = "```")]
#[cfg_attr(not(feature = "cpu"), doc = "```ignore")]
/// use splitplane_core::backend::BuildOptions;
/// use splitplane_core::mesh::Mesh;
/// use splitplane_cpu::CpuBackend;
/// use splitplane_render::tracer::{FrameRequest, Tracer};
/// use splitplane_render::{Appearance, Pinhole, Size};
///
/// let positions = [[0.0, 0.0, -2.0], [1.0, 0.0, -2.0], [0.0, 1.0, -2.0]];
/// let mesh = Mesh::indexed(&positions, &[[0, 1, 2]])?;
/// let options = BuildOptions::default();
/// let mut tracer = Tracer::load(CpuBackend::new(), &mesh, &Appearance::default(), &options)?;
///
/// // From the origin along -z, 4 by 4 pixels, each half as wide as it is away.
/// let camera = Pinhole {
///     eye: [0.0; 3],
///     corner: [-1.0, 1.0, -1.0],
///     step_x: [0.5, 0.0, 0.0],
///     step_y: [0.0, -0.5, 0.0],
/// };
/// let frame = tracer.frame(&mesh, &FrameRequest::new(camera, Size::new(4, 4)?))?;
/// assert_eq!(frame.stats().paths, 16);
/// assert_eq!(frame.pixels()?.len(), 16);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Tracer {
    on: On,
    appearance: SceneData,
}

/// A backend with its tree, and the memory that it keeps between frames.
#[derive(Debug)]
enum On {
    #[cfg(feature = "cpu")]
    Cpu(Box<on_cpu::OnCpu>),
    #[cfg(feature = "wgpu")]
    Gpu(Box<on_gpu::OnGpu>),
}

/// Calls the same method on either backend.
macro_rules! on {
    ($on:expr, $backend:ident => $call:expr) => {
        match $on {
            #[cfg(feature = "cpu")]
            On::Cpu($backend) => $call,
            #[cfg(feature = "wgpu")]
            On::Gpu($backend) => $call,
        }
    };
}
use on;

impl Tracer {
    /// Builds the tree of a scene, for frames and for queries from the host, and takes over its appearance.
    ///
    /// # Errors
    /// As for [`splitplane_core::backend::Backend::build`]; an appearance that cannot be addressed.
    pub fn load(
        backend: impl Into<RenderBackend>,
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Tracer, TracerError> {
        let _state = Standard::set();
        SceneData::check(mesh, appearance)?;
        let on = match backend.into() {
            #[cfg(feature = "cpu")]
            RenderBackend::Cpu(backend) => {
                On::Cpu(Box::new(on_cpu::OnCpu::load(backend, mesh, options)?))
            }
            #[cfg(feature = "wgpu")]
            RenderBackend::Wgpu(backend) => {
                On::Gpu(Box::new(on_gpu::OnGpu::load(backend, mesh, options)?))
            }
        };
        Ok(Tracer { on, appearance: SceneData::new(mesh, appearance)? })
    }

    /// As [`Tracer::load`], without blocking while a GPU builds. On the CPU the tree is built at once.
    ///
    /// # Errors
    /// As for [`Tracer::load`].
    #[cfg(feature = "wgpu")]
    pub async fn load_async(
        backend: impl Into<RenderBackend>,
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Tracer, TracerError> {
        SceneData::check(mesh, appearance)?;
        let on = match backend.into() {
            #[cfg(feature = "cpu")]
            RenderBackend::Cpu(backend) => {
                On::Cpu(Box::new(on_cpu::OnCpu::load(backend, mesh, options)?))
            }
            RenderBackend::Wgpu(backend) => {
                On::Gpu(Box::new(on_gpu::OnGpu::load_async(backend, mesh, options).await?))
            }
        };
        Ok(Tracer { on, appearance: SceneData::new(mesh, appearance)? })
    }

    /// As [`Tracer::replace`], without blocking while a GPU builds.
    ///
    /// # Errors
    /// As for [`Tracer::replace`]; the previous scene is kept.
    #[cfg(feature = "wgpu")]
    pub async fn replace_async(
        &mut self,
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        SceneData::check(mesh, appearance)?;
        match &mut self.on {
            On::Gpu(on) => on.rebuild_for_queries_async(mesh, options).await?,
            #[cfg(feature = "cpu")]
            On::Cpu(on) => on.rebuild_for_queries(mesh, options)?,
        }
        on!(&mut self.on, on => on.forget_keyframes());
        Ok(self.appearance.describe_again(mesh, appearance)?)
    }

    /// Takes another scene, in the memory of the one before: its tree, for frames and for queries from the
    /// host, and its appearance.
    ///
    /// # Errors
    /// As for [`Tracer::load`]; the previous scene is kept.
    pub fn replace(
        &mut self,
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        let _state = Standard::set();
        SceneData::check(mesh, appearance)?;
        self.rebuild_for_queries(mesh, options)?;
        on!(&mut self.on, on => on.forget_keyframes());
        Ok(self.appearance.describe_again(mesh, appearance)?)
    }

    /// Builds the tree anew after vertices have moved. On a GPU the tree stays there: nothing but some
    /// counters comes back, and [`Tracer::accelerator`] has nothing until [`Tracer::replace`] or
    /// [`Tracer::rebuild_for_queries`].
    ///
    /// # Errors
    /// As for [`splitplane_core::backend::Backend::build`]; the previous tree is kept.
    pub fn rebuild(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        let _state = Standard::set();
        on!(&mut self.on, on => on.rebuild(mesh, options))
    }

    /// As [`Tracer::rebuild`], with the tree in host memory too: [`Tracer::accelerator`] has it.
    ///
    /// # Errors
    /// As for [`Tracer::rebuild`].
    pub fn rebuild_for_queries(
        &mut self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        let _state = Standard::set();
        on!(&mut self.on, on => on.rebuild_for_queries(mesh, options))
    }

    /// Submits the build of a tree over vertices that have moved. On a GPU it returns at once: the tree that is
    /// there goes on answering, also for a frame that was submitted before, and [`Tracer::finish_rebuild`] or the
    /// next frame takes the new one. Vertices and indices that are on the device already are not sent again. A
    /// build that was submitted before and not taken is cancelled. The options' watch is not called.
    ///
    /// On the CPU the tree is built before this returns.
    ///
    /// # Errors
    /// As for [`Tracer::rebuild`].
    pub fn submit_rebuild(
        &mut self,
        moved: &Moved<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        let _state = Standard::set();
        on!(&mut self.on, on => on.submit_rebuild(moved, options))
    }

    /// Waits for the tree that was submitted, and for a frame that still needs the old one, and takes the tree.
    /// Does nothing when none is under way.
    ///
    /// # Errors
    /// As for [`Tracer::rebuild`].
    pub fn finish_rebuild(&mut self) -> Result<(), TracerError> {
        let _state = Standard::set();
        on!(&mut self.on, on => on.finish_rebuild())
    }

    /// Takes over another appearance: materials, lights, normals, textures. `mesh` is the one that
    /// the next frame shows.
    ///
    /// # Errors
    /// More than can be addressed; the previous appearance is kept.
    pub fn update_appearance(
        &mut self,
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
    ) -> Result<(), TracerError> {
        let _state = Standard::set();
        Ok(self.appearance.describe_again(mesh, appearance)?)
    }

    /// Takes over the normals of a scene whose vertices have moved; the rest of its appearance stays. Does
    /// nothing for a scene without normals.
    pub fn update_normals(&mut self, mesh: &Mesh<'_>, appearance: &Appearance<'_>) {
        let _state = Standard::set();
        self.appearance.update_normals(mesh, appearance);
    }

    /// The appearance of the scene, as frames take it.
    pub fn appearance(&self) -> &SceneData {
        &self.appearance
    }

    /// A description of the backend.
    pub fn backend(&self) -> BackendInfo {
        on!(&self.on, on => on.describe())
    }

    /// The tree for queries from the host. `None` only on a GPU, when [`Tracer::rebuild`] has left the last
    /// tree there and no frame that the CPU shades has read it back.
    pub fn accelerator(&self) -> Option<&dyn Accelerator> {
        on!(&self.on, on => on.accelerator())
    }

    /// What the last build did with its input.
    pub fn summary(&self) -> BuildSummary {
        on!(&self.on, on => on.summary())
    }

    /// How large the last tree is; nothing is read back for it.
    pub fn tree_size(&self) -> TreeSize {
        on!(&self.on, on => on.tree_size())
    }

    /// The name of the last tree; one that is on a GPU alone is read back for it.
    ///
    /// # Errors
    /// A device that fails.
    pub fn digest(&self) -> Result<Digest, TracerError> {
        on!(&self.on, on => on.digest())
    }

    /// What has crossed between host and device so far, and how many buffers were made; `None` on the CPU.
    #[cfg(feature = "wgpu")]
    pub fn traffic(&self) -> Option<splitplane_wgpu::Traffic> {
        match &self.on {
            On::Gpu(on) => Some(on.traffic()),
            #[cfg(feature = "cpu")]
            On::Cpu(_) => None,
        }
    }

    /// Limits the paths of a wave on a GPU, for less memory; pictures do not depend on it. Does nothing on the CPU.
    #[cfg(feature = "wgpu")]
    pub fn limit_paths(&mut self, paths: u32) {
        match &mut self.on {
            On::Gpu(on) => on.limit_paths(paths),
            #[cfg(feature = "cpu")]
            On::Cpu(_) => {}
        }
    }

    /// Where frames of these settings are shaded, and where their rays are traced. On a GPU the CPU shades what the GPU's kernels do
    /// not, where the feature `cpu` is on.
    pub fn shading(&self, settings: &RenderSettings) -> Shading {
        on!(&self.on, on => on.shading(&self.appearance, settings))
    }

    /// Whether trees on a GPU get compressed wide nodes from now on, the tree that is there included: frames of accuracy
    /// `watertight` then go through these, with the same pictures, bit for bit. The device makes them after each build, for which
    /// a call waits once more; 32 bytes come back. Where coordinates leave the range of lean kernels there are none, nor in trees that
    /// were awaited without blocking. Does nothing on the CPU.
    ///
    /// # Errors
    /// More references than such nodes can name, or a device that fails; the choice is then what it was.
    #[cfg(feature = "wgpu")]
    pub fn set_compressed(&mut self, compressed: bool) -> Result<(), TracerError> {
        match &mut self.on {
            On::Gpu(on) => on.set_compressed(compressed),
            #[cfg(feature = "cpu")]
            On::Cpu(_) => Ok(()),
        }
    }

    /// How a frame would be rendered: steps, queues and bytes.
    ///
    /// # Errors
    /// Settings out of range, too many lights, or a scene or picture that does not fit a buffer.
    pub fn plan(&self, request: &FrameRequest<'_>) -> Result<Plan, TracerError> {
        let _state = Standard::set();
        let FrameRequest { size, settings, outputs, query, .. } = request;
        let shading = self.shading(settings);
        let room = on!(&self.on, on => on.room(shading, query.accuracy));
        Ok(Plan::new(&self.appearance, *size, settings, *outputs, room)?)
    }

    /// Renders a frame. `mesh` is the one over which the tree was last built.
    ///
    /// # Errors
    /// Settings out of range, a mesh with other triangles than the tree or the appearance, or a backend that fails.
    pub fn frame(
        &mut self,
        mesh: &Mesh<'_>,
        request: &FrameRequest<'_>,
    ) -> Result<Frame<'_>, TracerError> {
        let _state = Standard::set();
        let input = input(mesh, &self.appearance, request);
        let stats = on!(&mut self.on, on => on.frame(&input))?;
        Ok(Frame { on: &self.on, stats })
    }

    /// As [`Tracer::frame`], without blocking while a GPU works: its outputs come along, and the [`Frame`] waits for nothing. Between the waves of a
    /// frame of accuracy `exact` the CPU answers what the device left undecided, on this thread and its pool. A frame that the CPU shades ([`Tracer::shading`]) blocks,
    /// which a browser refuses ([`GpuError::CannotBlock`](splitplane_wgpu::GpuError::CannotBlock)). On the CPU the frame is rendered at once. Dropped before its end, it leaves the tracer as it is.
    ///
    /// # Errors
    /// As for [`Tracer::frame`].
    #[cfg(feature = "wgpu")]
    pub async fn frame_async(
        &mut self,
        mesh: &Mesh<'_>,
        request: &FrameRequest<'_>,
    ) -> Result<Frame<'_>, TracerError> {
        let input = input(mesh, &self.appearance, request);
        let stats = match &mut self.on {
            On::Gpu(on) => on.frame_async(&input).await?,
            #[cfg(feature = "cpu")]
            On::Cpu(on) => on.frame(&input)?,
        };
        Ok(Frame { on: &self.on, stats })
    }

    /// Submits a frame of the tree that was built or submitted last; [`Tracer::finish_frame`] has it. On a GPU
    /// this returns when that tree is there, and the outputs come back together with the counters, in one round
    /// trip. The next tree may be submitted meanwhile. A frame that was submitted before is forgotten. A frame of accuracy `exact`
    /// waits for the device between its waves, and so does this.
    ///
    /// On the CPU, and where the CPU shades ([`Tracer::shading`]), the frame is rendered before this returns.
    ///
    /// # Errors
    /// As for [`Tracer::frame`].
    pub fn submit_frame(
        &mut self,
        mesh: &Mesh<'_>,
        request: &FrameRequest<'_>,
    ) -> Result<(), TracerError> {
        let _state = Standard::set();
        let input = input(mesh, &self.appearance, request);
        on!(&mut self.on, on => on.submit_frame(&input))
    }

    /// As [`Tracer::submit_frame`] on a GPU, into a buffer as for [`Tracer::frame_into`].
    ///
    /// # Errors
    /// As for [`Tracer::frame_into`].
    #[cfg(feature = "wgpu")]
    pub fn submit_frame_into(
        &mut self,
        mesh: &Mesh<'_>,
        request: &FrameRequest<'_>,
        target: &wgpu::Buffer,
    ) -> Result<(), TracerError> {
        let _state = Standard::set();
        let input = input(mesh, &self.appearance, request);
        match &mut self.on {
            On::Gpu(on) => on.submit_frame_into(&input, target),
            #[cfg(feature = "cpu")]
            On::Cpu(_) => Err(TracerError::NotOnGpu),
        }
    }

    /// Whether [`Tracer::finish_frame`] would return at once. Never waits.
    pub fn is_frame_done(&mut self) -> bool {
        on!(&mut self.on, on => on.is_frame_done())
    }

    /// Waits for the frame that was submitted.
    ///
    /// # Errors
    /// As for [`Tracer::frame`]; no frame was submitted, or it was given already.
    pub fn finish_frame(&mut self) -> Result<Frame<'_>, TracerError> {
        let _state = Standard::set();
        let stats = on!(&mut self.on, on => on.finish_frame())?;
        Ok(Frame { on: &self.on, stats })
    }

    /// As [`Tracer::frame`] on a GPU, with the picture in a buffer of its device: one word per
    /// pixel, row by row from the top left, red in the lowest byte, then green, blue and 255. The
    /// buffer needs the usage `STORAGE`, and `COPY_SRC` for [`Frame::pixels`]; nothing of the
    /// picture crosses to the host before that. Pictures that the CPU shades ([`Tracer::shading`]) are copied into it: for those it needs
    /// `COPY_DST` alone.
    ///
    /// # Errors
    /// As for [`Tracer::frame`]; an unsuitable buffer, or a tracer that is not on a GPU.
    #[cfg(feature = "wgpu")]
    pub fn frame_into(
        &mut self,
        mesh: &Mesh<'_>,
        request: &FrameRequest<'_>,
        target: &wgpu::Buffer,
    ) -> Result<Frame<'_>, TracerError> {
        let _state = Standard::set();
        let input = input(mesh, &self.appearance, request);
        let stats = match &mut self.on {
            On::Gpu(on) => on.frame_into(&input, target)?,
            #[cfg(feature = "cpu")]
            On::Cpu(_) => return Err(TracerError::NotOnGpu),
        };
        Ok(Frame { on: &self.on, stats })
    }
}

fn input<'a>(
    mesh: &Mesh<'a>,
    scene: &'a SceneData,
    request: &'a FrameRequest<'a>,
) -> FrameInput<'a> {
    let FrameRequest { camera, size, settings, outputs, query } = request;
    let (camera, size, outputs, query) = (*camera, *size, *outputs, *query);
    FrameInput { mesh: *mesh, scene, camera, size, settings, outputs, query }
}
