//! Records of answers: the library's own, by other names.

use std::mem::offset_of;

use library::objects::{SceneClosestPoint as OfScene, SceneHit as HitOfScene};
use library::{ClosestPoint as OfMesh, Hit as HitOfMesh};

/// Where a ray meets a triangle: at `(1 - u - v) * a + u * b + v * c` for its corners `a`, `b`, `c`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in units of the ray's direction; infinity for a miss.
    pub t: f32,
    /// The triangle's place in your arrays; `SPLITPLANE_NONE` for a miss.
    pub triangle: u32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third corner.
    pub v: f32,
}

/// Where a ray meets a triangle of an instance.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneHit {
    /// Distance in units of the ray's direction; infinity for a miss.
    pub t: f32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third corner.
    pub v: f32,
    /// The triangle's place in the geometry's arrays; `SPLITPLANE_NONE` for a miss, as the next two.
    pub triangle: u32,
    /// The geometry.
    pub geometry: u32,
    /// The instance.
    pub instance: u32,
}

/// The point of a mesh that is closest to a point.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestPoint {
    /// The square of the distance; infinity where there is none.
    pub distance_squared: f64,
    /// x, y and z.
    pub point: [f32; 3],
    /// The triangle's place in your arrays; `SPLITPLANE_NONE` where there is none.
    pub triangle: u32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third corner.
    pub v: f32,
}

/// The point of a scene that is closest to a point.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneClosestPoint {
    /// The square of the distance; infinity where there is none.
    pub distance_squared: f64,
    /// x, y and z in the world.
    pub point: [f32; 3],
    /// The triangle's place in the geometry's arrays; `SPLITPLANE_NONE` where there is none, as the last two.
    pub triangle: u32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third corner.
    pub v: f32,
    /// The geometry.
    pub geometry: u32,
    /// The instance.
    pub instance: u32,
}

/// A place where a ray crosses a surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Distance in units of the ray's direction.
    pub t: f32,
    /// The triangle's place in the arrays of the mesh or geometry.
    pub triangle: u32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third corner.
    pub v: f32,
    /// The geometry; `SPLITPLANE_NONE` for a tree, as the next one.
    pub geometry: u32,
    /// The instance.
    pub instance: u32,
    /// 1 where the ray comes from the front: the side from which the corners run counter-clockwise.
    pub front: u32,
}

/// A point of a cloud.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// The square of its distance; infinity where there is none.
    pub distance_squared: f64,
    /// Its place in your array; `SPLITPLANE_NONE` where there is none.
    pub point: u32,
    /// 0.
    pub reserved: u32,
}

/// That two records are one in memory.
macro_rules! same {
    ($($own:ty, $other:ty: $($field:ident)*;)*) => {
        $(const _: () = {
            assert!(size_of::<$own>() == size_of::<$other>());
            assert!(align_of::<$own>() == align_of::<$other>());
            $(assert!(offset_of!($own, $field) == offset_of!($other, $field));)*
        };)*
    };
}

same! {
    Hit, HitOfMesh: t triangle u v;
    SceneHit, HitOfScene: t u v triangle geometry instance;
    ClosestPoint, OfMesh: distance_squared point triangle u v;
    SceneClosestPoint, OfScene: distance_squared point triangle u v geometry instance;
}
