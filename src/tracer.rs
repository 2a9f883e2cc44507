//! Triangles to pixels on one backend: trees built and rebuilt, frames made, in the same memory.

use crate::backend::{BackendKind, Engine, OpenError, OpenOptions};
use crate::scene::{Camera, Scene};
use splitplane_core::backend::{
    Accelerator, BackendInfo, BuildError, BuildOptions, BuildSummary, QueryError,
};
use splitplane_core::mesh::MeshError;
use splitplane_core::ray::QueryOptions;
use splitplane_core::watch::Watch;
use splitplane_render::layout::{FirstCost, FirstHit};
use splitplane_render::{
    AppearanceError, FrameStats, Outputs, Plan, PlanError, RenderError, RenderSettings, SceneData,
    Size,
};
#[cfg(feature = "wgpu")]
use splitplane_wgpu::wgpu::Buffer;
use std::borrow::Cow;
use thiserror::Error;

#[cfg(feature = "cpu")]
mod on_cpu;
#[cfg(feature = "wgpu")]
mod on_gpu;

/// Makes pictures of scenes on one backend. Whatever it allocates is kept and used again.
///
/// ```no_run
/// use splitplane::scene::{Placement, Scene};
/// use splitplane::tracer::{FrameRequest, Tracer};
/// use splitplane::{BackendKind, BuildOptions, OpenOptions};
///
/// let mut scene = Scene::open("builtin:spheres")?;
/// let (mut tracer, _why) = Tracer::open(BackendKind::Auto, &OpenOptions::default())?;
/// tracer.build(&scene, &BuildOptions::default())?;
/// let placement = Placement::of(&scene, tracer.accelerator()?, 16.0 / 9.0)?;
/// scene.lights = placement.lights;
/// tracer.describe_looks(&scene)?;
/// let size = splitplane::render::Size::new(1280, 720)?;
/// tracer.frame(&scene, &FrameRequest::new(&placement.camera, size))?;
/// let pixels: Vec<u32> = tracer.pixels()?.into_owned();
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Tracer {
    on: On,
    looks: SceneData,
    described: bool,
}

/// A backend with what it keeps between frames.
#[derive(Debug)]
enum On {
    #[cfg(feature = "cpu")]
    Cpu(Box<on_cpu::OnCpu>),
    #[cfg(feature = "wgpu")]
    Gpu(Box<on_gpu::OnGpu>),
}

/// Calls the same on whichever backend it is.
macro_rules! on {
    ($tracer:expr, $backend:ident => $call:expr) => {
        match $tracer {
            #[cfg(feature = "cpu")]
            On::Cpu($backend) => $call,
            #[cfg(feature = "wgpu")]
            On::Gpu($backend) => $call,
        }
    };
}

/// What is asked of a frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameRequest<'a> {
    /// From where to look.
    pub camera: &'a Camera,
    /// Size of the picture.
    pub size: Size,
    /// The knobs of speed and quality.
    pub settings: RenderSettings,
    /// What is wanted.
    pub outputs: Outputs,
    /// How rays are traced.
    pub query: QueryOptions,
}

impl<'a> FrameRequest<'a> {
    /// A picture for a screen, by default settings.
    pub fn new(camera: &'a Camera, size: Size) -> FrameRequest<'a> {
        FrameRequest {
            camera,
            size,
            settings: RenderSettings::default(),
            outputs: Outputs::PIXELS,
            query: QueryOptions::default(),
        }
    }
}

/// Why there is no frame, or no tree to make it from.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum TracerError {
    /// The scene's arrays are no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The tree cannot be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The frame cannot be made.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Nothing was built yet.
    #[error("there is no tree yet: build one before anything is traced")]
    NothingBuilt,
    /// No frame was made yet, or it was made without what is asked for.
    #[error("there is no frame yet: make one before its picture is asked for")]
    NoFrame,
    /// A picture was to go to a buffer of a GPU, but it is made on the CPU.
    #[error("the frame is made on the CPU and cannot go to a buffer of a GPU")]
    NotOnGpu,
    /// A device's driver did not follow some rays to their end.
    #[error(
        "the device's driver ended the work on {pixels} pixels before it was done; use the backend \
         `cpu`, or another device"
    )]
    Unfinished {
        /// Pixels whose light is not complete.
        pixels: usize,
    },
    /// The scene's looks were not described.
    #[error("the scene's looks are not known yet: describe them before frames are made")]
    NothingDescribed,
}

