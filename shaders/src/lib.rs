//! WGSL twins of splitplane's kernels, as text for any engine.
//!
//! Empty for now: the device backend is not written yet. The crate exists so that its place in the
//! workspace, and the rule that it depends on nothing, are fixed from the start.

#![no_std]
#![forbid(unsafe_code)]
