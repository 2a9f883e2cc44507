//! What a batch asks of the device.

use splitplane_core::kernel::QueryKernel;
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::QueryOptions;
use splitplane_shaders::TriangleTest;

use super::pipelines::test_of;

/// What a batch asks of the device.
#[derive(Clone, Copy, Debug)]
pub(super) enum Asked {
    /// A hit a ray.
    Hit(Query),
    /// The triangles that a ray may meet: their number, then those for which there is room.
    List {
        /// Words of a list; at least 1.
        room: u32,
    },
    /// How many surfaces a ray crosses for certain.
    Count {
        /// How many of them are known at most.
        room: u32,
    },
}

impl Asked {
    /// The kernels that answer, one after the other, over a tree that has compressed nodes for the test or has not.
    pub(super) fn kernels(self, compressed: bool) -> [QueryKernel; 2] {
        match self {
            Asked::Hit(query) if compressed => QueryKernel::of_compressed(query),
            Asked::Hit(query) => QueryKernel::of(query),
            Asked::List { .. } => QueryKernel::LISTING,
            Asked::Count { .. } => QueryKernel::COUNTING,
        }
    }

    /// The triangle test in the kernels.
    pub(super) fn test(self, options: &QueryOptions<'_>) -> TriangleTest {
        match self {
            Asked::Hit(_) => test_of(options),
            // They have one of their own.
            Asked::List { .. } | Asked::Count { .. } => TriangleTest::default(),
        }
    }

    /// Bytes of what the kernels write for a ray.
    pub(super) fn result_bytes(self) -> u64 {
        match self {
            Asked::Hit(query) => QueryKernel::result_bytes(query),
            Asked::List { room } => 4 * u64::from(room),
            Asked::Count { .. } => 4,
        }
    }

    /// Bytes that the kernels need for a ray besides.
    pub(super) fn scratch_bytes(self) -> u64 {
        match self {
            Asked::Hit(_) | Asked::List { .. } => 0,
            Asked::Count { room } => 4 * u64::from(room),
        }
    }

    /// What the batch's uniform says of lists.
    pub(super) fn room(self) -> u32 {
        match self {
            Asked::Hit(_) => 0,
            Asked::List { room } | Asked::Count { room } => room,
        }
    }
}
