//! The reference builder: every kernel of the schedule, serial and written for readability.
//!
//! [`kernels`] is the specification. Each kernel is a function over one item of its grid. It reads
//! whole buffers, live ranges only, and returns or fills what that item writes. The backends'
//! kernels are twins of these: they may do the work in any order, and must leave the same bytes.
//! [`build::lockstep::Lockstep`](crate::build::lockstep::Lockstep) checks that, dispatch by dispatch.
//!
//! [`ReferenceExecutor`] runs the kernels one item at a time over [`Buffers`], and [`build`]
//! makes a tree with it. That takes a few times as long as the CPU backend on one thread, but needs
//! neither threads nor `std`:
//!
//! ```
//! # #[cfg(feature = "alloc")] {
//! use splitplane_core::backend::BuildOptions;
//! use splitplane_core::mesh::Mesh;
//! use splitplane_core::ray::{QueryOptions, Ray};
//! use splitplane_core::query::lines;
//! use splitplane_core::build::reference;
//! use splitplane_core::query::traverse;
//!
//! let mesh = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
//! let mesh = Mesh::soup(&mesh).expect("few triangles");
//! let (tree, summary) = reference::build(&mesh, &BuildOptions::default()).expect("memory");
//! assert_eq!((summary.triangles, summary.dropped), (1, 0));
//!
//! let scale = lines::scene_scale(&tree.view(), &mesh);
//! let ray = Ray::new([0.25, 0.25, 5.0], [0.0, 0.0, -1.0]);
//! let hit = traverse::closest_hit(&tree.view(), &mesh, &scale, &ray, &QueryOptions::default());
//! assert_eq!(hit.expect("it hits").t, 5.0);
//! # }
//! ```
//!
//! The kernels are available without the feature `alloc` too: they work on slices, wherever these
//! are stored.

#[cfg(feature = "alloc")]
mod budget;
#[cfg(feature = "alloc")]
mod buffers;
#[cfg(feature = "alloc")]
mod build;
#[cfg(feature = "alloc")]
mod executor;
pub mod kernels;
mod parts;

#[cfg(feature = "alloc")]
pub use budget::Budget;
#[cfg(feature = "alloc")]
pub use buffers::Buffers;
#[cfg(feature = "alloc")]
pub use build::build;
#[cfg(feature = "alloc")]
pub use executor::ReferenceExecutor;
pub use parts::Parts;
