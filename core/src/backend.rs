//! The seam between backends: object-safe traits at batch level.

use crate::all_hits::{AllHits, check_bytes, refused};
use crate::config::{BuildConfig, ConfigError, Preset};
use crate::inside::{self, Located};
use crate::mesh::Mesh;
use crate::ray::{Hit, QueryOptions, Ray};
use crate::tree::KdTree;
use crate::watch::{Progress, Stage, Watch};
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use thiserror::Error;

/// Builds trees and the structures that answer rays through them. Whoever embeds the core may bring
/// a backend of their own.
pub trait Backend: Send + Sync {
    /// What runs the work, in words and names fit for a report.
    fn describe(&self) -> BackendInfo;

    /// Builds the tree and whatever a query needs besides.
    ///
    /// # Errors
    /// A configuration out of range, or a limit that binds.
    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
    ) -> Result<Box<dyn Accelerator>, BuildError>;

    /// As [`Backend::build`], telling `watch` how far it is; `watch` may end it.
    ///
    /// A backend that leaves this as it is asks `watch` before and after the build only.
    ///
    /// # Errors
    /// As for [`Backend::build`], and [`BuildError::Cancelled`].
    fn build_watched(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
        watch: &dyn Watch,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        let total = mesh.len() as u64;
        go_on(watch, Progress { stage: Stage::Start, done: 0, total })?;
        let built = self.build(mesh, options)?;
        go_on(watch, Progress { stage: Stage::Layout, done: total, total })?;
        Ok(built)
    }

    /// Makes an accelerator from a tree built earlier, over the same mesh.
    ///
    /// # Errors
    /// A tree that does not belong to this mesh, or a limit that binds.
    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &BuildOptions,
    ) -> Result<Box<dyn Accelerator>, BuildError>;

    /// As [`Backend::load`], telling `watch` how far it is; `watch` may end it.
    ///
    /// A backend that leaves this as it is asks `watch` before and after only.
    ///
    /// # Errors
    /// As for [`Backend::load`], and [`BuildError::Cancelled`].
    fn load_watched(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &BuildOptions,
        watch: &dyn Watch,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        let total = mesh.len() as u64;
        go_on(watch, Progress { stage: Stage::Start, done: 0, total })?;
        let loaded = self.load(mesh, tree, options)?;
        go_on(watch, Progress { stage: Stage::Layout, done: total, total })?;
        Ok(loaded)
    }
}

/// Asks whether to go on with a build.
///
/// # Errors
/// [`BuildError::Cancelled`] where the watch ends it.
#[inline]
pub fn go_on(watch: &dyn Watch, progress: Progress) -> Result<(), BuildError> {
    if watch.progress(&progress).is_break() {
        return Err(BuildError::Cancelled { progress });
    }
    Ok(())
}

/// Asks whether to go on with a batch of rays.
///
/// # Errors
/// [`QueryError::Cancelled`] where the watch ends it.
#[inline]
pub fn go_on_tracing(watch: &dyn Watch, done: u64, total: u64) -> Result<(), QueryError> {
    if watch.progress(&Progress { stage: Stage::Rays, done, total }).is_break() {
        return Err(QueryError::Cancelled { done, total });
    }
    Ok(())
}

/// What is to be known of the answers to a batch besides the answers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct QueryReport {
    /// Rays of accuracy `exact` that a device's bounds of error left undecided. The CPU leaves none.
    pub undecided: u64,
    /// Of those the ones without an answer, by their place in the batch, in ascending order: all of
    /// them where the options say [`Undecided::Flag`](crate::ray::Undecided), else none. What stands in
    /// their place is not to be used.
    pub flagged: Vec<usize>,
    /// Rays that a device's driver did not follow to their end and that the CPU answered instead.
    pub unfinished: u64,
}

/// A built tree, ready for rays. Answers do not depend on the order of rays or the thread count.
pub trait Accelerator: Send + Sync {
    /// The canonical tree: the bytes the digest names.
    fn tree(&self) -> &KdTree;

    /// What the build dropped, changed and took.
    fn summary(&self) -> &BuildSummary;

    /// Bytes of everything a query reads: nodes, references, vertices or copies of them.
    fn query_bytes(&self) -> u64;

