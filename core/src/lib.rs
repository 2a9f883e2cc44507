#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]

#[cfg(feature = "alloc")]
extern crate alloc;

pub mod aabb;
pub mod arithmetic;
#[cfg(feature = "alloc")]
pub mod backend;
pub mod build;
#[cfg(feature = "alloc")]
pub mod cancel;
pub mod config;
#[cfg(feature = "alloc")]
pub mod error;
pub mod exact;
pub mod kernel;
pub mod layout;
pub mod mesh;
#[cfg(feature = "alloc")]
pub mod points;
pub mod query;
#[doc(hidden)]
pub mod random;
pub mod ray;
#[cfg(feature = "alloc")]
pub mod report;
pub mod sah;
#[cfg(all(feature = "alloc", target_has_atomic = "ptr"))]
pub mod scene;
pub mod tree;
pub mod triangle;
pub mod watch;
