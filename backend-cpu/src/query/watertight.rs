//! The watertight test in vectors, a triangle and a ray a lane: one ray against the triangles of a block
//! ([`super::leaf`]), or the rays of a packet against one triangle ([`super::packet`]).
//!
//! The operations are those of [`splitplane_core::intersect::watertight`] in its order, so all numbers
//! are the reference's bit for bit. Rays must not be wide.

use splitplane_core::intersect::{EDGE_LEAST, INTERPOLATION_ERROR};
use splitplane_core::ray::Culling;

use super::plane::Plane;
use super::simd::Simd;

/// A corner of triangles as rays see it.
#[derive(Clone, Copy)]
pub(crate) struct Corner<S: Simd> {
    /// Where it is from the ray's origin, on the sheared axes.
    pub from: [S::Floats; 3],
    /// Sheared coordinates: those of the ray are 0.
    pub flat: [S::Floats; 2],
    /// Inner `t`.
    pub depth: S::Floats,
}

/// # Safety
/// All methods: the processor must have the set.
impl<S: Simd> Corner<S> {
    /// A corner at `at`, of rays from `origin`, all on the sheared axes.
    #[inline(always)]
    pub unsafe fn new(
        at: [S::Floats; 3],
        origin: [S::Floats; 3],
        shear: [S::Floats; 3],
    ) -> Corner<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let x = S::sub(at[0], origin[0]);
            let y = S::sub(at[1], origin[1]);
            let z = S::sub(at[2], origin[2]);
            let flat = [S::sub(x, S::mul(shear[0], z)), S::sub(y, S::mul(shear[1], z))];
            Corner { from: [x, y, z], flat, depth: S::mul(shear[2], z) }
        }
    }

    /// How far it is on the axis where it is farthest.
    #[inline(always)]
    pub unsafe fn reach(&self) -> S::Floats {
        let [x, y, z] = self.from;
        // SAFETY: the caller's contract.
        unsafe { S::magnitude(S::magnitude(x, y), z) }
    }

    /// The same of its sheared coordinates.
    #[inline(always)]
    pub unsafe fn width(&self) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe { S::magnitude(self.flat[0], self.flat[1]) }
    }
}

/// Triangles as rays see them.
///
/// # Safety
/// All methods: the processor must have the set.
pub(crate) trait View<S: Simd> {
    /// Sheared coordinates of the corners: x of all three, then y.
    unsafe fn flat(&self) -> [[S::Floats; 3]; 2];
    /// Inner `t` of the corners.
    unsafe fn depths(&self) -> [S::Floats; 3];
    /// The greatest [`Corner::reach`].
    unsafe fn reach(&self) -> S::Floats;
    /// The greatest [`Corner::width`].
    unsafe fn width(&self) -> S::Floats;
    /// What a closer look needs.
    unsafe fn plane(&self) -> Plane<S>;
}

/// Inner `t` that count.
#[derive(Clone, Copy)]
pub(crate) struct Span<S: Simd> {
    /// The rays' limits.
    pub t_min: S::Floats,
    pub t_max: S::Floats,
    /// At most `t_max`: nothing beyond it can precede the best hit so far.
    pub stop: S::Floats,
}

/// Where rays meet triangles, a bit or a number a lane. Numbers count only where a bit says so.
pub(crate) struct Meeting<S: Simd> {
    /// Where the reference test gives a hit.
    pub met: u32,
    /// Where it may, by a look at the plane.
    pub unclear: u32,
    /// Inner `t` of the hit.
    pub t: S::Floats,
    /// Edge functions opposite the second and the third corner, and the sum of all three.
    pub v: S::Floats,
    pub w: S::Floats,
    pub det: S::Floats,
    /// Inner `t` of the nearest and the farthest corner.
    depths: [S::Floats; 2],
}

/// Edge functions opposite the first, second and third corner: twice the signed areas of triangles of
/// the ray and two sheared corners.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
unsafe fn edges<S: Simd>([[ax, bx, cx], [ay, by, cy]]: [[S::Floats; 3]; 2]) -> [S::Floats; 3] {
    // SAFETY: the caller's contract.
    unsafe {
        [
            S::sub(S::mul(cx, by), S::mul(cy, bx)),
            S::sub(S::mul(ax, cy), S::mul(ay, cx)),
            S::sub(S::mul(bx, ay), S::mul(by, ax)),
        ]
    }
}

/// Where no two edge functions have different signs.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
unsafe fn of_one_sign<S: Simd>([u, v, w]: [S::Floats; 3]) -> u32 {
    // SAFETY: the caller's contract.
    unsafe {
        let (least, most) = (S::min(u, S::min(v, w)), S::max(u, S::max(v, w)));
        let below = S::le(least, S::splat(-EDGE_LEAST));
        let above = S::le(S::splat(EDGE_LEAST), most);
        !S::bits(S::and(below, above))
    }
}