    /// The hit of least `(t, triangle)` of every ray; [`Hit::MISS`] where there is none.
    ///
    /// # Errors
    /// `rays` and `hits` of different length.
    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions,
    ) -> Result<QueryReport, QueryError>;

    /// For every ray, whether it hits anything.
    ///
    /// # Errors
    /// `rays` and `occluded` of different length.
    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions,
    ) -> Result<QueryReport, QueryError>;

    /// As [`Accelerator::closest_hits`], telling `watch` how far it is; `watch` may end it. What `hits`
    /// then holds is not to be used.
    ///
    /// An accelerator that leaves this as it is asks `watch` between slices of 65,536 rays.
    ///
    /// # Errors
    /// As for [`Accelerator::closest_hits`], and [`QueryError::Cancelled`].
    fn closest_hits_watched(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions,
        watch: &dyn Watch,
    ) -> Result<QueryReport, QueryError> {
        in_slices(rays, hits, watch, |rays, hits| self.closest_hits(rays, hits, options))
    }

    /// As [`Accelerator::any_hits`], telling `watch` how far it is; `watch` may end it. What `occluded`
    /// then holds is not to be used.
    ///
    /// An accelerator that leaves this as it is asks `watch` between slices of 65,536 rays.
    ///
    /// # Errors
    /// As for [`Accelerator::any_hits`], and [`QueryError::Cancelled`].
    fn any_hits_watched(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions,
        watch: &dyn Watch,
    ) -> Result<QueryReport, QueryError> {
        in_slices(rays, occluded, watch, |rays, occluded| self.any_hits(rays, occluded, options))
    }

    /// All crossings of every ray with surfaces between its limits, in order along it: see
    /// [`crate::all_hits`]. They are exact whatever accuracy the options name.
    ///
    /// # Errors
    /// More memory than [`QueryOptions::max_memory`] allows, or than the system has; a device that fails.
    fn all_hits(&self, rays: &[Ray], options: &QueryOptions) -> Result<AllHits, QueryError>;

    /// As [`Accelerator::all_hits`], telling `watch` how far it is; `watch` may end it.
    ///
    /// An accelerator that leaves this as it is asks `watch` between slices of 4,096 rays.
    ///
    /// # Errors
    /// As for [`Accelerator::all_hits`], and [`QueryError::Cancelled`].
    fn all_hits_watched(
        &self,
        rays: &[Ray],
        options: &QueryOptions,
        watch: &dyn Watch,
    ) -> Result<AllHits, QueryError> {
        let total = rays.len() as u64;
        let mut all = AllHits::none();
        for (slice, rays) in rays.chunks(1 << 12).enumerate() {
            go_on_tracing(watch, (slice << 12) as u64, total)?;
            let room = options.max_memory.map(|limit| limit.saturating_sub(all.bytes()));
            let part = self.all_hits(rays, &QueryOptions { max_memory: room, ..*options });
            let part = part.map_err(|error| error.beside(all.bytes(), options.max_memory))?;
            check_bytes(all.bytes() + part.bytes() + all.growth(&part), options)?;
            all.append(part)?;
        }
        go_on_tracing(watch, total, total)?;
        Ok(all)
    }

    /// Where points lie to the surface that the triangles make: see [`crate::inside`].
    ///
    /// # Errors
    /// More memory than the system has; a device that fails.
    fn locate(&self, points: &[[f32; 3]]) -> Result<Located, QueryError> {
        self.locate_watched(points, None, &())
    }

    /// As [`Accelerator::locate`], telling `watch` how many points are done; `watch` may end it, between points
    /// and within one. `max_memory` is the most bytes that the answer and what it is put together from
    /// may take; `None` for no limit.
    ///
    /// # Errors
    /// As for [`Accelerator::locate`], [`QueryError::OutOfMemory`] and [`QueryError::Cancelled`].
    fn locate_watched(
        &self,
        points: &[[f32; 3]],
        max_memory: Option<u64>,
        watch: &dyn Watch,
    ) -> Result<Located, QueryError> {
        inside::locate_along(self, points, inside::DIRECTION, max_memory, watch)
    }

    /// Rays of batches that a device's driver did not follow to their end and that the CPU answered
    /// instead, so far. 0 for whoever answers all.
    fn answered_by_cpu(&self) -> u64 {
        0
    }

    /// The closest hit of a single ray.
    fn closest_hit(&self, ray: &Ray, options: &QueryOptions) -> Option<Hit>;

    /// Whether a single ray hits anything.
    fn any_hit(&self, ray: &Ray, options: &QueryOptions) -> bool;
}

/// Rays between two looks at the watch.
const SLICE: usize = 1 << 16;

