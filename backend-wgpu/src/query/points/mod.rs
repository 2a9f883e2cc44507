//! Trees of points on a device: the nearest points, and those within a radius.
//!
//! [`build`] builds a tree there, [`device`] is the tree in device memory, [`batch`] takes queries there in slices, [`nearest`] and [`within`] say what the
//! words that come back mean; [`tree`] is what users hold.

mod batch;
mod build;
mod device;
mod nearest;
mod tree;
mod within;

#[doc(hidden)]
pub use build::{BuildingPoints, PointExecutor};
pub use tree::WgpuPointTree;
