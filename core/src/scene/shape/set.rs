//! Sets of shapes.

use alloc::sync::Arc;
use alloc::vec::Vec;
use core::fmt;

use super::ray::ShapeRay;
use crate::aabb::Aabb;
use crate::arithmetic::Strict;
use crate::ray::{Hit, Ray};
use crate::tree::digest::{Digest, Xxh64};
use bytemuck::{Pod, Zeroable};

/// A sphere. 16 bytes, the form in which it is kept in files.
///
/// One whose numbers are not finite or whose radius is not more than 0 (2^-124 at least, since a quarter of it must be a float) is left
/// out: no ray meets it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Sphere {
    /// Its centre.
    pub centre: [f32; 3],
    /// Its radius.
    pub radius: f32,
}

/// A capsule: all points within a radius of the segment between two ends, which may be one point. 28 bytes, the form in which
/// it is kept in files. It is left out where a sphere would be.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Capsule {
    /// The ends of the segment.
    pub ends: [[f32; 3]; 2],
    /// The radius.
    pub radius: f32,
}

/// The least radius that counts: 2^-124.
const LEAST_RADIUS: f32 = 4.701_977_4e-38;

fn round_shape_counts(points: &[[f32; 3]], radius: f32) -> bool {
    (LEAST_RADIUS..=f32::MAX).contains(&radius)
        && points.iter().flatten().all(|x| x.abs() <= f32::MAX)
}

impl Sphere {
    /// Whether rays can meet it.
    pub fn counts(&self) -> bool {
        round_shape_counts(&[self.centre], self.radius)
    }
}

impl Capsule {
    /// Whether rays can meet it.
    pub fn counts(&self) -> bool {
        round_shape_counts(&self.ends, self.radius)
    }
}

/// Where a ray meets a primitive of the user's own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeHit {
    /// Where on the ray, in units of its direction. It counts where it is finite and between the ray's limits.
    pub t: f32,
    /// Two numbers of the shape's, which hits carry.
    pub u: f32,
    /// The other one.
    pub v: f32,
    /// Whether the ray comes from the front, which culling tells from the back.
    pub front: bool,
}

/// A set of shapes of the user's own, in their object's space. The CPU backend answers rays through it; others refuse it by
/// [`SceneBuildError::OwnShapes`](crate::scene::SceneBuildError). So take that backend by its kind, not `auto`, which takes a GPU where a machine has one.
///
/// Rules. All functions are pure: for the same arguments they give the same results, on every thread. `bounds` holds every
/// place where `intersect` finds a hit: the ray's point at its `t`, to within [`SHAPE_SLACK`](super::SHAPE_SLACK), which is room
/// enough for ordinary arithmetic in `f32`. Hits do not depend on the ray's limits, except that those beyond them are not needed. Where a rule
/// is broken, nothing is promised but that queries end, if the functions do.
///
/// A set that changes is another set: see [`Scene::replace_shapes`](crate::scene::Scene::replace_shapes).
///
/// ```
/// use splitplane_core::aabb::Aabb;
/// use splitplane_core::ray::Ray;
/// use splitplane_core::scene::shape::{OwnShape, ShapeHit};
///
/// /// Squares of side 2 about the origin, across z, one above the other.
/// struct Sheets(u32);
///
/// impl OwnShape for Sheets {
///     fn primitives(&self) -> u32 {
///         self.0
///     }
///
///     fn bounds(&self, primitive: u32) -> Aabb {
///         let z = primitive as f32;
///         Aabb { lo: [-1.0, -1.0, z], hi: [1.0, 1.0, z] }
///     }
///
///     fn intersect(&self, primitive: u32, ray: &Ray, show: &mut dyn FnMut(ShapeHit)) {
///         let [dx, dy, dz] = ray.direction;
///         let t = (primitive as f32 - ray.origin[2]) / dz;
///         let (u, v) = (ray.origin[0] + t * dx, ray.origin[1] + t * dy);
///         if u.abs() <= 1.0 && v.abs() <= 1.0 {
///             show(ShapeHit { t, u, v, front: dz < 0.0 });
///         }
///     }
/// }
/// ```
pub trait OwnShape: Send + Sync {
    /// How many primitives there are, below 2^28.
    fn primitives(&self) -> u32;

    /// The box of a primitive. One that is empty or not finite leaves the primitive out.
    fn bounds(&self, primitive: u32) -> Aabb;

    /// Shows all places where the ray meets a primitive, in any order.
    fn intersect(&self, primitive: u32, ray: &Ray, show: &mut dyn FnMut(ShapeHit));

    /// The direction outwards at a hit, in the object's space, of any length; for pictures. The point is the ray's own at the hit. Zero, the
    /// default, for one that faces the ray.
    fn normal(&self, primitive: u32, point: [f32; 3], u: f32, v: f32) -> [f32; 3] {
        let _ = (primitive, point, u, v);
        [0.0; 3]
    }
}

/// What a geometry consists of in place of triangles.
#[derive(Clone)]
pub enum Shapes {
    /// Spheres.
    Spheres(Vec<Sphere>),
    /// Capsules.
    Capsules(Vec<Capsule>),
    /// Shapes of the user's own.
    Own(Arc<dyn OwnShape>),
}

impl fmt::Debug for Shapes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.len(), self.name())
    }
}

