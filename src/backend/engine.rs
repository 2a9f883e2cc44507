//! Backends by their concrete types, for callers that need more than the trait.

use splitplane_core::backend::Backend;

#[cfg(any(feature = "cpu", feature = "wgpu"))]
use crate::points::{AnyPointTree, PointBuildError, PointOptions};

/// One of the backends of this build.
#[derive(Debug)]
#[non_exhaustive]
pub enum Engine {
    /// The cores of this machine.
    #[cfg(feature = "cpu")]
    Cpu(splitplane_cpu::CpuBackend),
    /// A GPU.
    #[cfg(feature = "wgpu")]
    Wgpu(splitplane_wgpu::WgpuBackend),
}

impl Engine {
    /// The backend behind the trait.
    pub fn as_backend(&self) -> &dyn Backend {
        match *self {
            #[cfg(feature = "cpu")]
            Engine::Cpu(ref backend) => backend,
            #[cfg(feature = "wgpu")]
            Engine::Wgpu(ref backend) => backend,
        }
    }

    /// A tree of points, built by the backend, which answers batches of queries. Bytes and answers are the same on every backend.
    ///
    /// # Errors
    /// See [`PointBuildError`]; a GPU has limits of its own, may fail, and one that is not bitwise equal to the CPU refuses with
    /// [`PointBuildError::NotBitwise`]. Backend `auto` takes no such GPU.
    #[cfg(any(feature = "cpu", feature = "wgpu"))]
    pub fn points<const N: usize>(
        &self,
        points: &[[f32; N]],
        options: &PointOptions<'_>,
    ) -> Result<AnyPointTree<N>, PointBuildError> {
        match self {
            #[cfg(feature = "cpu")]
            Engine::Cpu(_) => {
                Ok(AnyPointTree::Cpu(splitplane_cpu::CpuPointTree::build(points, options)?))
            }
            #[cfg(feature = "wgpu")]
            Engine::Wgpu(backend) => Ok(AnyPointTree::Wgpu(backend.points(points, options)?)),
        }
    }

    /// The backend behind the trait, owned.
    pub fn into_backend(self) -> Box<dyn Backend> {
        match self {
            #[cfg(feature = "cpu")]
            Engine::Cpu(backend) => Box::new(backend),
            #[cfg(feature = "wgpu")]
            Engine::Wgpu(backend) => Box::new(backend),
        }
    }
}

#[cfg(all(feature = "render", any(feature = "cpu", feature = "wgpu")))]
impl From<Engine> for splitplane_render::tracer::RenderBackend {
    fn from(engine: Engine) -> splitplane_render::tracer::RenderBackend {
        match engine {
            #[cfg(feature = "cpu")]
            Engine::Cpu(backend) => backend.into(),
            #[cfg(feature = "wgpu")]
            Engine::Wgpu(backend) => backend.into(),
        }
    }
}

/// A backend by its own type, ready for work.
#[derive(Debug)]
pub struct OpenedEngine {
    /// The backend.
    pub engine: Engine,
    /// Why this backend was chosen, for reports.
    pub reason: String,
}
