//! What Martin's survey of Zhou, Hou, Wang and Guo 2008 reports, measured here: its worked example, its
//! tables of times, costs and frames a second, its figures, each beside the printed value.
//!
//! Whatever is printed stands in [`survey`]; whatever is measured comes from [`scene`], [`scaling`] and
//! [`areas`]; what is drawn comes from trees that were built ([`cut`], [`mod@slice`], [`crown`], [`point_trees`]). [`tables`] and
//! [`document`] put them side by side. Nothing here judges a time.

pub mod areas;
pub mod asked;
mod builders;
pub mod cells;
pub mod claims;
mod clip;
pub mod crown;
pub mod cut;
pub mod document;
mod error;
pub mod figures;
pub mod file;
pub mod fit;
pub mod machine;
pub mod motion;
pub mod objects;
pub mod plot;
pub mod point_trees;
pub mod rays;
pub mod scaling;
pub mod scene;
pub mod slice;
pub mod space;
pub mod survey;
pub mod table;
pub mod tables;
pub mod timing;
pub mod worked;

pub use builders::{Builder, EQUAL_COSTS, at_equal_knobs};
pub use error::ReportError;
pub use timing::{median, pool};
