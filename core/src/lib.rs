#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]

#[cfg(feature = "alloc")]
extern crate alloc;

pub mod aabb;
#[cfg(feature = "alloc")]
pub mod all_hits;
pub mod along;
pub mod arithmetic;
#[cfg(feature = "alloc")]
pub mod backend;
#[cfg(feature = "alloc")]
pub mod best_first;
pub mod bins;
pub mod certify;
pub mod config;
pub mod decide;
pub mod digest;
#[cfg(feature = "alloc")]
pub mod dump;
pub mod exact;
pub mod file;
#[cfg(feature = "alloc")]
pub mod inside;
pub mod intersect;
pub mod kernel;
pub mod layout;
pub mod lines;
#[cfg(feature = "alloc")]
pub mod lockstep;
pub mod mask;
pub mod mesh;
pub mod node;
pub mod random;
pub mod ray;
pub mod reference;
pub mod sah;
pub mod schedule;
mod slabs;
pub mod split;
pub mod stats;
pub mod traverse;
pub mod tree;
pub mod triangle;
pub mod validate;
pub mod walk;
pub mod watch;
