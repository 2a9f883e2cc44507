//! Scenes that are built: their hits, and a backend that says how often it builds.

use core::sync::atomic::AtomicUsize;
use core::sync::atomic::Ordering::Relaxed;

use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions};
use splitplane_core::error::{BuildError, DeviceError};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::report::BackendInfo;
use splitplane_core::scene::{SceneHit, SceneOptions};
use splitplane_core::tree::KdTree;

/// Closest hits of a batch, some of which are asked for one by one too.
///
/// # Panics
/// If the batch fails, or a ray by itself has another hit.
pub fn traced(accelerator: &dyn SceneAccelerator, rays: &[Ray]) -> Vec<SceneHit> {
    let (mut hits, options) = (vec![SceneHit::MISS; rays.len()], SceneOptions::default());
    accelerator.closest_hits(rays, &mut hits, &options).expect("hits");
    for (ray, hit) in rays.iter().zip(&hits).step_by(7) {
        assert_eq!(accelerator.closest_hit(ray, &options), hit.some());
    }
    hits
}

/// Hits by their bits: zeros of either sign are equal, but not the same.
pub fn bits(hits: &[SceneHit]) -> Vec<[u32; 6]> {
    let words = |hit: &SceneHit| {
        let SceneHit { t, u, v, triangle, geometry, instance } = *hit;
        [t.to_bits(), u.to_bits(), v.to_bits(), triangle, geometry, instance]
    };
    hits.iter().map(words).collect()
}

/// [`traced`] by [`bits`].
///
/// # Panics
/// As there.
pub fn traced_bits(accelerator: &dyn SceneAccelerator, rays: &[Ray]) -> Vec<[u32; 6]> {
    bits(&traced(accelerator, rays))
}

/// A backend that counts its builds, and fails at one of them.
pub struct CountingBackend<B> {
    inner: B,
    builds: AtomicUsize,
    fails_at: AtomicUsize,
}

impl<B> CountingBackend<B> {
    /// One that never fails.
    pub fn new(inner: B) -> CountingBackend<B> {
        let (builds, fails_at) = (AtomicUsize::new(0), AtomicUsize::new(usize::MAX));
        CountingBackend { inner, builds, fails_at }
    }

    /// Counts from 0 again, and fails at the build of this number; `usize::MAX` for none.
    pub fn fail_at(&self, build: usize) {
        self.builds.store(0, Relaxed);
        self.fails_at.store(build, Relaxed);
    }

    /// Builds so far, with the one that failed.
    pub fn builds(&self) -> usize {
        self.builds.load(Relaxed)
    }

    /// Builds so far; from now on they are counted from 0.
    pub fn take_builds(&self) -> usize {
        self.builds.swap(0, Relaxed)
    }
}

impl<B: Backend> Backend for CountingBackend<B> {
    fn describe(&self) -> BackendInfo {
        BackendInfo::new("counting")
    }

    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        if self.builds.fetch_add(1, Relaxed) == self.fails_at.load(Relaxed) {
            return Err(BuildError::Device(DeviceError::Failed("planted".into())));
        }
        self.inner.build(mesh, options)
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        self.inner.load(mesh, tree, options)
    }
}
