//! What splitplane's tests and benchmarks share: an exact oracle that owes nothing to the tracer,
//! scenes that builders and traversals trip over, rays aimed where they leak, a judge that tells
//! rounding from error, a slow backend that is right, and backends that are wrong on purpose.

#![forbid(unsafe_code)]

pub mod aim;
pub mod built;
pub mod close_calls;
pub mod clouds;
pub mod configs;
pub mod edits;
pub mod exact;
pub mod expansion;
pub mod extremes;
pub mod faulty;
pub mod forge;
pub mod grazing;
pub mod greedy;
pub mod judge;
pub mod modules;
pub mod near;
pub mod objects;
pub mod oracle;
pub mod overlap;
pub mod random;
pub mod rational;
pub mod scenes;
pub mod sources;
pub mod stability;
pub mod surfaces;
pub mod watch;
pub mod wrong_kernel;