/// Answers a batch in slices and asks the watch between them.
fn in_slices<T>(
    rays: &[Ray],
    results: &mut [T],
    watch: &dyn Watch,
    mut answer: impl FnMut(&[Ray], &mut [T]) -> Result<QueryReport, QueryError>,
) -> Result<QueryReport, QueryError> {
    let total = rays.len();
    if total != results.len() {
        return Err(QueryError::LengthMismatch { rays: total, results: results.len() });
    }
    let mut all = QueryReport::default();
    let mut done = 0;
    for (rays, results) in rays.chunks(SLICE).zip(results.chunks_mut(SLICE)) {
        go_on_tracing(watch, done as u64, total as u64)?;
        all.append(answer(rays, results)?, done)?;
        done += rays.len();
    }
    go_on_tracing(watch, done as u64, total as u64)?;
    Ok(all)
}

impl QueryReport {
    /// Adds the report on a part of the batch that begins at ray `first`, behind all parts before.
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
        Ok(())
    }
}

/// Who does the work.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackendInfo {
    /// `cpu`, `wgpu` or the name of an embedder's backend.
    pub name: String,
    /// The adapter, for a device; `None` on the CPU.
    pub adapter: Option<String>,
    /// Threads that share the work; `None` for a device.
    pub threads: Option<usize>,
    /// What else a reader of a report should know, such as the instruction set of the triangle test.
    pub detail: String,
}

/// How to build: the configuration that shapes the tree, and limits that only end in errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuildOptions {
    /// What shapes the tree.
    pub config: BuildConfig,
    /// Most bytes that the build's buffers, the tree and the query layout may hold at once besides the
    /// caller's mesh; `None` for no limit.
    pub max_memory: Option<u64>,
    /// What queries read: speed or little memory. Hits do not depend on it, bit for bit, nor does the tree.
    pub layout: QueryLayout,
}

impl From<BuildConfig> for BuildOptions {
    fn from(config: BuildConfig) -> BuildOptions {
        BuildOptions { config, ..BuildOptions::default() }
    }
}

/// How a backend lays out nodes and triangles for queries. The CPU has both layouts; backends with one
/// layout, such as wgpu, ignore the choice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum QueryLayout {
    /// Leaves have copies of their triangles' corners, side by side as the triangle test reads them.
    #[default]
    Fast,
    /// Leaves name their triangles, whose corners are read from one indexed copy of the mesh: a third
    /// to a half of the memory, and slower rays. A mesh without indices takes 36 bytes a triangle.
    Compact,
}

impl QueryLayout {
    /// Both, the default first.
    pub const ALL: [QueryLayout; 2] = [QueryLayout::Fast, QueryLayout::Compact];

    /// The name in options and reports.
    pub const fn name(self) -> &'static str {
        match self {
            QueryLayout::Fast => "fast",
            QueryLayout::Compact => "compact",
        }
    }
}

/// What a build did with its input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
    /// Most bytes the build held at once besides the caller's mesh.
    pub peak_bytes: u64,
}

/// Why a build did not give a tree.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum BuildError {
    /// The configuration is out of range.
    #[error("the build configuration is invalid: {0}")]
    Config(#[from] ConfigError),
    /// The build would hold more memory than allowed, or than the system has.
    #[error("{}", Lack { needed: *needed, limit: *limit })]
    OutOfMemory {
        /// Bytes needed at the point where it stopped; where the system refused more, those held.
        needed: u64,
        /// The limit; where the system refused more, as many as are `needed`.
        limit: u64,
    },
    /// The watch ended the build.
    #[error(
        "cancelled in the {} ({} of {} done)",
        progress.stage.name(), progress.done, Amount(progress.total)
    )]
    Cancelled {
        /// How far it had come.
        progress: Progress,
    },
    /// A preset that the schedule's kernels do not build: backend `cpu` has a builder of its own for it.
    #[error(
        "preset {} is built on the CPU only, by backend cpu; take that backend, or another preset",
        preset.name()
    )]
    PresetNotOnDevice {
        /// The preset.
        preset: Preset,
    },
    /// The finished tree would not fit the 30-bit indices of the node format.
    #[error(
        "the tree would have {nodes} nodes and {references} references, more than its format can address"
    )]
    TooLarge {
        /// Nodes of the tree.
        nodes: u64,
        /// References of the tree.
        references: u64,
    },
    /// A tree was loaded for a mesh it was not built over.
    #[error("the tree was built over another mesh: {reason}")]
    WrongMesh {
        /// What differs.
        reason: String,
    },
    /// A mesh on a device whose counts do not fit its buffers.
    #[error("the mesh cannot be used: {reason}")]
    InvalidMesh {
        /// What is wrong with it.
        reason: String,
    },
    /// A device failed.
    #[error("the device failed: {0}")]
    Device(String),
    /// A limit of the device is too low for what was asked.
    #[error("{what} needs {needed}, but the device's limit {limit} is {allowed}")]
    DeviceLimit {
        /// What was asked.
        what: String,
        /// The limit's name.
        limit: String,
        /// What is needed.
        needed: u64,
        /// What the device allows.
        allowed: u64,
    },
    /// The device has no memory left.
    #[error("the device is out of memory: {what} needs {needed} bytes")]
    DeviceMemory {
        /// What was asked.
        what: String,
        /// Bytes asked for.
        needed: u64,
    },
    /// The device is gone; whatever was on it is gone too.
    #[error("the device was lost: {reason}")]
    DeviceLost {
        /// What the driver says.
        reason: String,
    },
    /// The device did not finish in time; it may still be at work.
    #[error("the device did not finish within {seconds} seconds")]
    DeviceTimedOut {
        /// How long was waited, in whole seconds.
        seconds: u64,
    },
}

