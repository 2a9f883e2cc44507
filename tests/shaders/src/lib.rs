//! The tests of this package hold shaders to what the host believes of them. They stand apart, since the shaders
//! are below the crates that declare the kernels, and those of the ray tracer above.
