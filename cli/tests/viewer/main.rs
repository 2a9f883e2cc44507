//! Tests of the viewer.

mod frames;
mod window;
