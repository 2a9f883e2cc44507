//! Checks of a backend's answers against a reference in f64 that shares no code with it.

pub mod reference;
