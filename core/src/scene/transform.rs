//! Affine transforms, their inverses, and rays in an object's space.

use crate::aabb::Aabb;
use crate::arithmetic::{Arithmetic, Strict, snap};
use crate::ray::Ray;

/// An affine transform from an object's space to the world: three rows of four. A point `p` goes to
/// `row[0] p_x + row[1] p_y + row[2] p_z + row[3]`, row by row. The form of transforms of instances in Vulkan, wgpu and
/// DXR.
pub type Transform = [[f32; 4]; 3];

/// The transform that leaves everything where it is.
pub const IDENTITY: Transform = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// The transform that moves by a vector.
pub const fn translation(by: [f32; 3]) -> Transform {
    [[1.0, 0.0, 0.0, by[0]], [0.0, 1.0, 0.0, by[1]], [0.0, 0.0, 1.0, by[2]]]
}

/// How far a transform times its inverse is from the identity, by rows.
pub(crate) type Defect = [[f64; 4]; 3];

/// The way from the world into an object's space: the inverse of its transform.
///
/// The inverse is made in `f64`, by cofactors in a stated order, and rounded to `f32` once; components below 2^-126
/// are +0. It is the same on every platform, and part of the digest of a scene.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectSpace {
    /// From the world to the object.
    pub inverse: Transform,
    /// Whether the transform is a reflection: fronts are then seen as backs.
    pub mirrored: bool,
}

impl ObjectSpace {
    /// The space of a transform; `None` where it has no inverse that is finite in `f32` and, times the transform, within 1/8
    /// of the identity.
    pub fn new(transform: &Transform) -> Option<ObjectSpace> {
        ObjectSpace::with_defect(transform).map(|(space, _)| space)
    }

    /// The space of a transform with its [`ObjectSpace::defect`].
    #[inline]
    pub(crate) fn with_defect(transform: &Transform) -> Option<(ObjectSpace, Defect)> {
        let a = in_f64(transform);
        // Products of two `f32` are exact in `f64`; those of three neither overflow nor underflow.
        let minor = |r: [usize; 2], c: [usize; 2]| {
            a[r[0]][c[0]] * a[r[1]][c[1]] - a[r[0]][c[1]] * a[r[1]][c[0]]
        };
        // Cofactor of row r and column c: rows and columns in cyclic order have its sign in them.
        let cofactor =
            |r: usize, c: usize| minor([(r + 1) % 3, (r + 2) % 3], [(c + 1) % 3, (c + 2) % 3]);
        let mut cofactors = [[0.0; 3]; 3];
        for (r, row) in cofactors.iter_mut().enumerate() {
            for (c, own) in row.iter_mut().enumerate() {
                *own = cofactor(r, c);
            }
        }
        let first = cofactors[0];
        let determinant = (a[0][0] * first[0] + a[0][1] * first[1]) + a[0][2] * first[2];
        if determinant == 0.0 || !determinant.is_finite() {
            return None;
        }
        let mut inverse = [[0.0f32; 4]; 3];
        for row in 0..3 {
            let mut m = [0.0; 4];
            for column in 0..3 {
                m[column] = cofactors[column][row] / determinant;
            }
            m[3] = -((m[0] * a[0][3] + m[1] * a[1][3]) + m[2] * a[2][3]);
            for (to, from) in inverse[row].iter_mut().zip(m) {
                *to = snap(from as f32);
                if !to.is_finite() {
                    return None;
                }
            }
        }
        let space = ObjectSpace { inverse, mirrored: determinant < 0.0 };
        let off = space.defect(transform);
        let is_near = (0..3).all(|row| off[row][0] + off[row][1] + off[row][2] <= 0.125);
        is_near.then_some((space, off))
    }

    /// How far transform times inverse is from the identity: bounds on the magnitude of each component, and in the last
    /// column of where the object's origin comes back to.
    pub(crate) fn defect(&self, transform: &Transform) -> Defect {
        let (a, m) = (in_f64(transform), in_f64(&self.inverse));
        let mut off = [[0.0; 4]; 3];
        for (row, off) in off.iter_mut().enumerate() {
            let [x, y, z, w] = a[row];
            let mut own = [0.0, 0.0, 0.0, w];
            own[row] = -1.0;
            for column in 0..4 {
                let (p, q, r) = (x * m[0][column], y * m[1][column], z * m[2][column]);
                let sum = ((p + q) + r) + own[column];
                // Three sums, each off by less than 2^-53 of at most the sum of magnitudes.
                let magnitude = ((p.abs() + q.abs()) + r.abs()) + own[column].abs();
                off[column] = sum.abs() + magnitude * SUM_ERROR;
            }
        }
        off
    }

    /// The ray as the object sees it: origin and direction through the inverse, limits as they are. Each product and sum is
    /// guarded and snapped, in the order `((m0 x + m1 y) + m2 z) + m3`. The direction keeps its length: `t` is the same in
    /// both spaces.
    #[inline(always)]
    pub fn ray(&self, ray: &Ray) -> Ray {
        self.ray_in::<Strict>(ray)
    }

    /// [`ObjectSpace::ray`] in some arithmetic.
    #[inline(always)]
    pub fn ray_in<A: Arithmetic>(&self, ray: &Ray) -> Ray {
        let [x, y, z] = ray.direction;
        let (x, y, z) = (snap(x), snap(y), snap(z));
        let mut direction = [0.0; 3];
        // Loops, since closures over arrays are not compiled into who calls this.
        for (to, [m0, m1, m2, _]) in direction.iter_mut().zip(&self.inverse) {
            let two = A::snapped_sum(A::snapped_product(*m0, x), A::snapped_product(*m1, y));
            *to = A::snapped_sum(two, A::snapped_product(*m2, z));
        }
        Ray { origin: self.point_in::<A>(ray.origin), direction, ..*ray }
    }

