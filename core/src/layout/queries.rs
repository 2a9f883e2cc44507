//! The uniforms of queries on a device, and of its self-test.

use bytemuck::{Pod, Zeroable};

use crate::query::intersect::SceneScale;
use crate::ray::{Culling, QueryOptions};

/// The data of the whole scene that every traversal reads: [`SceneScale`] in the layout of the WGSL
/// struct `Scene` of `intersect.wgsl`. 64 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SceneUniform {
    /// Lower corner of the tree's bounds.
    pub lo: [f32; 3],
    /// Absolute slack of plane positions.
    pub slack: f32,
    /// Upper corner of the tree's bounds.
    pub hi: [f32; 3],
    /// 1 when exponents leave the range of the plain triangle test.
    pub wide: u32,
    /// Lower corner of the box in which an origin is not far.
    pub near_lo: [f32; 3],
    /// Always 0. Shaders take their opaque zero from here, which no compiler can see through.
    pub zero: u32,
    /// Upper corner of the box in which an origin is not far.
    pub near_hi: [f32; 3],
    /// The value for which origin coordinates next to 0 are taken.
    pub origin_least: f32,
}

impl From<&SceneScale> for SceneUniform {
    fn from(scale: &SceneScale) -> SceneUniform {
        SceneUniform {
            lo: scale.bounds.lo,
            slack: scale.slack,
            hi: scale.bounds.hi,
            wide: u32::from(scale.wide),
            near_lo: scale.near.lo,
            zero: 0,
            near_hi: scale.near.hi,
            origin_least: scale.origin_least,
        }
    }
}

/// A batch of rays: the WGSL struct `Batch` of `query.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct BatchUniform {
    /// How many rays.
    pub count: u32,
    /// The side of triangles to ignore: 0 for none, 1 for the back, 2 for the front.
    pub culling: u32,
    /// The index of a triangle to ignore; `u32::MAX`, which no triangle has, for none.
    pub ignore: u32,
    /// Words of a ray's list, where triangles are listed or counted; 0 for other queries.
    pub room: u32,
}

/// A side to ignore, as devices have it: 0 for none, 1 for the back, 2 for the front. Both sides are 3.
pub const fn culling_bits(culling: Culling) -> u32 {
    match culling {
        Culling::None => 0,
        Culling::Back => 1,
        Culling::Front => 2,
    }
}

impl BatchUniform {
    /// This many rays with these options.
    pub fn new(count: u32, options: &QueryOptions<'_>) -> BatchUniform {
        let culling = culling_bits(options.culling);
        let ignore = options.ignore.unwrap_or(u32::MAX);
        BatchUniform { count, culling, ignore, room: 0 }
    }
}

/// A batch of rays of a scene of many objects: the WGSL struct `SceneBatch` of `scene_query.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct SceneBatch {
    /// How many rays.
    pub count: u32,
    /// The side of triangles to ignore, as seen in the world: 0 for none, 1 for the back, 2 for the front.
    pub culling: u32,
    /// Instances answer when a bit of theirs is in this mask.
    pub mask: u32,
    /// The instance of a triangle to ignore; `u32::MAX` for none.
    pub ignored_instance: u32,
    /// That triangle, by its index in the geometry's mesh.
    pub ignored_triangle: u32,
    /// 1 where any hit will do, 0 where the closest is asked for.
    pub any: u32,
    /// Always 0, as in [`SceneUniform::zero`].
    pub zero: u32,
    /// Words of a ray's way through the tree over instances: 2, and an entry for each level, and one more; 0 where there is no
    /// instance.
    pub way: u32,
}

/// The input of the kernel that finds the range of the triangles: the WGSL struct `TriangleCount`
/// of `triangle_limits.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct TriangleCount {
    /// How many triangles.
    pub count: u32,
    /// Always 0, as in [`SceneUniform::zero`].
    pub zero: u32,
}

/// The input of the kernel that moves vertices: the WGSL struct `VertexCount` of `move_vertices.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct VertexCount {
    /// How many vertices.
    pub count: u32,
    /// Always 0, as in [`SceneUniform::zero`].
    pub zero: u32,
}

/// The input of the self-test's kernel: the WGSL struct of the same name.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct CheckParameters {
    /// Always 0, as in [`SceneUniform::zero`].
    pub zero: u32,
    /// How many pairs of operands.
    pub count: u32,
}
