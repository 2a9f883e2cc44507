//! The ray tracer of `splitplane`: Whitted's shadows, reflections and refractions, in waves of rays.
//!
//! It is a kernel set of its own ([`RayTracer`]) with a schedule of its own ([`schedule::frame`]), which
//! run on the same [`Executor`](splitplane_core::build::schedule::Executor) trait as the tree builder's. What
//! runs is decided by a [`Plan`]: a scene pays for what it uses.
//!
//! `tracer::Tracer` holds a backend, a tree and an appearance, and renders frames of them; start
//! there. The renderers below it, in `cpu` and `wgpu`, are for programs that own their trees.

#![forbid(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]
#![cfg_attr(not(feature = "cpu"), allow(dead_code, reason = "the shading of the CPU's kernels"))]

#[cfg(test)]
extern crate self as splitplane_render;

mod bsdf;
mod camera;
#[cfg(feature = "cpu")]
pub mod cpu;
mod environment;
mod environment_map;
mod error;
mod frame;
mod fresnel;
pub mod kernel;
pub mod layout;
mod light;
mod lighting;
mod lobes;
mod material;
mod microfacet;
mod part;
mod paths;
#[cfg(feature = "picture")]
pub mod picture;
mod plan;
mod plane;
mod planted;
#[cfg(all(test, feature = "cpu"))]
mod planted_tests;
mod random;
pub mod scene_data;
mod scene_words;
pub mod schedule;
mod settings;
mod surface;
mod texture;
mod tone;
#[cfg(any(feature = "cpu", feature = "wgpu"))]
pub mod tracer;
mod vector;
mod warp;
#[cfg(feature = "wgpu")]
pub mod wgpu;
mod world;

pub use camera::Pinhole;
pub use environment_map::{EnvironmentMap, EnvironmentMapError};
pub use error::RenderError;
pub use frame::{FrameInput, FrameStats};
pub use kernel::RayTracer;
pub use light::{Environment, Light};
pub use material::{Dielectric, Material};
pub use part::{MAX_PARTS, Part, PartError};
pub use plan::{Outputs, Plan, PlanError, Room};
pub use scene_data::instances;
pub use scene_data::{Appearance, AppearanceError, Needs, SceneData};
pub use settings::{
    Gather, LightTransport, MAX_BOUNCES, MAX_DEPTH, MAX_NEIGHBOURS, MAX_PASSES, MAX_PHOTONS,
    MAX_PIXELS, MAX_SAMPLES, MAX_SHADOW_RAYS, MAX_SIDE, MIN_NEIGHBOURS, MIN_PHOTONS,
    RenderSettings, SettingsError, Size, SizeError,
};
pub use texture::Texture;
