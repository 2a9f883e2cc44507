//! The wide triangle test: which triangles of a block hold a hit, and where.

use super::triangle_block::{TriangleBlock, Vectors, WrittenBlock};
use core::hint::{assert_unchecked, black_box};

use splitplane_core::arithmetic::{Strict, power_of_two, snap};
use splitplane_core::query::intersect::{
    Candidate, PreparedRay, moeller_trumbore, stop_after, watertight,
};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions};
use splitplane_core::triangle::Triangle;

use super::fast;
use super::keep::{Keep, KeepAll};
use super::ray_state::RayState;
use super::refined::Pairs;
use super::watertight::{Corner, Met, Span, View, meet};
use crate::simd::{Compiled, MOST_LANES, Simd};

/// The best hit so far and what follows from it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BestHit {
    /// The hit, in the caller's units.
    pub hit: Hit,
    /// Inner `t` beyond which nothing can precede it.
    pub stop: f32,
}

impl BestHit {
    /// No hit yet.
    pub(crate) const NONE: BestHit = BestHit { hit: Hit::MISS, stop: f32::INFINITY };

    /// Takes a candidate if it is within the caller's limits and comes before. True when it does, and
    /// for any hit that is the end.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn take(&mut self, ray: &PreparedRay, found: &Candidate, triangle: u32) -> bool {
        self.take_kept(ray, found, triangle, KeepAll)
    }

    /// The same, if it counts.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn take_kept<K: Keep>(
        &mut self,
        ray: &PreparedRay,
        found: &Candidate,
        triangle: u32,
        keep: K,
    ) -> bool {
        let Some(t) = ray.outer_t::<Strict>(found.t) else { return false };
        let hit = Hit { t, triangle, u: found.u, v: found.v };
        let better = hit.precedes(&self.hit) && keep.keeps(&hit);
        if better {
            *self = BestHit { hit, stop: ray.stop_after(found.t, t) };
        }
        better
    }
}

/// Decides one triangle by the reference test.
#[inline]
pub(crate) fn decide(
    ray: &PreparedRay,
    triangle: &Triangle,
    options: &QueryOptions<'_>,
) -> Option<Candidate> {
    match options.accuracy {
        Accuracy::Fast => moeller_trumbore::<Strict>(ray, triangle, options.culling),
        _ => watertight::<Strict>(ray, triangle, options.culling),
    }
}

/// Tests one triangle, for rays that the vector code does not handle. True when the best hit
/// changed.
pub(crate) fn test_one(
    ray: &PreparedRay,
    corners: &Triangle,
    triangle: u32,
    options: &QueryOptions<'_>,
    best: &mut BestHit,
) -> bool {
    if options.ignore == Some(triangle) {
        return false;
    }
    decide(ray, corners, options).is_some_and(|found| best.take(ray, &found, triangle))
}

