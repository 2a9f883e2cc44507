//! The outputs of a frame, one by one.

#[cfg(doc)]
use crate::plan::Outputs;
use std::fmt;

/// One of the [`Outputs`] of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Output {
    /// [`Outputs::pixels`].
    Pixels,
    /// [`Outputs::radiance`].
    Radiance,
    /// [`Outputs::first_hits`].
    FirstHits,
    /// [`Outputs::first_costs`].
    FirstCosts,
}

impl fmt::Display for Output {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Output::Pixels => "pixels",
            Output::Radiance => "radiance",
            Output::FirstHits => "first hits",
            Output::FirstCosts => "first costs",
        })
    }
}
