//! What became of the middle stage of a build.

use std::fmt;

use splitplane_core::kernel::Buffer;

/// Whether a build had a middle stage, and why not: the tree is the same, and the build takes more dispatches and bytes without it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum MiddleStage {
    /// The configuration has none: its planes are found by bins.
    #[default]
    NotOfConfig,
    /// It finished what the levels handed over.
    Finished,
    /// Left out: the stage needs lists whole, and one binding of the device does not hold this one.
    TooLong {
        /// The list; where several are too long, the longest.
        list: Buffer,
        /// Bytes that it takes.
        needed: u64,
        /// Bytes that one binding holds.
        allowed: u64,
    },
    /// Left out: with it the build would take more than [`max_memory`](splitplane_core::backend::BuildOptions::max_memory).
    OutOfMemory {
        /// Bytes that the build would have taken.
        needed: u64,
        /// Bytes that it may take.
        limit: u64,
    },
    /// Tried, and void by its own rules: what the levels handed over grew too much, or a cap might have bound. The build was repeated without it.
    Void,
    /// Left out, since it was void in an earlier build of as many triangles by the same configuration.
    KnownVoid,
}

impl fmt::Display for MiddleStage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MiddleStage::NotOfConfig => write!(f, "none: planes are found by bins"),
            MiddleStage::Finished => write!(f, "finished"),
            MiddleStage::TooLong { list, needed, allowed } => write!(
                f,
                "left out: {list:?} takes {needed} bytes, and one binding holds {allowed}"
            ),
            MiddleStage::OutOfMemory { needed, limit } => {
                write!(
                    f,
                    "left out: the build would take {needed} bytes with it, and may take {limit}"
                )
            }
            MiddleStage::Void => write!(f, "void, and the build repeated without it"),
            MiddleStage::KnownVoid => write!(f, "left out: it was void in the build before"),
        }
    }
}
