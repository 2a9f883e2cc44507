//! What each setting costs on a scene and what it gets wrong: every preset, each of its knobs, each
//! accuracy, each backend and thread count, measured on the same rays and judged by the same exact
//! answers.
//!
//! Nothing is ranked within the noise of its own rounds ([`interval`]). [`plan`] says what is tried, [`budget`] how much of
//! it, [`measure()`] does it; [`picture`] does the same for what pictures are made of. [`pareto`], [`payback`] and
//! [`recommend`] draw conclusions and know nothing of scenes; [`bvh`] lays a hierarchy beside them. [`document`] writes it down, [`compare`] sets it beside what an earlier run wrote.

pub mod budget;
pub mod bvh;
pub mod compare;
pub mod document;
mod error;
pub mod held;
mod hierarchy;
pub mod interval;
pub mod judge;
pub mod measure;
pub mod pareto;
pub mod payback;
pub mod picture;
pub mod plan;
pub mod plot;
pub mod rays;
pub mod recommend;
mod rounds;
pub mod row;
mod tables;

pub use document::Trade;
pub use error::TradeError;
pub use measure::measure;
