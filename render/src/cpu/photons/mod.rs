//! Photons (Jensen 1996): traced from the lights by waves of rays, kept in the library's own trees of points, and looked up around the
//! points that paths from the eye meet. See `docs/design/rendering.md`.

mod bounce;
mod density;
mod emission;
mod maps;
mod report;
mod trace;
mod tree;

pub(crate) use maps::Maps;
pub use report::{PhotonEnergy, PhotonReport};
pub(crate) use trace::{Tracing, trace};
pub(crate) use tree::PointTrees;
