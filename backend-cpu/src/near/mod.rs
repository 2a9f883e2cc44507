//! Answering points: which point of the mesh is closest.

pub(crate) mod cast;
pub(crate) mod cells;
pub(crate) mod closest_point;
pub(crate) mod in_order;
pub(crate) mod overlap;
mod triangle_bound;
