//! Points: a kd-tree of 1 to 4 dimensions, its nearest neighbours, and what lies within a radius.
//!
#![cfg_attr(feature = "cpu", doc = "```")]
#![cfg_attr(not(feature = "cpu"), doc = "```ignore")]
//! use splitplane::points::{CpuPointTree, NearestOptions, Neighbour, PointOptions};
//!
//! let cloud = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 5.0, 0.0]];
//! let tree = CpuPointTree::build(&cloud, &PointOptions::default()).expect("memory for three points");
//! let options = NearestOptions { k: 2, ..NearestOptions::default() };
//! let queries = [[0.9, 0.0, 0.0], [0.0, 9.0, 0.0]];
//! let mut found = [Neighbour::NONE; 4];
//! tree.nearest(&queries, &mut found, &options).expect("room for two records a query");
//! assert_eq!(found.map(|neighbour| neighbour.point), [1, 0, 2, 0]);
//! ```
//!
//! `Engine::points` of a backend that was opened by name gives an `AnyPointTree`: on a GPU it is built there, and answers there.

pub use splitplane_core::points::build::{PointBuildError, PointOptions};
pub use splitplane_core::points::lists::NeighbourLists;
pub use splitplane_core::points::nearest::{NearestOptions, Neighbour};
pub use splitplane_core::points::parts::{Part, dump, walk_parts};
pub use splitplane_core::points::tree::{Axes, PointNode, PointReport, PointTree};
#[cfg(feature = "cpu")]
pub use splitplane_cpu::{CpuPointTree, KeptBytes};
#[cfg(feature = "wgpu")]
pub use splitplane_wgpu::WgpuPointTree;

#[cfg(any(feature = "cpu", feature = "wgpu"))]
pub use any::AnyPointTree;

#[cfg(any(feature = "cpu", feature = "wgpu"))]
mod any;
