//! Geometries that are not meshes: spheres, capsules, and shapes of the user's own.
//!
//! A ray meets a *primitive* of a set of shapes as it meets a triangle of a mesh: hits name it in the field `triangle`, and the least
//! (t, instance, triangle) wins. The tree over a set is the builder over boxes that also serves instances
//! ([`TopTree`](super::TopTree)); no hit depends on it.
//!
//! Spheres and capsules are intersected in stated, guarded arithmetic, the same for all accuracies ([`ShapeRay`]).
//! `docs/design/scenes.md` derives by how much it errs.

mod capsule;
mod ray;
mod set;
mod sphere;

pub use ray::{ShapeRay, Span};
pub use set::{Capsule, OwnShape, ShapeHit, Shapes, Sphere};

/// How far the ray's own point at the `t` of a hit may be from the box of the primitive: this part of (the greatest component of the
/// ray's origin, and of the box, and its greatest extent). 2^-16. Sets of the user's own keep it too.
pub const SHAPE_SLACK: f64 = 256.0 / (1u64 << 24) as f64;
