//! What a ray meets in a scene, and the handles that name it.

use bytemuck::{Pod, Zeroable};

use crate::ray::Hit;

/// Greatest number of instances, and of geometries, of one scene.
pub const MAX_INSTANCES: usize = 1 << 28;

/// The most levels of an opacity mask.
pub const MAX_OPACITY_LEVEL: u32 = 12;

/// Names a geometry of a scene. The name of a removed geometry may be given to a later one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GeometryId(pub u32);

/// Names an instance of a scene. The name of a removed instance may be given to a later one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct InstanceId(pub u32);

/// Where a ray meets a triangle of an instance, or a primitive of a geometry of [shapes](super::shape), or [`SceneHit::MISS`]. 24 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SceneHit {
    /// Distance in units of the ray's direction; infinity for a miss.
    pub t: f32,
    /// Barycentric weight of the second corner, in `[0, 1]`. Of a capsule how far along its axis the hit is, from 0 at the first end to 1; of a
    /// sphere 0.
    pub u: f32,
    /// Barycentric weight of the third corner, in `[0, 1]`; of spheres and capsules 0.
    pub v: f32,
    /// Index of the triangle in the geometry's mesh, or of the primitive among its shapes; `u32::MAX` for a miss.
    pub triangle: u32,
    /// The geometry ([`GeometryId`]); `u32::MAX` for a miss.
    pub geometry: u32,
    /// The instance ([`InstanceId`]); `u32::MAX` for a miss.
    pub instance: u32,
}

impl SceneHit {
    /// The record of a miss.
    pub const MISS: SceneHit = SceneHit {
        t: f32::INFINITY,
        u: 0.0,
        v: 0.0,
        triangle: u32::MAX,
        geometry: u32::MAX,
        instance: u32::MAX,
    };

    /// A geometry's hit as one of an instance of it; a miss where that is one.
    #[inline]
    pub fn of(hit: &Hit, geometry: GeometryId, instance: InstanceId) -> SceneHit {
        if !hit.is_hit() {
            return SceneHit::MISS;
        }
        let Hit { t, triangle, u, v } = *hit;
        SceneHit { t, u, v, triangle, geometry: geometry.0, instance: instance.0 }
    }

    /// True for a triangle that was hit.
    pub fn is_hit(&self) -> bool {
        self.instance != u32::MAX
    }

    /// `None` for a miss.
    pub fn some(self) -> Option<SceneHit> {
        self.is_hit().then_some(self)
    }

    /// True when this hit comes before `other`: lesser `t`, then the lower instance, then the lower triangle. The order
    /// that every query of a scene minimises.
    #[inline]
    pub fn precedes(&self, other: &SceneHit) -> bool {
        self.t < other.t
            || (self.t == other.t
                && (self.instance, self.triangle) < (other.instance, other.triangle))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hits_are_ordered_by_distance_instance_and_triangle() {
        let hit = |t, instance, triangle| SceneHit { t, instance, triangle, ..SceneHit::MISS };
        let ascending =
            [hit(1.0, 3, 9), hit(2.0, 1, 5), hit(2.0, 1, 6), hit(2.0, 2, 0), SceneHit::MISS];
        for (i, a) in ascending.iter().enumerate() {
            for (j, b) in ascending.iter().enumerate() {
                assert_eq!(a.precedes(b), i < j, "{a:?} {b:?}");
            }
        }
        assert_eq!(SceneHit::of(&Hit::MISS, GeometryId(0), InstanceId(0)), SceneHit::MISS);
        assert!(SceneHit::MISS.some().is_none() && hit(1.0, 0, 0).some().is_some());
    }
}
