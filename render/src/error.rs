//! Errors of frames.

use crate::plan::PlanError;
use crate::scene_data::AppearanceError;
use splitplane_core::error::QueryError;
use splitplane_core::points::build::PointBuildError;
use thiserror::Error;

/// Errors of frames.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The frame cannot be planned.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The scene's appearance cannot be described.
    #[error(transparent)]
    Appearance(#[from] AppearanceError),
    /// The device failed.
    #[cfg(feature = "wgpu")]
    #[error(transparent)]
    Gpu(#[from] splitplane_wgpu::GpuError),
    /// A frame of accuracy `exact` on a device whose arithmetic is not known to be the CPU's: bounds of error count on it.
    #[cfg(feature = "wgpu")]
    #[error(
        "the device's arithmetic is not known to be the CPU's, so it renders no frames of accuracy exact; take \
         backend cpu, or another accuracy"
    )]
    ExactOnDevice,
    /// A frame whose light is followed beyond direct light, or of several passes, by kernels of a device alone. A
    /// [`Tracer`](crate::tracer::Tracer) has the CPU shade those, where the feature `cpu` is on.
    #[cfg(feature = "wgpu")]
    #[error(
        "the kernels of a device shade direct light in one pass only; light by paths and photons, and more passes, are shaded by the CPU"
    )]
    LightOnDevice,
    /// An environment map, by kernels of a device alone; see [`RenderError::LightOnDevice`].
    #[cfg(feature = "wgpu")]
    #[error(
        "the kernels of a device shade no light of environment maps: the CPU does; or take an environment of three colours"
    )]
    EnvironmentMapOnDevice,
    /// The buffer for the picture is unsuitable.
    #[cfg(feature = "wgpu")]
    #[error("the buffer for the picture {reason}")]
    Target {
        /// What is wrong with it.
        reason: String,
    },
    /// The requested frame has no such output.
    #[cfg(feature = "wgpu")]
    #[error("there is no {what}: no frame was made, or it was made without")]
    NoOutput {
        /// The requested output.
        what: &'static str,
    },
    /// Rays could not be traced.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// The scene's appearance is that of another mesh.
    #[error("the appearance describes {described} triangles, but the mesh has {triangles}")]
    WrongMesh {
        /// Triangles described.
        described: u32,
        /// Triangles of the mesh.
        triangles: u32,
    },
    /// The photons of a pass need more memory than a buffer may have.
    #[error(
        "the photons of a pass that are stored, {photons} so far, need {needed} bytes, but may have {allowed}; trace fewer of them, in \
         more passes, or lower the depth"
    )]
    TooManyPhotons {
        /// Photons stored.
        photons: u64,
        /// Bytes they need.
        needed: u64,
        /// Bytes that they may have.
        allowed: u64,
    },
    /// The tree of the photons of a pass cannot be built.
    #[error("the map of photons: {0}")]
    PhotonMap(#[from] PointBuildError),
    /// The rays of a single pixel do not fit the queues.
    #[error(
        "the rays of one pixel need more room than the {paths} paths and {shadow_rays} shadow rays of a \
         wave; lower the depth or the number of samples, or raise the least weight of a path"
    )]
    PixelTooDeep {
        /// Capacity for paths.
        paths: u32,
        /// Capacity for shadow rays.
        shadow_rays: u32,
    },
}