    /// A point as the object sees it, by the same operations as a ray's origin.
    #[inline]
    pub fn point(&self, point: [f32; 3]) -> [f32; 3] {
        self.point_in::<Strict>(point)
    }

    /// [`ObjectSpace::point`] in some arithmetic.
    #[inline(always)]
    pub fn point_in<A: Arithmetic>(&self, point: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = point;
        let (x, y, z) = (snap(x), snap(y), snap(z));
        let mut seen = [0.0; 3];
        for (to, [m0, m1, m2, m3]) in seen.iter_mut().zip(&self.inverse) {
            let two = A::snapped_sum(A::snapped_product(*m0, x), A::snapped_product(*m1, y));
            *to = A::snapped_sum(A::snapped_sum(two, A::snapped_product(*m2, z)), *m3);
        }
        seen
    }
}

/// The same numbers. By loops, since closures over arrays are not compiled into who calls this.
pub(super) fn in_f64(rows: &Transform) -> [[f64; 4]; 3] {
    let mut wide = [[0.0; 4]; 3];
    for (wide, row) in wide.iter_mut().zip(rows) {
        for (wide, number) in wide.iter_mut().zip(row) {
            *wide = f64::from(*number);
        }
    }
    wide
}

/// Bounds on the relative error of a sum of four in `f64`, with room to spare.
pub(super) const SUM_ERROR: f64 = 1.0 / (1u64 << 50) as f64;

/// A box around the transformed box, in `f64`, rounded outwards: lower and upper ends. The box must not be empty.
pub(crate) fn transformed(transform: &Transform, bounds: &Aabb) -> [[f64; 3]; 2] {
    let mut ends = [[0.0; 3]; 2];
    for row in 0..3 {
        let own = f64::from(transform[row][3]);
        let (mut lo, mut hi, mut magnitude) = (own, own, own.abs());
        for axis in 0..3 {
            let a = f64::from(transform[row][axis]);
            let (from, to) = (a * f64::from(bounds.lo[axis]), a * f64::from(bounds.hi[axis]));
            let is_ascending = from < to;
            lo += if is_ascending { from } else { to };
            hi += if is_ascending { to } else { from };
            magnitude += if from.abs() < to.abs() { to.abs() } else { from.abs() };
        }
        ends[0][row] = lo - magnitude * SUM_ERROR;
        ends[1][row] = hi + magnitude * SUM_ERROR;
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::Hostile;

    #[test]
    fn identity_and_translations_are_exact() {
        let space = ObjectSpace::new(&IDENTITY).expect("an inverse");
        let ray = Ray::new([1.5, -0.0, 3.25], [0.5, -1.0, -0.0]).with_limits(-1.0, 7.0);
        let seen = space.ray(&ray);
        assert_eq!((seen, space.mirrored), (ray, false));
        let space = ObjectSpace::new(&translation([4.0, -8.0, 0.5])).expect("an inverse");
        assert_eq!(space.inverse, translation([-4.0, 8.0, -0.5]));
        assert_eq!(space.ray(&ray).origin, [-2.5, 8.0, 2.75]);
        assert_eq!(space.ray(&ray).direction, ray.direction);
    }

    #[test]
    fn mirrors_and_flat_transforms_are_told() {
        let scale = |x: f32, y, z| [[x, 0.0, 0.0, 1.0], [0.0, y, 0.0, 2.0], [0.0, 0.0, z, 3.0]];
        let mirrored = |t: &Transform| ObjectSpace::new(t).map(|space| space.mirrored);
        assert_eq!(mirrored(&scale(1.0, 2.0, 3.0)), Some(false));
        assert_eq!(mirrored(&scale(-1.0, 2.0, 3.0)), Some(true));
        assert_eq!(mirrored(&scale(-1.0, -2.0, 3.0)), Some(false));
        assert_eq!(mirrored(&scale(1e-6, 1e6, 1.0)), Some(false));
        assert_eq!(mirrored(&scale(0.0, 2.0, 3.0)), None);
        assert_eq!(mirrored(&scale(1e-39, 2.0, 3.0)), None, "its inverse is beyond the floats");
        // Two rows that only the last bit tells apart: an inverse, but none that f32 can hold.
        let near = 1.0f32.next_up();
        let flat = [[1.0, 1.0, 0.0, 0.0], [1.0, near, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        assert_eq!(mirrored(&flat), Some(false), "whole numbers are held");
        let flat = [[0.7, 0.3, 0.11, 0.0], [0.7, 0.3, 0.110_000_01, 0.0], [0.1, 0.7, 0.3, 0.0]];
        assert_eq!(mirrored(&flat), None);
    }

    /// A device that flushes subnormals and disturbs free operations sees the same ray.
    #[test]
    fn rays_are_seen_alike_under_hostile_arithmetic() {
        let mut state = 7u64;
        let mut next = || {
            state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1);
            let magnitude = ((state >> 40) as f32 / (1u64 << 23) as f32) - 1.0;
            magnitude * crate::arithmetic::power_of_two((state >> 33 & 127) as i32 - 90)
        };
        let mut inverses = 0;
        for _ in 0..20_000 {
            let transform = [(); 3].map(|()| [(); 4].map(|()| next()));
            let ray = Ray::new([(); 3].map(|()| next()), [(); 3].map(|()| next()));
            let Some(space) = ObjectSpace::new(&transform) else { continue };
            let (strict, hostile) = (space.ray(&ray), space.ray_in::<Hostile>(&ray));
            assert_eq!(bytemuck::bytes_of(&strict), bytemuck::bytes_of(&hostile), "{transform:?}");
            inverses += 1;
        }
        assert!(inverses > 10_000, "{inverses}");
    }
}