/// Where the edges of the triangle enclose the ray.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
pub(crate) unsafe fn enclosed<S: Simd, V: View<S>>(view: &V) -> u32 {
    // SAFETY: the caller's contract.
    unsafe { of_one_sign::<S>(edges::<S>(view.flat())) }
}

/// The test of some lanes, but for a look at the plane. Most often no triangle's edges enclose the ray
/// with corners that reach into its limits: then there is nothing more to do.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
pub(crate) unsafe fn meet<S: Simd, V: View<S>>(
    view: &V,
    of: u32,
    span: &Span<S>,
    culling: Culling,
) -> Option<Meeting<S>> {
    // SAFETY: the caller's contract.
    unsafe {
        let flat = view.flat();
        let [u, v, w] = edges::<S>(flat);
        let [da, db, dc] = view.depths();
        let nearest = S::min(da, S::min(db, dc));
        let farthest = S::max(da, S::max(db, dc));
        let reached = S::and(S::le(span.t_min, farthest), S::le(nearest, span.stop));
        let mut bits = of & S::bits(reached) & of_one_sign::<S>([u, v, w]);
        if bits == 0 {
            return None;
        }
        let (u, v, w) = (counts::<S>(u), counts::<S>(v), counts::<S>(w));
        let det = S::add(S::add(u, v), w);
        bits &= not_beside::<S>(flat) & faces::<S>(det, culling);
        let sum = S::add(S::add(S::mul(u, da), S::mul(v, db)), S::mul(w, dc));
        let interpolated = S::div(sum, det);
        let spread = S::sub(farthest, nearest);
        let disorder = S::mul(S::mul(view.reach(), view.width()), spread);
        let fine = S::bits(S::le(disorder, S::mul(S::splat(8.0), S::abs(sum))));
        let depths = [nearest, farthest];
        let (t, kept) = held::<S>(interpolated, depths, span);
        let mut meeting = Meeting { met: bits & fine & kept, unclear: 0, t, v, w, det, depths };
        if bits & !fine != 0 {
            // Of those many are let go as the reference does: the ones that rays start on.
            let part = S::div(disorder, S::abs(det));
            let error = S::mul(part, S::splat(INTERPOLATION_ERROR));
            let early = S::sub(interpolated, error);
            let after = S::le(span.t_min, S::add(interpolated, error));
            let before = S::le(early, span.t_max);
            // Nothing is further off than the farthest corner, whatever the error.
            let soon = S::le(S::min(farthest, early), span.stop);
            meeting.unclear = bits & !fine & S::bits(S::and(S::and(after, before), soon));
        }
        Some(meeting)
    }
}

impl<S: Simd> Meeting<S> {
    /// Decides what is unclear, but for triangles without a plane and rays within it.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(always)]
    pub unsafe fn look_closely<V: View<S>>(&mut self, view: &V, span: &Span<S>) {
        // SAFETY: the caller's contract.
        unsafe {
            let (t, there) = S::apart(&view.plane());
            let (t, kept) = held::<S>(t, self.depths, span);
            self.met |= self.unclear & there & kept;
            self.t = S::select(S::mask(self.unclear & there), t, self.t);
            self.unclear &= !there;
        }
    }
}

/// `t` held between the nearest and the farthest corner, and where it is within the span.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
unsafe fn held<S: Simd>(
    t: S::Floats,
    [nearest, farthest]: [S::Floats; 2],
    span: &Span<S>,
) -> (S::Floats, u32) {
    // SAFETY: the caller's contract.
    unsafe {
        let t = S::min(S::max(t, nearest), farthest);
        (t, S::bits(S::and(S::le(span.t_min, t), S::le(t, span.stop))))
    }
}

/// Where the ray is within the bounds of the sheared corners.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
unsafe fn not_beside<S: Simd>([[ax, bx, cx], [ay, by, cy]]: [[S::Floats; 3]; 2]) -> u32 {
    // SAFETY: the caller's contract.
    unsafe {
        let least = S::max(S::min(ax, S::min(bx, cx)), S::min(ay, S::min(by, cy)));
        let most = S::min(S::max(ax, S::max(bx, cx)), S::max(ay, S::max(by, cy)));
        let zero = S::splat(0.0);
        S::bits(S::and(S::le(least, zero), S::le(zero, most)))
    }
}

/// Where the triangle has an area and is not culled.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
unsafe fn faces<S: Simd>(det: S::Floats, culling: Culling) -> u32 {
    // SAFETY: the caller's contract.
    unsafe {
        let zero = S::splat(0.0);
        let (not_front, not_back) = (S::bits(S::le(det, zero)), S::bits(S::le(zero, det)));
        match culling {
            Culling::None => !(not_front & not_back),
            Culling::Back => !not_front,
            Culling::Front => !not_back,
        }
    }
}

/// 0 for an edge function that counts as 0.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
unsafe fn counts<S: Simd>(x: S::Floats) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe { S::keep(S::le(S::splat(EDGE_LEAST), S::abs(x)), x) }
}
