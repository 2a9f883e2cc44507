//! The fast test in vectors, a triangle and a ray per lane: the operations of
//! [`splitplane_core::query::intersect::moeller_trumbore`] in their order, none of them fused, and so its numbers bit for bit.

use splitplane_core::ray::Culling;

use crate::simd::Simd;

/// Where rays meet triangles.
pub(crate) struct Meeting<S: Simd> {
    /// The lanes that do, as bits.
    pub met: u32,
    /// Inner `t`.
    pub t: S::Floats,
    /// Weights of the second corner and of the third.
    pub u: S::Floats,
    pub v: S::Floats,
}

/// Where rays meet triangles within inner limits. Origins, directions and corners are on the axes of the mesh.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn meet<S: Simd>(
    origin: [S::Floats; 3],
    direction: [S::Floats; 3],
    [a, b, c]: [[S::Floats; 3]; 3],
    [t_min, t_max]: [S::Floats; 2],
    culling: Culling,
) -> Meeting<S> {
    // SAFETY: the caller's contract.
    unsafe {
        let (ab, ac, ao) = (minus::<S>(b, a), minus::<S>(c, a), minus::<S>(origin, a));
        let p = cross::<S>(direction, ac);
        // A determinant of 0 makes both weights infinite or NaN, which are not within 0 and 1.
        let det = dot::<S>(ab, p);
        let inverse = S::div(S::splat(1.0), det);
        let u = S::mul(dot::<S>(ao, p), inverse);
        let q = cross::<S>(ao, ab);
        let v = S::mul(dot::<S>(direction, q), inverse);
        let t = S::mul(dot::<S>(ac, q), inverse);
        let least = S::le(S::splat(0.0), S::min(u, v));
        let inside = S::and(least, S::le(S::add(u, v), S::splat(1.0)));
        let mut met = S::bits(S::and(inside, S::and(S::le(t_min, t), S::le(t, t_max))));
        match culling {
            Culling::None => {}
            Culling::Back => met &= S::bits(S::le(S::splat(0.0), det)),
            Culling::Front => met &= S::bits(S::le(det, S::splat(0.0))),
        }
        Meeting { met, t, u, v }
    }
}

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn minus<S: Simd>(p: [S::Floats; 3], q: [S::Floats; 3]) -> [S::Floats; 3] {
    // SAFETY: the caller's contract.
    unsafe { [S::sub(p[0], q[0]), S::sub(p[1], q[1]), S::sub(p[2], q[2])] }
}

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn cross<S: Simd>(p: [S::Floats; 3], q: [S::Floats; 3]) -> [S::Floats; 3] {
    // SAFETY: the caller's contract.
    unsafe {
        [
            S::sub(S::mul(p[1], q[2]), S::mul(p[2], q[1])),
            S::sub(S::mul(p[2], q[0]), S::mul(p[0], q[2])),
            S::sub(S::mul(p[0], q[1]), S::mul(p[1], q[0])),
        ]
    }
}

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn dot<S: Simd>(p: [S::Floats; 3], q: [S::Floats; 3]) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe { S::add(S::add(S::mul(p[0], q[0]), S::mul(p[1], q[1])), S::mul(p[2], q[2])) }
}