impl Shapes {
    /// What they are, in the plural.
    pub const fn name(&self) -> &'static str {
        match self {
            Shapes::Spheres(_) => "spheres",
            Shapes::Capsules(_) => "capsules",
            Shapes::Own(_) => "own shapes",
        }
    }

    /// How many primitives there are.
    pub fn len(&self) -> usize {
        match self {
            Shapes::Spheres(spheres) => spheres.len(),
            Shapes::Capsules(capsules) => capsules.len(),
            Shapes::Own(own) => own.primitives() as usize,
        }
    }

    /// True for a set without primitives.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The box of a primitive, rounded outwards; `None` for one that is left out.
    pub fn bounds(&self, primitive: u32) -> Option<Aabb> {
        match self {
            Shapes::Spheres(spheres) => {
                let Sphere { centre, radius } = spheres.get(primitive as usize)?;
                round_shape_counts(&[*centre], *radius).then(|| round_box(&[*centre], *radius))
            }
            Shapes::Capsules(capsules) => {
                let Capsule { ends, radius } = capsules.get(primitive as usize)?;
                round_shape_counts(ends, *radius).then(|| round_box(ends, *radius))
            }
            Shapes::Own(own) => {
                let Aabb { lo, hi } = own.bounds(primitive);
                let finite = lo.iter().chain(&hi).all(|x| x.abs() <= f32::MAX);
                (finite && (0..3).all(|axis| lo[axis] <= hi[axis])).then_some(Aabb { lo, hi })
            }
        }
    }

    /// Shows the hits of a ray with a primitive that is not left out, between the ray's limits, and whether each comes from the front. `ready` is the
    /// ray, made ready.
    #[inline]
    pub fn intersect(
        &self,
        primitive: u32,
        ray: &Ray,
        ready: &ShapeRay,
        mut show: impl FnMut(Hit, bool),
    ) {
        let mut take = |t: f32, u, v, front| {
            if ray.t_min <= t && t <= ray.t_max && t.abs() <= f32::MAX {
                show(Hit { t, triangle: primitive, u, v }, front);
            }
        };
        let at = primitive as usize;
        let span = match self {
            Shapes::Spheres(all) => all.get(at).and_then(|own| own.span::<Strict>(ready)),
            Shapes::Capsules(all) => all.get(at).and_then(|own| own.span::<Strict>(ready)),
            Shapes::Own(own) => {
                own.intersect(primitive, ray, &mut |ShapeHit { t, u, v, front }| {
                    // Devices and files know one zero.
                    take(crate::arithmetic::snap(t), u, v, front);
                });
                return;
            }
        };
        if let Some(span) = span {
            take(span.t[0], span.u[0], 0.0, true);
            take(span.t[1], span.u[1], 0.0, false);
        }
    }

    /// The direction outwards at a point of a primitive, in the object's space, of any length; zero where there is none.
    pub fn normal(&self, primitive: u32, point: [f32; 3], u: f32, v: f32) -> [f32; 3] {
        let from = |centre: [f64; 3]| {
            // Halves, whose differences do not overflow.
            [0, 1, 2].map(|k| (0.5 * f64::from(point[k]) - 0.5 * centre[k]) as f32)
        };
        match self {
            Shapes::Spheres(all) => {
                all.get(primitive as usize).map_or([0.0; 3], |own| from(own.centre.map(f64::from)))
            }
            Shapes::Capsules(all) => all.get(primitive as usize).map_or([0.0; 3], |own| {
                let [a, b] = own.ends.map(|end| end.map(f64::from));
                from([0, 1, 2].map(|k| a[k] + f64::from(u) * (b[k] - a[k])))
            }),
            Shapes::Own(own) => own.normal(primitive, point, u, v),
        }
    }

    /// Names the set: XXH64 with seed 2 over its kind (3 spheres, 4 capsules, 5 own shapes), how many there are, and their numbers; of shapes
    /// of the user's own their boxes, since a digest cannot see into functions.
    pub fn digest(&self) -> Digest {
        let mut state = Xxh64::new(2);
        state.write_words(&[self.kind(), self.len() as u32]);
        match self {
            Shapes::Spheres(all) => state.write_words(bytemuck::cast_slice(all)),
            Shapes::Capsules(all) => state.write_words(bytemuck::cast_slice(all)),
            Shapes::Own(own) => {
                for primitive in 0..own.primitives() {
                    let Aabb { lo, hi } = own.bounds(primitive);
                    state.write_words(&lo.map(f32::to_bits));
                    state.write_words(&hi.map(f32::to_bits));
                }
            }
        }
        Digest(state.finish())
    }

    /// The kind, as files and digests number it: meshes are 1 and 2.
    pub(crate) const fn kind(&self) -> u32 {
        match self {
            Shapes::Spheres(_) => 3,
            Shapes::Capsules(_) => 4,
            Shapes::Own(_) => 5,
        }
    }
}

/// A box around points and a radius, rounded outwards, within the floats.
fn round_box(points: &[[f32; 3]], radius: f32) -> Aabb {
    let mut bounds = Aabb::EMPTY;
    for point in points {
        for (axis, &x) in point.iter().enumerate() {
            // Sums of two floats round in `f64` by far less than a float, which the next float covers.
            let (lo, hi) = (f64::from(x) - f64::from(radius), f64::from(x) + f64::from(radius));
            let lo = (lo as f32).next_down().max(-f32::MAX);
            let hi = (hi as f32).next_up().min(f32::MAX);
            bounds.lo[axis] = bounds.lo[axis].min(lo);
            bounds.hi[axis] = bounds.hi[axis].max(hi);
        }
    }
    bounds
}
