//! The point tree of this backend.

use std::sync::Arc;

use splitplane_core::kernel::{PointQueries, PointQueryKernel};
use splitplane_core::points::build::{PointBuildError, PointOptions};
use splitplane_core::points::tree::PointTree;
use splitplane_float_state::Standard;

use super::super::pipelines::Queries;
use super::super::slices::SliceRays;
use super::build::{Built, built};
use super::device::DevicePoints;

/// A point tree on a device, and a copy in host memory. Bytes and answers are the reference's
/// ([`splitplane_core::points`]). [`WgpuBackend::points`](crate::WgpuBackend::points) makes one.
#[derive(Debug)]
pub struct WgpuPointTree<const N: usize> {
    queries: Arc<Queries>,
    tree: PointTree<N>,
    device: DevicePoints,
    slices: SliceRays,
}

impl<const N: usize> WgpuPointTree<N> {
    /// Sends a tree to the device. `max_memory` limits the bytes of both copies.
    ///
    /// # Errors
    /// [`PointBuildError::OutOfMemory`]; more points than the device can bind or hold; a device that fails.
    pub fn of(
        queries: Arc<Queries>,
        tree: PointTree<N>,
        max_memory: Option<u64>,
    ) -> Result<WgpuPointTree<N>, PointBuildError> {
        let _state = Standard::set();
        let needed = bytes(&tree);
        if let Some(limit) = max_memory.filter(|&limit| needed > limit) {
            return Err(PointBuildError::OutOfMemory { needed, limit });
        }
        let device = DevicePoints::upload(queries.gpu(), &tree)?;
        Ok(WgpuPointTree { queries, tree, device, slices: SliceRays::default() })
    }

    /// Builds the tree of points on the device, and reads it back. `max_memory` limits the bytes of the build, on the device too.
    ///
    /// # Errors
    /// See [`PointBuildError`]: more points than the device can bind or hold; a device that fails.
    pub fn build(
        queries: Arc<Queries>,
        points: &[[f32; N]],
        options: &PointOptions<'_>,
    ) -> Result<WgpuPointTree<N>, PointBuildError> {
        let _state = Standard::set();
        let Built { tree, device } = built(&queries, points, options)?;
        Ok(WgpuPointTree { queries, tree, device, slices: SliceRays::default() })
    }

    /// The tree itself.
    pub fn tree(&self) -> &PointTree<N> {
        &self.tree
    }

    /// Bytes of the tree in host memory, and of the one on the device.
    pub fn bytes(&self) -> u64 {
        bytes(&self.tree)
    }

    pub(super) fn queries(&self) -> &Queries {
        &self.queries
    }

    pub(super) fn device(&self) -> &DevicePoints {
        &self.device
    }

    pub(super) fn slices(&self) -> &SliceRays {
        &self.slices
    }
}

impl Queries {
    /// Gives a kernel of queries to points another text: for tests that plant faults.
    #[doc(hidden)]
    pub fn replace_point_kernel(&self, kernel: PointQueryKernel, source: Option<String>) {
        self.pipelines.replace::<PointQueries>(kernel, source);
    }
}

/// Bytes of a tree in both places.
fn bytes<const N: usize>(tree: &PointTree<N>) -> u64 {
    let arrays = size_of_val(tree.points()) + size_of_val(tree.indices());
    let nodes = size_of_val(tree.nodes()) + size_of_val(tree.marks());
    DevicePoints::bytes_of(tree.len()) + (arrays + nodes) as u64
}
