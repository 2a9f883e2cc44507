//! Rays through trees: one walk, and the queries that are made of it.

#[cfg(feature = "alloc")]
pub mod all_hits;
pub mod along;
#[cfg(feature = "alloc")]
pub mod best_first;
#[cfg(feature = "alloc")]
pub mod cast;
pub mod certify;
#[cfg(feature = "alloc")]
pub mod closest_point;
#[cfg(feature = "alloc")]
pub mod compressed;
#[cfg(feature = "alloc")]
pub mod inside;
pub mod intersect;
pub mod lines;
#[cfg(feature = "alloc")]
pub mod overlap;
mod slabs;
pub mod traverse;
pub mod walk;
