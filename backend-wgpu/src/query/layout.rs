//! How rays and their answers lie on the device.

use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Hit, Ray};

/// The `triangle` of a hit on the device whose traversal the driver ended early; any hit then says 2.
/// Seen with Mesa's llvmpipe, which ends a shader's loops after 65,535 rounds.
pub const UNFINISHED: u32 = u32::MAX - 1;

/// Bytes of a ray.
pub(super) const RAY_BYTES: u64 = size_of::<Ray>() as u64;

/// Bytes of an answer on the device.
pub(super) const fn result_bytes(query: Query) -> u64 {
    match query {
        Query::Closest => size_of::<Hit>() as u64,
        Query::Any => size_of::<u32>() as u64,
    }
}
