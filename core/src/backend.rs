//! The seam between backends: object-safe traits at batch level.

use crate::config::{BuildConfig, ConfigError, Preset};
use crate::mesh::Mesh;
use crate::ray::{Hit, QueryOptions, Ray};
use crate::tree::KdTree;
use alloc::boxed::Box;
use alloc::string::String;
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
    ) -> Result<(), QueryError>;

    /// For every ray, whether it hits anything.
    ///
    /// # Errors
    /// `rays` and `occluded` of different length.
    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions,
    ) -> Result<(), QueryError>;

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
}

impl From<BuildConfig> for BuildOptions {
    fn from(config: BuildConfig) -> BuildOptions {
        BuildOptions { config, max_memory: None }
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
    /// The build would hold more memory than allowed.
    #[error("the build needs {needed} bytes, more than the limit of {limit}; raise the limit")]
    OutOfMemory {
        /// Bytes needed at the point where it stopped.
        needed: u64,
        /// The limit.
        limit: u64,
    },
    /// A builder that this backend does not have.
    #[error(
        "preset {} is built on the CPU only; take backend cpu, or another preset",
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
