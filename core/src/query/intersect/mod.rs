//! Prepared rays for queries, and the ray/triangle tests.
//!
//! The watertight test is that of Woop, Benthin and Wald 2013 on exact signs, in guarded arithmetic
//! (see [`arithmetic`](crate::arithmetic)). Its answer is a function of the ray and the mesh alone, independent
//! of tree, traversal and backend; [`watertight`] says which function.

mod closer_look;
mod moeller_trumbore;
mod prepare;
mod scale;
mod watertight;

pub use closer_look::{DISTANCE_LEAST, NEEDLE, ROBUST, WIDTH_LEAST, refined};
pub use moeller_trumbore::moeller_trumbore;
pub(crate) use prepare::scale;
pub use prepare::{PreparedRay, stop_after};
pub use scale::{Limits, SceneScale, longest_extent, widened};
pub use watertight::{DET_LEAST, INTERPOLATION_ERROR, SLIVER, SUM_LEAST, T_LEAST, watertight};

/// Relative widening of the distance to a plane. The accepted hit point is off the triangle by at
/// most 8 roundings (2^-24 each) of its distance to the plane on the plane's axis (differences,
/// slope, shear), which is 2^-21; this is twice that.
pub const PLANE_SLACK: f32 = 9.536_743e-7; // 2^-20
/// Absolute widening of a plane's position, per unit of the longest triangle extent: roundings of
/// corner images, and of `t` beside the edges, that grow with the triangle and not with the distance.
pub const SIZE_SLACK: f32 = 3.814_697_3e-6; // 2^-18
/// Absolute widening for origins next to 0, which move by up to twice [`ORIGIN_LEAST`], on two axes by the shear.
const ORIGIN_SLACK: f32 = 3.469_447e-18; // 2^-58
/// Absolute widening per unit of the scene's extent: slopes below 2^-40 count as zero, over at most
/// 101 diagonals.
const SCENE_SLACK: f32 = 2.328_306_4e-10; // 2^-32
/// A traversal may stop when the next entry lies beyond the best `t` by more than this part of it:
/// twice the bound on the error of an interpolated `t` (see [`watertight`]).
pub const STOP_SLACK: f32 = 1.220_703_1e-4; // 2^-13
/// Rounding error of adding a moved ray's offset, per unit of the offset: four roundings.
pub const OFFSET_SLACK: f32 = 2.384_185_8e-7; // 2^-22
/// Edge functions below this get a closer look: their products may be subnormal, which a device
/// need not keep.
pub const EDGE_LEAST: f32 = 3.155_443_6e-30; // 2^-98
/// Slopes below this are zero, so that slope times distance is never subnormal in range.
pub const SLOPE_LEAST: f32 = 9.094_947e-13; // 2^-40
/// Direction components are taken to be at least this large when dividing by them.
pub const DIRECTION_LEAST: f32 = 8.271_806e-25; // 2^-80
/// No coordinate other than zero is below this, or origins are never zero (see [`SceneScale::origin_least`]):
/// differences of the two are then zero or so large that their product with a slope is a normal number.
const COORDINATE_LEAST: f32 = 1.292_469_7e-26; // 2^-86
/// In range: no coordinate above this. Origins too.
pub const COORDINATE_MOST: f32 = 2.748_779e11; // 2^38
/// In range: no scene smaller than this.
const EXTENT_LEAST: f32 = 9.094_947e-13; // 2^-40
/// Origin coordinates below this are taken for one value, in scenes that are in range: 2^-60 is
/// less than the rounding error of the scene's extent.
pub const ORIGIN_LEAST: f32 = 8.673_617_4e-19; // 2^-60
/// Origins further than this many scene extents away are first moved along the ray.
const FAR: f32 = 100.0;

/// A hit in inner units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Inner `t`.
    pub t: f32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third corner.
    pub v: f32,
}

#[cfg(test)]
mod tests;
