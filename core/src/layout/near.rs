//! The records of kernels that look for what is near.

use bytemuck::{Pod, Zeroable};

/// A batch of queries for what is near: the WGSL struct of the same name.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct NearBatch {
    /// How many queries.
    pub count: u32,
    /// The index of a triangle to ignore; `u32::MAX`, which no triangle has, for none.
    pub ignore: u32,
    /// Words of what is written for a query.
    pub room: u32,
    /// 1 where one triangle that is certainly met is enough.
    pub any: u32,
    /// Lower corner of the box around all triangles.
    pub lower: [f32; 3],
    /// Always 0, as in [`SceneUniform::zero`](crate::layout::SceneUniform::zero).
    pub zero: u32,
    /// Upper corner of that box.
    pub upper: [f32; 3],
    /// Zero.
    pub padding: u32,
}

impl NearBatch {
    /// In place of the number of triangles: the driver did not let the query finish.
    pub const ENDED_EARLY: u32 = u32::MAX;
    /// In place of the number of triangles: there are more than are kept, or the walk's stack is too short.
    pub const OVERFULL: u32 = u32::MAX - 1;
    /// In place of the number of triangles: one is certainly met, and is enough.
    pub const MET: u32 = u32::MAX - 2;
    /// The bit of a triangle that is certainly met.
    pub const CERTAIN: u32 = 1 << 31;
    /// Rows of four words of a volume.
    pub const VOLUME_ROWS: u32 = 4;
    /// Kind of a volume: a box.
    pub const KIND_BOX: u32 = 0;
    /// Kind of a volume: a ball.
    pub const KIND_BALL: u32 = 1;
    /// Kind of a volume: what is in all of some half-spaces.
    pub const KIND_PLANES: u32 = 2;
    /// Kind of a volume: something else, within a box and some half-spaces.
    pub const KIND_WITHIN: u32 = 3;
    /// Kind of a volume about which nothing is asked: it is [`NearBatch::OVERFULL`].
    pub const KIND_NONE: u32 = 4;
    /// Most triangles that are kept of a point, of which one is the closest.
    pub const CLOSEST: u32 = 14;
    /// More than a bound of a distance errs, in a query's unit.
    pub const SLACK: f32 = 1.0 / 262_144.0;
}
