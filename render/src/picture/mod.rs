//! The outputs of a frame, as files in memory: pictures for screens, linear ones with arbitrary
//! output variables (AOVs), heat maps of what rays cost, and movies.
//!
//! Nothing here opens a file. Pictures and files are values, and a [`Movie`] goes to any
//! [`std::io::Write`].
//!
//! | what | PNG | EXR |
//! |---|---|---|
//! | pixels | [`screen`], [`encode_png`] | |
//! | radiance | | [`encode_exr`] |
//! | depth, normals, triangles | [`Aov::picture`], [`encode_png`] | [`encode_exr`] |
//! | nodes visited, triangles tested | [`HeatMap::new`], [`encode_png`] | [`encode_exr`] |
//!
//! Arrays are those of a frame: one value per pixel, from the top left, row by row.

mod aov;
mod cost;
mod error;
mod exr;
mod font;
mod heat;
mod legend;
mod movie;
mod movie_format;
mod scale;
mod screen;
mod viridis;

pub use crate::Size;
pub use crate::layout::{FirstCost, FirstHit};
pub use aov::Aov;
pub use cost::{CostStatistics, Quantity};
pub use error::PictureError;
pub use exr::encode_exr;
pub use heat::HeatMap;
pub use image::RgbImage;
pub use movie::Movie;
pub use movie_format::MovieFormat;
pub use scale::ABOVE;
pub use screen::{encode_png, screen};