/// Tests a block. True when the best hit changed, which for any hit is the end. The ray must not be wide. Hits that do not count are not taken.
///
/// # Safety
/// The processor must have the set, and a block of its width must follow the triangles' words.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn test<S: Simd, T: TriangleBlock, K: Keep>(
    ray_state: &RayState,
    block: &T,
    (options, query, keep): (&QueryOptions<'_>, Query, K),
    best: &mut BestHit,
) -> bool {
    let limit = if best.stop < ray_state.t_max { best.stop } else { ray_state.t_max };
    let any = query == Query::Any;
    // SAFETY: the caller's contract.
    unsafe {
        if options.accuracy == Accuracy::Fast {
            let meeting = meet_fast::<S, T>(ray_state, block, limit, options.culling);
            if meeting.met == 0 {
                return false;
            }
            let mut found = Found { met: meeting.met, t: NO_ROW, u: NO_ROW, v: NO_ROW };
            S::store(found.t.as_mut_ptr(), meeting.t);
            S::store(found.u.as_mut_ptr(), meeting.u);
            S::store(found.v.as_mut_ptr(), meeting.v);
            return take_found(ray_state, *block, (options, query, keep), &found, best);
        }
        let seen = ShearedBlock::<S, T>::new(ray_state, block);
        // Lanes after the last triangle do not count.
        let mut there = (1u32 << block.count()) - 1;
        if !any {
            // A leaf behind the best hit often has its triangle too, and would give the same `t`.
            there &= !S::equal(block.triangles(), best.hit.triangle);
        }
        let meeting = meet(&seen, there, &span::<S>(ray_state, limit), options.culling);
        let Some(mut meeting) = meeting else { return false };
        if meeting.met | meeting.unclear == 0 {
            return false;
        }
        // For any hit those that are met come first.
        if meeting.unclear & meeting.robust != 0 && !(any && meeting.met != 0) {
            let mut met = Met::of(&meeting);
            S::call(CloserLook { ray_state, block: *block, limit, met: &mut met });
            meeting = met.meeting();
            if meeting.met | meeting.unclear == 0 {
                return false;
            }
        }
        // From registers, and without a branch on whether there are several: half of the blocks
        // that are met have several, and no predictor could tell which.
        let nearest = if any { meeting.met } else { meeting.nearest() };
        // Nearly always there is one triangle that is nearer than all others.
        let one =
            if any { nearest != 0 } else { meeting.unclear == 0 && nearest.is_power_of_two() };
        // Of moved rays different inner `t` may be one to the caller, or beyond the limits.
        if K::ALL && one && options.ignore.is_none() && ray_state.offset == 0.0 {
            let index = nearest.trailing_zeros() as usize % S::N;
            let inner = S::lane(meeting.t, index);
            let t = inner * power_of_two(-ray_state.exponent);
            // What was flushed or clamped may be the same for others too.
            if (f32::MIN_POSITIVE..f32::MAX).contains(&t.abs()) {
                // Nobody asks where in the triangle any hit is.
                let (mut u, mut v) = (0.0, 0.0);
                if !any {
                    let det = S::lane(meeting.det, index);
                    u = snap(S::lane(meeting.v, index) / det);
                    v = snap(S::lane(meeting.w, index) / det);
                }
                let hit = Hit { t, triangle: block.triangle(index), u, v };
                let better =
                    ray_state.limits[0] <= t && t <= ray_state.limits[1] && hit.precedes(&best.hit);
                if better {
                    *best = BestHit { hit, stop: stop_after(inner) };
                }
                if better || !any {
                    return better;
                }
            }
        }
        test_sifted(ray_state, *block, (options, query, keep), &Met::of(&meeting), best)
    }
}

/// [`test()`] of a block that is given as one with corners `written` out too where it is that. Those are tested in a function of their own: few
/// meshes have such blocks, and the test of the others must not lose registers to theirs.
///
/// # Safety
/// As for [`test()`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn test_either<S: Simd, T: TriangleBlock, K: Keep>(
    ray_state: &RayState,
    (block, written): (&T, Option<WrittenBlock<'_>>),
    how: (&QueryOptions<'_>, Query, K),
    best: &mut BestHit,
) -> bool {
    // SAFETY: the caller's contract.
    unsafe {
        if S::WRITES_OUT
            && let Some(block) = written
        {
            return if how.0.accuracy == Accuracy::Watertight {
                S::call(WrittenTest::<_, true> { ray_state, block, how, best })
            } else {
                S::call(WrittenTest::<_, false> { ray_state, block, how, best })
            };
        }
        test::<S, T, K>(ray_state, block, how, best)
    }
}

/// A test of a block with corners written out, of accuracy `watertight` or of any other.
struct WrittenTest<'a, K, const WATERTIGHT: bool> {
    ray_state: &'a RayState,
    block: WrittenBlock<'a>,
    how: (&'a QueryOptions<'a>, Query, K),
    best: &'a mut BestHit,
}

impl<K: Keep, const WATERTIGHT: bool> Compiled for WrittenTest<'_, K, WATERTIGHT> {
    /// Whether the best hit changed.
    type Output = bool;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> bool {
        let WrittenTest { ray_state, block, how, best } = self;
        // SAFETY: the caller's contract; the accuracy is what it says.
        unsafe {
            assert_unchecked((how.0.accuracy == Accuracy::Watertight) == WATERTIGHT);
            test::<S, _, K>(ray_state, &block, how, best)
        }
    }
}

