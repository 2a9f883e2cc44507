//! The ray tracer of `splitplane`.

#![forbid(unsafe_code)]

mod light;
mod material;
mod texture;

pub use light::{Environment, Light};
pub use material::{Dielectric, Material};
pub use texture::Texture;
