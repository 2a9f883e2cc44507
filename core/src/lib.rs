#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]

#[cfg(feature = "alloc")]
extern crate alloc;

pub mod aabb;
#[cfg(feature = "alloc")]
pub mod backend;
pub mod config;
pub mod digest;
pub mod mesh;
pub mod node;
pub mod ray;
pub mod tree;
