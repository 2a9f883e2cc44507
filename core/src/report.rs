//! The reports of backends: a description, what a build did with its input, and how a batch was
//! answered.

use crate::error::{QueryError, refused};
use alloc::string::String;
use alloc::vec::Vec;

/// Statistics about a batch.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct QueryReport {
    /// Rays of accuracy `exact`, and rays and points of the queries that are always exact, of which a device's bounds of
    /// error left something undecided. The CPU leaves none.
    pub undecided: u64,
    /// Indices of the undecided rays that have no answer, in ascending order: all of them where the
    /// options say [`Undecided::Flag`](crate::ray::Undecided), else none. Their results are
    /// undefined.
    pub flagged: Vec<usize>,
    /// Rays that a device's driver did not follow to their end. The CPU answered them.
    pub unfinished: u64,
    /// Rays or points that the CPU answered for a device alone, for whatever reason: the device left them
    /// undecided or unfinished, found more than memory may hold, or does not have the query. 0 for the CPU backend.
    pub answered_by_cpu: u64,
}

impl QueryReport {
    /// Appends the report on a part of the batch that begins at ray `first`, after all earlier
    /// parts.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] where the system has no memory for the list of flagged rays; nothing is added
    /// then.
    pub fn append(&mut self, part: QueryReport, first: usize) -> Result<(), QueryError> {
        let places = self.flagged.len() + part.flagged.len();
        let refused = |_| refused((places * size_of::<usize>()) as u64);
        self.flagged.try_reserve(part.flagged.len()).map_err(refused)?;
        self.flagged.extend(part.flagged.iter().map(|place| first + place));
        self.undecided += part.undecided;
        self.unfinished += part.unfinished;
        self.answered_by_cpu += part.answered_by_cpu;
        Ok(())
    }
}

/// A description of the backend.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct BackendInfo {
    /// `cpu`, `wgpu` or the name of an embedder's backend.
    pub name: String,
    /// The adapter, for a device; `None` on the CPU.
    pub adapter: Option<String>,
    /// Number of worker threads; `None` on a device.
    pub threads: Option<usize>,
    /// Further details for reports, such as the instruction set of the triangle test.
    pub detail: String,
}

impl BackendInfo {
    /// A backend of this name, without further information.
    pub fn new(name: impl Into<String>) -> BackendInfo {
        BackendInfo { name: name.into(), ..BackendInfo::default() }
    }
}

/// What a build did with its input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct BuildSummary {
    /// Triangles of the mesh.
    pub triangles: u32,
    /// Triangles left out: a non-finite coordinate, or two equal corners.
    pub dropped: u32,
    /// Triangles with a coordinate that was snapped to +0: -0, or less than 2^-126.
    pub snapped: u32,
    /// Levels of the large-node stage.
    pub large_levels: u32,
    /// Roots handed to the small-node stage.
    pub small_roots: u32,
    /// Most bytes that the build held at once, in addition to the caller's mesh.
    pub peak_bytes: u64,
}
