//! How trees are built: the schedule, what its kernels decide, and a serial executor that is their
//! specification.

pub mod bins;
pub mod decide;
#[cfg(feature = "alloc")]
pub mod lockstep;
pub mod mask;
pub mod middle;
pub mod reference;
pub mod schedule;
pub mod split;
