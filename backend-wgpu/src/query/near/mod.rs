//! What is near, found through a tree on the device: bounds of distances there, decisions in `f64` or whole numbers by the host
//! ([`splitplane_core::kernel::NearQueries`]).

mod batch;
mod closest;
mod overlaps;
mod unit;
mod volume;