impl From<PlanError> for TracerError {
    fn from(error: PlanError) -> TracerError {
        TracerError::Render(error.into())
    }
}

impl From<AppearanceError> for TracerError {
    fn from(error: AppearanceError) -> TracerError {
        TracerError::Render(error.into())
    }
}

impl From<QueryError> for TracerError {
    fn from(error: QueryError) -> TracerError {
        TracerError::Render(error.into())
    }
}

impl Tracer {
    /// A tracer on a backend.
    pub fn new(engine: Engine) -> Tracer {
        let on = match engine {
            #[cfg(feature = "cpu")]
            Engine::Cpu(backend) => On::Cpu(Box::new(on_cpu::OnCpu::new(backend))),
            #[cfg(feature = "wgpu")]
            Engine::Wgpu(backend) => On::Gpu(Box::new(on_gpu::OnGpu::new(backend))),
        };
        Tracer { on, looks: SceneData::default(), described: false }
    }

    /// Opens a backend by name. Also gives the reason for the choice.
    ///
    /// # Errors
    /// As for [`BackendKind::open_with`].
    pub fn open(kind: BackendKind, options: &OpenOptions) -> Result<(Tracer, String), OpenError> {
        let opened = kind.open_engine(options)?;
        Ok((Tracer::new(opened.engine), opened.reason))
    }

    /// What runs the work.
    pub fn backend(&self) -> BackendInfo {
        on!(&self.on, on => on.describe())
    }

    /// Builds the tree of a scene, for frames and for queries from the host.
    ///
    /// # Errors
    /// As for [`splitplane_core::backend::Backend::build`]; the tree that was there is kept.
    pub fn build(&mut self, scene: &Scene, options: &BuildOptions) -> Result<(), TracerError> {
        let mesh = scene.mesh()?;
        on!(&mut self.on, on => on.build(&mesh, options))
    }

    /// As [`Tracer::build`], telling `watch` how far it is; `watch` may end it.
    ///
    /// # Errors
    /// As for [`splitplane_core::backend::Backend::build_watched`]; the tree that was there is kept.
    pub fn build_watched(
        &mut self,
        scene: &Scene,
        options: &BuildOptions,
        watch: &dyn Watch,
    ) -> Result<(), TracerError> {
        let mesh = scene.mesh()?;
        on!(&mut self.on, on => on.build_watched(&mesh, options, watch))
    }

    /// Builds the tree of a scene that has changed, for frames alone: on a GPU nothing but some
    /// counters comes back. The memory of the tree before is used again.
    ///
    /// # Errors
    /// As for [`Tracer::build`].
    pub fn rebuild(&mut self, scene: &Scene, options: &BuildOptions) -> Result<(), TracerError> {
        let mesh = scene.mesh()?;
        on!(&mut self.on, on => on.rebuild(&mesh, options))
    }

    /// Takes over what the scene looks like: materials, lights, normals, textures. To be called again
    /// when any of them changes.
    ///
    /// # Errors
    /// More than can be addressed.
    pub fn describe_looks(&mut self, scene: &Scene) -> Result<(), TracerError> {
        self.described = false;
        self.looks.describe_again(&scene.mesh()?, &scene.appearance())?;
        self.described = true;
        Ok(())
    }

    /// Takes over the normals of a scene whose vertices have moved; all else it looks like is as it
    /// was. Does nothing for a scene without normals.
    ///
    /// # Errors
    /// Arrays that are no mesh.
    pub fn update_normals(&mut self, scene: &Scene) -> Result<(), TracerError> {
        if self.looks.needs().smooth_normals {
            self.looks.update_normals(&scene.mesh()?, &scene.appearance());
        }
        Ok(())
    }

    /// What the scene looks like, as frames take it.
    pub fn looks(&self) -> &SceneData {
        &self.looks
    }

    /// The accelerator of the last [`Tracer::build`], for queries from the host.
    ///
    /// # Errors
    /// Nothing was built, or it was rebuilt for frames alone.
    pub fn accelerator(&self) -> Result<&dyn Accelerator, TracerError> {
        on!(&self.on, on => on.accelerator().ok_or(TracerError::NothingBuilt))
    }

