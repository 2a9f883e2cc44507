//! Backends by their concrete types, for callers that need more than the trait.

use splitplane_core::backend::scene::{SceneAccelerator, UpdateReport};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions};
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::report::BackendInfo;
use splitplane_core::scene::file::SceneFile;
use splitplane_core::scene::{Scene, SceneBuildError};
use splitplane_core::tree::KdTree;

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

/// The backend itself, so that what keeps one behind an `Arc`, as lazy scenes do, can share it with its owner. Every call is handed on.
impl Backend for Engine {
    fn describe(&self) -> BackendInfo {
        self.as_backend().describe()
    }

    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        self.as_backend().build(mesh, options)
    }

    fn rebuild(
        &self,
        accelerator: &mut Box<dyn Accelerator>,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), BuildError> {
        self.as_backend().rebuild(accelerator, mesh, options)
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        self.as_backend().load(mesh, tree, options)
    }

    fn build_scene(
        &self,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn SceneAccelerator>, SceneBuildError> {
        self.as_backend().build_scene(scene, options)
    }

    fn update_scene(
        &self,
        built: &mut dyn SceneAccelerator,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        self.as_backend().update_scene(built, scene, options)
    }

    fn answers_own_shapes(&self) -> bool {
        self.as_backend().answers_own_shapes()
    }

    fn check_shapes(&self, scene: &Scene) -> Result<(), SceneBuildError> {
        self.as_backend().check_shapes(scene)
    }

    fn load_scene(
        &self,
        file: &SceneFile<'_>,
        options: &LoadOptions<'_>,
    ) -> Result<(Scene, Box<dyn SceneAccelerator>), SceneBuildError> {
        self.as_backend().load_scene(file, options)
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