/// Why memory does not suffice.
struct Lack {
    needed: u64,
    limit: u64,
}

impl core::fmt::Display for Lack {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Lack { needed, limit } = self;
        if needed > limit {
            return write!(
                f,
                "the build needs {needed} bytes, more than the limit of {limit}; raise the limit"
            );
        }
        write!(f, "the system has no more memory for the build, which holds {needed} bytes")
    }
}

/// Why memory does not suffice for the answers to a batch.
struct Crossings(Lack);

impl core::fmt::Display for Crossings {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Crossings(Lack { needed, limit }) = self;
        if needed > limit {
            return write!(
                f,
                "the crossings take {needed} bytes or more, over the limit of {limit}; raise the limit, or ask for fewer rays at a time"
            );
        }
        write!(
            f,
            "the system has no more memory for the answers, which take {needed} bytes so far; ask for fewer rays at a time"
        )
    }
}

impl QueryError {
    /// The error of a part of a batch, for the whole: so many bytes are held beside the part, under the limit
    /// of the whole.
    #[must_use]
    pub(crate) fn beside(self, held: u64, whole: Option<u64>) -> QueryError {
        match (self, whole) {
            (QueryError::OutOfMemory { needed, limit }, _) if needed <= limit => {
                refused(needed + held)
            }
            (QueryError::OutOfMemory { needed, .. }, Some(limit)) => {
                QueryError::OutOfMemory { needed: needed + held, limit }
            }
            (error, _) => error,
        }
    }
}

/// A number that may not be known.
struct Amount(u64);

impl core::fmt::Display for Amount {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            0 => f.write_str("unknown"),
            amount => amount.fmt(f),
        }
    }
}

/// Why a query was refused.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum QueryError {
    /// Input and output differ in length.
    #[error("{rays} rays were given with room for {results} results; the two must be equal")]
    LengthMismatch {
        /// Rays given.
        rays: usize,
        /// Room for results.
        results: usize,
    },
    /// The answers would take more memory than allowed, or than the system has.
    #[error("{}", Crossings(Lack { needed: *needed, limit: *limit }))]
    OutOfMemory {
        /// Bytes needed at the point where it stopped; where the system refused more, those held.
        needed: u64,
        /// The limit; where the system refused more, as many as are `needed`.
        limit: u64,
    },
    /// The watch ended the batch.
    #[error("cancelled after {done} of {total} rays")]
    Cancelled {
        /// Rays answered.
        done: u64,
        /// Rays of the batch.
        total: u64,
    },
    /// A device failed.
    #[error("the device failed: {0}")]
    Device(String),
    /// A limit of the device is too low for what was asked.
    #[error("{what} needs {needed}, but the device's limit {limit} is {allowed}")]
    DeviceLimit {
        /// What was asked.
        what: String,
        /// The limit's name.
        limit: String,
        /// What is needed.
        needed: u64,
        /// What the device allows.
        allowed: u64,
    },
    /// The device has no memory left.
    #[error("the device is out of memory: {what} needs {needed} bytes")]
    DeviceMemory {
        /// What was asked.
        what: String,
        /// Bytes asked for.
        needed: u64,
    },
    /// The device is gone; whatever was on it is gone too.
    #[error("the device was lost: {reason}")]
    DeviceLost {
        /// What the driver says.
        reason: String,
    },
    /// The device did not finish in time; it may still be at work.
    #[error("the device did not finish within {seconds} seconds")]
    DeviceTimedOut {
        /// How long was waited, in whole seconds.
        seconds: u64,
    },
}

#[cfg(test)]
mod tests;