    /// What the last build did with its input.
    ///
    /// # Errors
    /// Nothing was built.
    pub fn summary(&self) -> Result<BuildSummary, TracerError> {
        on!(&self.on, on => on.summary().ok_or(TracerError::NothingBuilt))
    }

    /// The name of the last tree that was built; a GPU's tree is read back for it.
    ///
    /// # Errors
    /// Nothing was built, or the device fails.
    pub fn digest(&self) -> Result<splitplane_core::digest::Digest, TracerError> {
        on!(&self.on, on => on.digest())
    }

    /// How a frame would be made: steps, queues and bytes.
    ///
    /// # Errors
    /// Looks that were not described, settings out of range, or too many lights.
    pub fn plan(&self, request: &FrameRequest<'_>) -> Result<Plan, TracerError> {
        let FrameRequest { size, settings, outputs, .. } = request;
        let room = on!(&self.on, on => on.room());
        Ok(Plan::new(self.described()?, *size, settings, *outputs, room)?)
    }

    /// Makes a frame of the scene that was built and described.
    ///
    /// # Errors
    /// Nothing was built or described, settings out of range, or a backend that fails.
    pub fn frame(
        &mut self,
        scene: &Scene,
        request: &FrameRequest<'_>,
    ) -> Result<FrameStats, TracerError> {
        self.described()?;
        let mesh = scene.mesh()?;
        let looks = &self.looks;
        on!(&mut self.on, on => on.frame(mesh, looks, request))
    }

    /// As [`Tracer::frame`] on a GPU, with the picture in a buffer of its device: one word a pixel, row by
    /// row from the top left, red in the lowest byte, then green, blue and 255. The buffer needs the
    /// usage `STORAGE`; nothing of the picture crosses to the host.
    ///
    /// # Errors
    /// As for [`Tracer::frame`]; a buffer that does not suit, or a tracer that is not on a GPU.
    #[cfg(feature = "wgpu")]
    pub fn frame_into(
        &mut self,
        scene: &Scene,
        request: &FrameRequest<'_>,
        target: &Buffer,
    ) -> Result<FrameStats, TracerError> {
        self.described()?;
        let mesh = scene.mesh()?;
        match &mut self.on {
            On::Gpu(on) => on.frame_into(mesh, &self.looks, request, target),
            On::Cpu(_) => Err(TracerError::NotOnGpu),
        }
    }

    fn described(&self) -> Result<&SceneData, TracerError> {
        if self.described { Ok(&self.looks) } else { Err(TracerError::NothingDescribed) }
    }

    /// What a screen shows of the last frame, from the top left: red in the low byte, green, blue,
    /// 255.
    ///
    /// # Errors
    /// No frame with a picture, a device that fails, or one that did not follow all rays.
    pub fn pixels(&self) -> Result<Cow<'_, [u32]>, TracerError> {
        let pixels = on!(&self.on, on => on.pixels())?;
        check_finished(pixels.iter().filter(|pixel| **pixel >> 24 == 0).count())?;
        Ok(pixels)
    }

    /// Linear radiance of the last frame that asked for it, red, green, blue, 0.
    ///
    /// # Errors
    /// As for [`Tracer::pixels`].
    pub fn radiance(&self) -> Result<Cow<'_, [[f32; 4]]>, TracerError> {
        let radiance = on!(&self.on, on => on.radiance())?;
        check_finished(radiance.iter().filter(|radiance| radiance[3] > 0.0).count())?;
        Ok(radiance)
    }

    /// What the first ray of each pixel met, of the last frame that asked for it.
    ///
    /// # Errors
    /// No such frame, or a device that fails.
    pub fn first_hits(&self) -> Result<Cow<'_, [FirstHit]>, TracerError> {
        on!(&self.on, on => on.first_hits())
    }

    /// What the traversal of the first ray of each pixel cost, of the last frame that asked for it.
    ///
    /// # Errors
    /// No such frame, or a device that fails.
    pub fn first_costs(&self) -> Result<Cow<'_, [FirstCost]>, TracerError> {
        on!(&self.on, on => on.first_costs())
    }
}

fn check_finished(unfinished: usize) -> Result<(), TracerError> {
    if unfinished > 0 { Err(TracerError::Unfinished { pixels: unfinished }) } else { Ok(()) }
}
