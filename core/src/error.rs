//! Errors of builds and queries.

use crate::config::{ConfigError, Preset};
use crate::watch::Progress;
use alloc::string::String;
use thiserror::Error;

/// What went wrong on a device, for builds and queries alike.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// A failure of no other kind; the text says more.
    #[error("the device failed: {0}")]
    Failed(String),
    /// A limit of the device is too low for what was asked.
    #[error("{what} needs {needed}, but the device's limit {limit} is {allowed}")]
    Limit {
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
    OutOfMemory {
        /// What was asked.
        what: String,
        /// Bytes requested.
        needed: u64,
    },
    /// The device is gone; whatever was on it is gone too.
    #[error("the device was lost: {reason}")]
    Lost {
        /// What the driver says.
        reason: String,
    },
    /// The device did not finish in time; it may still be at work.
    #[error("the device did not finish within {seconds} seconds")]
    TimedOut {
        /// How long was waited, in whole seconds.
        seconds: u64,
    },
}

/// Why a build did not give a tree.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
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
    /// The watch cancelled the build.
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
    /// The counts of a mesh on the device do not fit its buffers.
    #[error("the mesh cannot be used: {reason}")]
    InvalidMesh {
        /// What is wrong with it.
        reason: String,
    },
    /// A device failed, or cannot do what was asked.
    #[error(transparent)]
    Device(#[from] DeviceError),
}

impl BuildError {
    /// Restates the error of a build that ran with a reduced limit, since so many bytes were held besides, by the
    /// caller's own limit: see [`BuildOptions::beside`](crate::backend::BuildOptions::beside).
    #[must_use]
    pub fn beside(self, held: u64, whole: Option<u64>) -> BuildError {
        match (self, whole) {
            (BuildError::OutOfMemory { needed, limit }, Some(whole)) if needed > limit => {
                BuildError::OutOfMemory { needed: needed.saturating_add(held), limit: whole }
            }
            (error, _) => error,
        }
    }
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
    /// Turns the error of a part of a batch into one of the whole: `held` bytes are held beside the
    /// part, under the limit of the whole.
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
#[non_exhaustive]
pub enum QueryError {
    /// Input and output differ in length.
    #[error("{rays} rays were given with room for {results} results; the two must be equal")]
    LengthMismatch {
        /// Rays given.
        rays: usize,
        /// Length of the results.
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
    /// The watch cancelled the batch.
    #[error("cancelled after {done} of {total} rays")]
    Cancelled {
        /// Rays answered.
        done: u64,
        /// Rays of the batch.
        total: u64,
    },
    /// The backend does not answer this query.
    #[error("the backend does not answer queries for {query}")]
    Unsupported {
        /// What was asked for, in the plural.
        query: &'static str,
    },
    /// The closest points of spheres or capsules are asked for, which the transform of one of their instances stretches unevenly: they are then
    /// neither.
    #[error(
        "instance {instance} stretches its shapes unevenly; closest points of shapes need a transform that turns, moves and scales evenly"
    )]
    UnevenShapes {
        /// The instance.
        instance: u32,
    },
    /// A device failed, or cannot do what was asked.
    #[error(transparent)]
    Device(#[from] DeviceError),
}

/// Refuses more bytes than allowed.
///
/// # Errors
/// [`QueryError::OutOfMemory`].
#[inline]
pub fn check_bytes(needed: u64, max_memory: Option<u64>) -> Result<(), QueryError> {
    match max_memory {
        Some(limit) if needed > limit => Err(QueryError::OutOfMemory { needed, limit }),
        _ => Ok(()),
    }
}

/// The error for memory that the system refused; `bytes` are held or were requested.
pub fn refused(bytes: u64) -> QueryError {
    QueryError::OutOfMemory { needed: bytes, limit: bytes }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_that_is_just_kept_is_kept() {
        assert_eq!(check_bytes(7, None), Ok(()));
        assert_eq!(check_bytes(7, Some(7)), Ok(()));
        let over = QueryError::OutOfMemory { needed: 8, limit: 7 };
        assert_eq!(check_bytes(8, Some(7)), Err(over.clone()));
        // Ten bytes are held beside the part.
        let whole = QueryError::OutOfMemory { needed: 18, limit: 17 };
        assert_eq!(over.beside(10, Some(17)), whole);
        assert_eq!(refused(5).beside(10, Some(100)), refused(15));
    }
}
