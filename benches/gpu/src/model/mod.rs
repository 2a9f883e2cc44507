//! What builds and rays would take on a named device, from what was counted and from what is assumed of the device.
//!
//! A sketch, to be proved wrong: each assumption stands in a line with its source, and beside it what the device at
//! hand was measured to do, so that a prediction that fails tells why.

pub(crate) mod devices;
pub(crate) mod predict;
pub(crate) mod scale;
pub(crate) mod shaders;
pub(crate) mod table;
