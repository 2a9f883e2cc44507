//! Errors of queries on a device.

use splitplane_core::error::{DeviceError, QueryError, refused};
use thiserror::Error;

use crate::error::GpuError;

/// Errors of queries on a device.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum DeviceQueryError {
    /// Input and output differ in length.
    #[error("{rays} rays were given with room for {results} results; the two must be equal")]
    LengthMismatch {
        /// Rays given.
        rays: usize,
        /// Length of the results.
        results: usize,
    },
    /// A host's buffer is too small for the rays it is to hold.
    #[error("the buffer of {what} has {bytes} bytes; {needed} are needed")]
    BufferTooSmall {
        /// What the buffer is for.
        what: &'static str,
        /// Bytes it has.
        bytes: u64,
        /// Bytes it needs.
        needed: u64,
    },
    /// A host's buffer was not made for use as a storage buffer.
    #[error("the buffer of {what} lacks the usage STORAGE")]
    BufferUsage {
        /// What the buffer is for.
        what: &'static str,
    },
    /// The driver ended the traversal of some rays early: Mesa's llvmpipe does after 65,535 rounds of
    /// a shader's loops. GPUs are not known to.
    #[error(
        "the driver ended the traversal of {rays} rays early, the first of them ray {first}; trace \
         them on the CPU"
    )]
    Unfinished {
        /// How many rays.
        rays: usize,
        /// The first of them.
        first: usize,
    },
    /// Accuracy `exact`: the device's bounds of error leave some rays undecided.
    #[error(
        "the device could not decide {rays} rays exactly, the first of them ray {first}; trace them \
         on the CPU"
    )]
    Undecided {
        /// How many rays.
        rays: usize,
        /// The first of them.
        first: usize,
    },
    /// Accuracy `exact` on a device that no self-test has found to round as the CPU does.
    #[error(
        "accuracy exact needs a device that a self-test found to be bitwise equal to the CPU; this \
         one was not tested, or differs"
    )]
    Uncertain,
    /// The watch cancelled the batch.
    #[error("cancelled after {done} of {total} rays")]
    Cancelled {
        /// Rays answered.
        done: u64,
        /// Rays of the batch.
        total: u64,
    },
    /// The system has no more memory for the answers.
    #[error("the system has no more memory for the answers, which take {needed} bytes so far")]
    HostMemory {
        /// Bytes held or requested.
        needed: u64,
    },
    /// The device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

impl From<DeviceQueryError> for QueryError {
    fn from(error: DeviceQueryError) -> QueryError {
        match error {
            DeviceQueryError::LengthMismatch { rays, results } => {
                QueryError::LengthMismatch { rays, results }
            }
            DeviceQueryError::Cancelled { done, total } => QueryError::Cancelled { done, total },
            DeviceQueryError::HostMemory { needed } => refused(needed),
            DeviceQueryError::Gpu(error) => error.into(),
            other => QueryError::Device(DeviceError::Failed(other.to_string())),
        }
    }
}
