//! Settings of queries of a scene, and their reports.

use super::hit::{InstanceId, SceneHit};
use crate::error::QueryError;
use crate::ray::{Accuracy, Culling, QueryOptions};
use crate::report::QueryReport;
use crate::watch::Watch;
use core::fmt;

/// Decides which hits count.
///
/// It must be pure: for the same hit always the same answer, whoever asks and how often. A hit that it rejects counts as not
/// there, so among hits at the same `t` the least (instance, triangle) that it keeps is the answer. If it is not pure,
/// nothing is promised but that the query ends.
pub trait Filter: Sync {
    /// Whether a hit counts.
    fn keeps(&self, hit: &SceneHit) -> bool;
}

/// A closure is a filter.
impl<F: Fn(&SceneHit) -> bool + Sync> Filter for F {
    fn keeps(&self, hit: &SceneHit) -> bool {
        self(hit)
    }
}

impl fmt::Debug for dyn Filter + '_ {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a filter")
    }
}

/// A triangle of one instance, or a primitive of its shapes, which a query is to ignore.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IgnoredTriangle {
    /// The instance.
    pub instance: InstanceId,
    /// The triangle, by its index in the geometry's mesh.
    pub triangle: u32,
}

/// Settings of queries of a scene.
#[derive(Clone, Copy, Debug)]
pub struct SceneOptions<'a> {
    /// Which triangle test answers, in the object's space. Exact means: for the ray as it stands there.
    pub accuracy: Accuracy,
    /// Which side to ignore as seen in the world, besides what instances ignore.
    pub culling: Culling,
    /// Instances answer when a bit of theirs is in this mask.
    pub mask: u32,
    /// A triangle that all rays of the call ignore.
    pub ignore: Option<IgnoredTriangle>,
    /// Decides on the CPU which hits count; `None`: all do.
    pub filter: Option<&'a dyn Filter>,
    /// Receives the number of rays that are done, and may cancel the batch; `None` for no watch.
    pub watch: Option<&'a dyn Watch>,
}

impl Default for SceneOptions<'_> {
    /// Watertight, nothing ignored.
    fn default() -> Self {
        SceneOptions {
            accuracy: Accuracy::default(),
            culling: Culling::None,
            mask: u32::MAX,
            ignore: None,
            filter: None,
            watch: None,
        }
    }
}

impl<'a> SceneOptions<'a> {
    /// The settings for a geometry's own query.
    #[inline]
    pub fn of_geometry(
        &self,
        culling: Culling,
        ignore: Option<u32>,
        watch: Option<&'a dyn Watch>,
    ) -> QueryOptions<'a> {
        QueryOptions { accuracy: self.accuracy, culling, ignore, watch, ..QueryOptions::default() }
    }
}

/// How a batch of rays of a scene was answered.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct SceneReport {
    /// Sums over all batches that geometries answered. A ray counts once in each instance that it enters.
    pub geometries: QueryReport,
    /// Instances entered, by all rays together. Where a scene has one, the CPU backend counts each ray that can hit anything.
    pub entered: u64,
    /// Batches that geometries answered; 0 where the CPU backend followed each ray from instance to instance.
    pub batches: u64,
    /// Rays whose instances the CPU found for a device. 0 for the CPU backend, and where a device finds them itself.
    pub placed_by_cpu: u64,
    /// Hits that a filter or an opacity mask rejected. One may be shown again, where several leaves name its triangle, and
    /// counts each time. What opacity masks reject on a device that answers rays by itself is not counted: 0 there.
    pub rejected: u64,
}

impl SceneReport {
    /// Adds the report on another part of the batch.
    ///
    /// # Errors
    /// As for [`QueryReport::append`].
    pub fn add(&mut self, part: SceneReport) -> Result<(), QueryError> {
        self.geometries.append(part.geometries, 0)?;
        self.entered += part.entered;
        self.batches += part.batches;
        self.placed_by_cpu += part.placed_by_cpu;
        self.rejected += part.rejected;
        Ok(())
    }
}