/// The rest of [`test()`] where more than one triangle counts, or one that needs a closer look, or where a hit may not count.
#[inline(never)]
fn test_sifted<T: TriangleBlock, K: Keep>(
    ray_state: &RayState,
    block: T,
    (options, query, keep): (&QueryOptions<'_>, Query, K),
    sifted: &Met,
    best: &mut BestHit,
) -> bool {
    let ray = ray_state.ray();
    // Those that are met first: they may spare the others.
    let mut bits = u64::from(sifted.met) | u64::from(sifted.unclear) << 32;
    let mut better = false;
    while bits != 0 {
        let index = bits.trailing_zeros() as usize % 32;
        bits &= bits - 1;
        let triangle = block.triangle(index);
        if options.ignore == Some(triangle) {
            continue;
        }
        let found = if sifted.met >> index & 1 != 0 {
            sifted.candidate(index)
        } else {
            let Some(found) = decide(&ray, &block.corners(index), options) else { continue };
            found
        };
        if best.take_kept(&ray, &found, triangle, keep) {
            better = true;
            if query == Query::Any {
                return true;
            }
        }
    }
    better
}

/// A number of each triangle of a block.
type Row = [f32; MOST_LANES];
const NO_ROW: Row = [0.0; MOST_LANES];

/// What the fast test found: which triangles are met, and where.
struct Found {
    met: u32,
    t: Row,
    u: Row,
    v: Row,
}

/// Takes what the fast test found, as far as it precedes. True when the best hit changed.
#[inline(never)]
fn take_found<T: TriangleBlock, K: Keep>(
    ray_state: &RayState,
    block: T,
    (options, query, keep): (&QueryOptions<'_>, Query, K),
    found: &Found,
    best: &mut BestHit,
) -> bool {
    let ray = ray_state.ray();
    let (mut met, mut better) = (found.met, false);
    while met != 0 {
        let index = met.trailing_zeros() as usize % MOST_LANES;
        met &= met - 1;
        let triangle = block.triangle(index);
        if options.ignore == Some(triangle) {
            continue;
        }
        let candidate = Candidate { t: found.t[index], u: found.u[index], v: found.v[index] };
        if best.take_kept(&ray, &candidate, triangle, keep) {
            better = true;
            if query == Query::Any {
                return true;
            }
        }
    }
    better
}

/// The triangles of a block as a ray sees them. Work on a corner is done once for all triangles
/// that share it.
struct ShearedBlock<'a, S: Simd, T> {
    ray_state: &'a RayState,
    block: &'a T,
    places: [S::Places; 3],
    /// In as many vectors as [`TriangleBlock::VECTORS`].
    corners: [Corner<S>; 3],
}

impl<'a, S: Simd, T: TriangleBlock> ShearedBlock<'a, S, T> {
    /// # Safety
    /// As for [`test()`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn new(ray_state: &'a RayState, block: &'a T) -> ShearedBlock<'a, S, T> {
        // SAFETY: the caller's contract.
        unsafe {
            let axes = ray_state.bytes_to_axes();
            let (origin, shear) = (each::<S>(ray_state.origin), each::<S>(ray_state.shear));
            // Written out, so that they stay in registers; loops do not guarantee that.
            let first = Corner::new(coordinates::<S, T>(block, axes, 0), origin, shear);
            let second = Corner::new(coordinates::<S, T>(block, axes, 1), origin, shear);
            let third = if T::VECTORS > 2 {
                Corner::new(coordinates::<S, T>(block, axes, 2), origin, shear)
            } else {
                second
            };
            let corners = [first, second, third];
            ShearedBlock { ray_state, block, places: block.places::<S>(), corners }
        }
    }

    /// The greatest number of each triangle's corners.
    ///
    /// # Safety
    /// As for [`test()`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn greatest(&self, vectors: Vectors<S>) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe {
            let [a, b, c] = T::of_corners::<S>(vectors, self.places);
            S::max(a, S::max(b, c))
        }
    }
}

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn each<S: Simd>([x, y, z]: [f32; 3]) -> [S::Floats; 3] {
    // SAFETY: the caller's contract.
    unsafe { [S::splat(x), S::splat(y), S::splat(z)] }
}

/// Of three axes, as [`TriangleBlock::coordinates_at`] has them.
///
/// # Safety
/// As for [`test()`].
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn coordinates<S: Simd, T: TriangleBlock>(
    block: &T,
    [x, y, z]: [usize; 3],
    vector: usize,
) -> [S::Floats; 3] {
    // SAFETY: the caller's contract.
    unsafe {
        [
            block.coordinates_at::<S>(x, vector),
            block.coordinates_at::<S>(y, vector),
            block.coordinates_at::<S>(z, vector),
        ]
    }
}

