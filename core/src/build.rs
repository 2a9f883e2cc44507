//! How trees are built: the schedule, what its kernels decide, and a serial executor that is their
//! specification.

pub mod bins;
#[cfg(feature = "alloc")]
pub mod compress;
pub mod decide;
#[cfg(feature = "alloc")]
pub mod lockstep;
pub mod mask;
pub mod middle;
#[cfg(feature = "alloc")]
pub mod points;
pub mod reference;
pub mod schedule;
pub mod split;
