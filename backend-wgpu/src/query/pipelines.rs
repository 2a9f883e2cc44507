//! The queries of a device: their kernels, compiled when they are first used, and what batches share.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use splitplane_core::kernel::{QueryBuffer, QueryKernel, RayQueries};
use splitplane_core::ray::{Accuracy, QueryOptions};
use splitplane_shaders::TriangleTest;

use super::error::DeviceQueryError;
use super::slices::SliceRays;
use super::staging::StagingPool;
use crate::device::gpu::Gpu;
use crate::device::halves::{binding_limit, half};
use crate::device::kernel_set::{Bound, with_continued};
use crate::device::{DeviceSet, Pipelines, Text};
use crate::parity::Parity;

impl DeviceSet for RayQueries {
    type Variant = QueryVariant;

    fn text(kernel: QueryKernel, variant: &QueryVariant) -> Text {
        let shader = splitplane_shaders::query(kernel.name(), variant.test);
        // The table has every kernel with every test; a test of the shaders holds it to that.
        let (name, parts) = shader.map_or((kernel.name(), &[][..]), |s| (s.name, s.parts));
        Text { name, parts: parts.into() }
    }

    fn bindings(kernel: QueryKernel, variant: &QueryVariant) -> Vec<Bound<RayQueries>> {
        with_continued::<RayQueries>(kernel, |buffer| {
            variant.by_halves && buffer == QueryBuffer::Triangles
        })
    }
}

/// What the text of a query depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QueryVariant {
    /// The triangle test of kernels that trace rays.
    pub test: TriangleTest,
    /// Whether the triangles go on in a second binding.
    pub by_halves: bool,
}

/// What a binding of triangles refers to, whole or by halves.
pub(super) fn triangles_of<'a>(
    bound: &Bound<RayQueries>,
    variant: &QueryVariant,
    triangles: &'a wgpu::Buffer,
) -> wgpu::BufferBinding<'a> {
    match variant.by_halves {
        true => half(triangles, triangles.size(), bound.part == 1, 0),
        false => triangles.as_entire_buffer_binding(),
    }
}

/// The triangle test that an accuracy asks for.
pub(super) fn test_of(options: &QueryOptions<'_>) -> TriangleTest {
    match options.accuracy {
        Accuracy::Fast => TriangleTest::MoellerTrumbore,
        Accuracy::Watertight => TriangleTest::Watertight,
        _ => TriangleTest::Certain,
    }
}

/// A device with the pipelines of the queries and reusable staging memory. One serves any number
/// of trees and threads.
#[derive(Debug)]
pub struct Queries {
    gpu: Arc<Gpu>,
    pub(super) pipelines: Arc<Pipelines>,
    pub(super) staging: StagingPool,
    /// Whether bounds of error hold on the device.
    certain: AtomicBool,
    pub(super) slice_rays: SliceRays,
    /// Of queries for what is near.
    pub(super) near_slices: SliceRays,
    /// For rays on the device: the list that commands of hosts share.
    pub(super) deferred: Mutex<Option<wgpu::Buffer>>,
}

impl Queries {
    /// Queries on a device. Compiles nothing yet. Accuracy `exact` is refused until
    /// [`Queries::set_parity`] says that the device may be trusted with it; a
    /// [`WgpuBackend`](crate::WgpuBackend) that was tested has said so.
    pub fn new(gpu: Arc<Gpu>) -> Queries {
        Queries::sharing(gpu, Arc::default())
    }

    /// The same with the compiled kernels of a backend.
    pub(crate) fn sharing(gpu: Arc<Gpu>, pipelines: Arc<Pipelines>) -> Queries {
        Queries {
            gpu,
            pipelines,
            staging: StagingPool::default(),
            certain: AtomicBool::new(false),
            slice_rays: SliceRays::default(),
            near_slices: SliceRays::default(),
            deferred: Mutex::default(),
        }
    }

    /// The device.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Gives a kernel of rays another text, or its own again: for tests that plant faults.
    #[doc(hidden)]
    pub fn replace_kernel(&self, kernel: QueryKernel, source: Option<String>) {
        self.pipelines.replace::<RayQueries>(kernel, source);
    }

    /// The kernels' variant for a triangle test and for triangles in this buffer.
    pub(super) fn variant(&self, test: TriangleTest, triangles: &wgpu::Buffer) -> QueryVariant {
        QueryVariant { test, by_halves: triangles.size() > binding_limit(self.gpu.limits()).0 }
    }

    /// Whether bounds of error hold on the device, so that it may answer exact hits: only after a
    /// self-test found that it rounds as the CPU does.
    pub fn is_certain(&self) -> bool {
        self.certain.load(Ordering::Relaxed)
    }

    /// Sets what a self-test found about the device. With [`Parity::Bitwise`] it may answer exact
    /// hits.
    pub fn set_parity(&self, parity: &Parity) {
        self.certain.store(parity.is_bitwise(), Ordering::Relaxed);
    }

    /// Refuses accuracy `exact` on a device whose arithmetic was not tested, or failed the test.
    pub(super) fn may_answer(&self, options: &QueryOptions<'_>) -> Result<(), DeviceQueryError> {
        if options.accuracy == Accuracy::Exact && !self.is_certain() {
            return Err(DeviceQueryError::Uncertain);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use splitplane_core::query::traverse::Query;

    use super::*;

    #[test]
    fn every_kernel_has_its_text() {
        for (query, accuracy, names) in [
            (Query::Closest, Accuracy::Watertight, ["closest_hit", "closest_hit_retry"]),
            (Query::Closest, Accuracy::Fast, ["closest_hit_fast", "closest_hit_retry_fast"]),
            (Query::Closest, Accuracy::Exact, ["closest_hit_exact", "closest_hit_retry_exact"]),
            (Query::Any, Accuracy::Watertight, ["any_hit", "any_hit_retry"]),
            (Query::Any, Accuracy::Fast, ["any_hit_fast", "any_hit_retry_fast"]),
            (Query::Any, Accuracy::Exact, ["any_hit_exact", "any_hit_retry_exact"]),
        ] {
            let test = test_of(&QueryOptions { accuracy, ..QueryOptions::default() });
            for (kernel, name) in QueryKernel::of(query).into_iter().zip(names) {
                let text = RayQueries::text(kernel, &QueryVariant { test, by_halves: false });
                assert_eq!(text.name, name);
                assert!(!text.parts.is_empty());
            }
        }
        // Every shader of a query is the text of a kernel, and every kernel has one.
        let tests =
            [TriangleTest::Watertight, TriangleTest::MoellerTrumbore, TriangleTest::Certain];
        let mut reached = BTreeSet::new();
        for kernel in QueryKernel::ALL {
            let plain = RayQueries::text(kernel, &QueryVariant::default());
            assert!(!plain.parts.is_empty(), "{}", plain.name);
            let texts = tests
                .map(|test| RayQueries::text(kernel, &QueryVariant { test, by_halves: false }));
            reached.extend(
                texts.into_iter().filter(|text| !text.parts.is_empty()).map(|text| text.name),
            );
        }
        let all: BTreeSet<_> =
            splitplane_shaders::QUERIES.iter().map(|shader| shader.name).collect();
        assert_eq!(reached, all);
    }
}