/// The corners of all triangles, each on three axes, in this order.
///
/// # Safety
/// As for [`test()`].
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn all_corners<S: Simd, T: TriangleBlock>(
    block: &T,
    axes: [usize; 3],
    places: [S::Places; 3],
) -> [[S::Floats; 3]; 3] {
    // SAFETY: the caller's contract.
    unsafe {
        let mut corners = [[S::splat(0.0); 3]; 3];
        for (k, axis) in axes.into_iter().enumerate() {
            let second = block.coordinates::<S>(axis, 1);
            let third = if T::VECTORS > 2 { block.coordinates::<S>(axis, 2) } else { second };
            let vectors = [block.coordinates::<S>(axis, 0), second, third];
            let [a, b, c] = T::of_corners::<S>(vectors, places);
            (corners[0][k], corners[1][k], corners[2][k]) = (a, b, c);
        }
        corners
    }
}

impl<S: Simd, T: TriangleBlock> View<S> for ShearedBlock<'_, S, T> {
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn flat(&self) -> [[S::Floats; 3]; 2] {
        let [a, b, c] = &self.corners;
        // SAFETY: the caller's contract.
        unsafe {
            [
                T::of_corners::<S>([a.flat[0], b.flat[0], c.flat[0]], self.places),
                T::of_corners::<S>([a.flat[1], b.flat[1], c.flat[1]], self.places),
            ]
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn depths(&self) -> [S::Floats; 3] {
        let [a, b, c] = &self.corners;
        // SAFETY: the caller's contract.
        unsafe { T::of_corners::<S>([a.depth, b.depth, c.depth], self.places) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn reach(&self) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe {
            // Seldom: found anew, and so that the compiler does not keep for its sake what registers have no space for.
            let block = black_box(*self.block);
            let again = ShearedBlock::<S, T>::new(self.ray_state, &block);
            let [a, b, c] = &again.corners;
            again.greatest([a.reach(), b.reach(), c.reach()])
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn reach_at_most(&self, width: S::Floats, distance: S::Floats) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe {
            // Inner `t` of 1 is as far on the axis of the largest component.
            let largest = S::splat(self.ray_state.largest());
            S::add(width, S::abs(S::mul(distance, largest)))
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn width(&self, [low, high]: [S::Floats; 2]) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe { S::magnitude(low, high) }
    }
}

/// A closer look at the triangles that are unclear, seldom needed.
struct CloserLook<'a, T> {
    ray_state: &'a RayState,
    block: T,
    limit: f32,
    met: &'a mut Met,
}

impl<T: TriangleBlock> Compiled for CloserLook<'_, T> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let CloserLook { ray_state, block, limit, met } = self;
        // SAFETY: the caller's contract, and that of [`test()`].
        unsafe {
            let ray = ray_state.ray();
            let corners = all_corners::<S, T>(&block, [0, 1, 2], block.places::<S>());
            let (origin, direction) = (each::<S>(ray.origin), each::<S>(ray.direction));
            let mut meeting = met.meeting::<S>();
            let pairs = Pairs { origin, direction, corners };
            meeting.look_closely(pairs, &span::<S>(ray_state, limit));
            *met = Met::of(&meeting);
        }
    }
}

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn span<S: Simd>(ray_state: &RayState, limit: f32) -> Span<S> {
    // SAFETY: the caller's contract.
    let [t_min, t_max, stop] = unsafe { each::<S>([ray_state.t_min, ray_state.t_max, limit]) };
    Span { t_min, t_max, stop }
}

/// Where the fast test meets triangles of a block.
///
/// # Safety
/// As for [`test()`].
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn meet_fast<S: Simd, T: TriangleBlock>(
    ray_state: &RayState,
    block: &T,
    limit: f32,
    culling: Culling,
) -> fast::Meeting<S> {
    // SAFETY: the caller's contract.
    unsafe {
        let ray = ray_state.ray();
        let (origin, direction) = (each::<S>(ray.origin), each::<S>(ray.direction));
        let corners = all_corners::<S, T>(block, [0, 1, 2], block.places::<S>());
        let span = [S::splat(ray.t_min), S::splat(limit)];
        let mut meeting = fast::meet::<S>(origin, direction, corners, span, culling);
        // Lanes after the last triangle do not count.
        meeting.met &= (1u32 << block.count()) - 1;
        meeting
    }
}
