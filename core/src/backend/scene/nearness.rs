//! Whether closest points are defined for all shapes of a scene.

use core::sync::atomic::AtomicU8;

/// Whether closest points are defined for all shapes of a scene: found out when somebody asks.
#[derive(Debug, Default)]
pub(super) struct Nearness(pub(super) AtomicU8);

pub(super) const UNKNOWN: u8 = 0;
pub(super) const DEFINED: u8 = 1;
pub(super) const PARTLY: u8 = 2;
