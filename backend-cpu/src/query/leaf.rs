//! The wide triangle test: which triangles of a block hold a hit, and where.

use splitplane_core::arithmetic::{Strict, power_of_two, snap};
use splitplane_core::intersect::{
    Candidate, EDGE_LEAST, INTERPOLATION_ERROR, PreparedRay, moeller_trumbore, watertight,
};
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions};
use splitplane_core::traverse::Query;
use splitplane_core::triangle::Triangle;

use super::blocks::Block;
use super::prepare::Way;
use super::record::Record;
use super::simd::{MOST_LANES, Simd};

/// Triangles that are tested at once, as the test reads them.
pub(crate) trait Triangles {
    /// Vectors that the corners' coordinates on an axis take.
    const VECTORS: usize;

    /// How many, at most as many as there are lanes.
    fn count(&self) -> usize;

    /// The index of a triangle in the mesh.
    fn triangle(&self, index: usize) -> u32;

    /// The corners of a triangle.
    fn corners(&self, index: usize) -> Triangle;

    /// A vector of coordinates on an axis.
    ///
    /// # Safety
    /// The processor must have the set, and a block of its width must follow what is there.
    unsafe fn coordinates<S: Simd>(&self, axis: usize, vector: usize) -> S::Floats;

    /// What finds the corners of the triangles in such vectors.
    ///
    /// # Safety
    /// As for [`Triangles::coordinates`].
    unsafe fn places<S: Simd>(&self) -> [S::Places; 3];

    /// What the triangles' corners have, of a number of each corner.
    ///
    /// # Safety
    /// The processor must have the set.
    unsafe fn of_corners<S: Simd>(vectors: Vectors<S>, places: [S::Places; 3]) -> [S::Floats; 3];
}

/// Corners are shared: the second vector is needed by some blocks only, but by which is not foreseen.
impl Triangles for Record<'_> {
    const VECTORS: usize = 2;

    #[inline(always)]
    fn count(&self) -> usize {
        Record::count(self)
    }

    #[inline(always)]
    fn triangle(&self, index: usize) -> u32 {
        Record::triangle(self, index)
    }

    #[inline(always)]
    fn corners(&self, index: usize) -> Triangle {
        Record::corners(self, index)
    }

    #[inline(always)]
    unsafe fn coordinates<S: Simd>(&self, axis: usize, vector: usize) -> S::Floats {
        // SAFETY: the caller's contract.
        unsafe { S::load(Record::coordinates(self, axis).wrapping_add(vector * S::N)) }
    }

    #[inline(always)]
    unsafe fn places<S: Simd>(&self) -> [S::Places; 3] {
        // SAFETY: the caller's contract.
        unsafe {
            [
                S::places(Record::places(self, 0)),
                S::places(Record::places(self, 1)),
                S::places(Record::places(self, 2)),
            ]
        }
    }

    #[inline(always)]
    unsafe fn of_corners<S: Simd>(
        [low, high, _]: Vectors<S>,
        places: [S::Places; 3],
    ) -> [S::Floats; 3] {
        // SAFETY: the caller's contract.
        unsafe { of_corners::<S>([low, high], places) }
    }
}

/// Corners are written out: one vector for the first ones, one for the second, one for the third.
impl Triangles for Block<'_> {
    const VECTORS: usize = 3;

    #[inline(always)]
    fn count(&self) -> usize {
        self.count
    }

    #[inline(always)]
    fn triangle(&self, index: usize) -> u32 {
        Block::triangle(self, index)
    }

    #[inline(always)]
    fn corners(&self, index: usize) -> Triangle {
        Block::corners(self, index)
    }

    #[inline(always)]
    unsafe fn coordinates<S: Simd>(&self, axis: usize, vector: usize) -> S::Floats {
        let row = (3 * vector + axis) * self.stride;
        // SAFETY: the caller's contract.
        unsafe { S::load(self.words.as_ptr().wrapping_add(row)) }
    }

    #[inline(always)]
    unsafe fn places<S: Simd>(&self) -> [S::Places; 3] {
        // SAFETY: the caller's contract. Nothing is looked up.
        unsafe { [S::places([0; MOST_LANES].as_ptr()); 3] }
    }

    #[inline(always)]
    unsafe fn of_corners<S: Simd>(vectors: Vectors<S>, _: [S::Places; 3]) -> [S::Floats; 3] {
        vectors
    }
}

/// The best hit so far and what follows from it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Best {
    /// The hit, in the caller's units.
    pub hit: Hit,
    /// Inner `t` beyond which nothing can precede it.
    pub stop: f32,
}

impl Best {
    /// No hit yet.
    pub const NONE: Best = Best { hit: Hit::MISS, stop: f32::INFINITY };

    /// Takes a candidate if it is within the caller's limits and comes before. True when it does, and
    /// for any hit that is the end.
    #[inline(always)]
    pub fn take(&mut self, ray: &PreparedRay, found: &Candidate, triangle: u32) -> bool {
        let Some(t) = ray.outer_t::<Strict>(found.t) else { return false };
        let hit = Hit { t, triangle, u: found.u, v: found.v };
        let better = hit.precedes(&self.hit);
        if better {
            *self = Best { hit, stop: ray.stop_after(found.t, t) };
        }
        better
    }
}

/// Decides one triangle by the reference test.
#[inline]
pub(crate) fn decide(
    ray: &PreparedRay,
    triangle: &Triangle,
    options: &QueryOptions,
) -> Option<Candidate> {
    match options.accuracy {
        Accuracy::Fast => moeller_trumbore::<Strict>(ray, triangle, options.culling),
        _ => watertight::<Strict>(ray, triangle, options.culling),
    }
}

/// Tests one triangle, for rays that vectors are not made for. True when the best hit changed.
pub(crate) fn test_one(
    ray: &PreparedRay,
    corners: &Triangle,
    triangle: u32,
    options: &QueryOptions,
    best: &mut Best,
) -> bool {
    if options.ignore == Some(triangle) {
        return false;
    }
    decide(ray, corners, options).is_some_and(|found| best.take(ray, &found, triangle))
}

/// What the wide test says of the triangles of a block, as bits.
#[repr(C, align(64))]
struct Sifted {
    /// Those that the reference test accepts; the numbers below are what it gives.
    met: u32,
    /// Those that it may accept: for it to decide.
    unclear: u32,
    /// Those of `met` with the least inner `t`.
    nearest: u32,
    /// Inner `t`; of `unclear` the least that it may be.
    t: [f32; MOST_LANES],
    /// Edge functions opposite the second and the third corner, and the sum of all three.
    v: [f32; MOST_LANES],
    w: [f32; MOST_LANES],
    det: [f32; MOST_LANES],
}

impl Sifted {
    /// Where the ray meets a triangle of `met`.
    #[inline(always)]
    fn candidate(&self, index: usize) -> Candidate {
        let [t, v, w, det] = [&self.t, &self.v, &self.w, &self.det].map(|row| row[index]);
        // Snapped, as in the reference test.
        Candidate { t, u: snap(v / det), v: snap(w / det) }
    }
}

/// Tests a block. True when the best hit changed, which for any hit is the end. The ray must not be wide.
///
/// # Safety
/// The processor must have the set, and a block of its width must follow the triangles' words.
#[inline(always)]
pub(crate) unsafe fn test<S: Simd, T: Triangles>(
    way: &Way,
    record: &T,
    options: &QueryOptions,
    query: Query,
    best: &mut Best,
) -> bool {
    let limit = if best.stop < way.t_max { best.stop } else { way.t_max };
    let row = [0.0; MOST_LANES];
    let t = [f32::NEG_INFINITY; MOST_LANES];
    let mut sifted = Sifted { met: 0, unclear: 0, nearest: 0, t, v: row, w: row, det: row };
    // SAFETY: the caller's contract.
    unsafe {
        match options.accuracy {
            Accuracy::Fast => sifted.unclear = fast::<S, T>(way, record, limit),
            _ => {
                let any = query == Query::Any;
                sift::<S, T>(way, record, limit, options.culling, any, &mut sifted);
            }
        }
    }
    // Nearly always there is nothing, or one triangle that is nearer than all others.
    if sifted.met | sifted.unclear == 0 {
        return false;
    }
    let one = sifted.nearest;
    if query == Query::Any && sifted.met != 0 && options.ignore.is_none() {
        let index = sifted.met.trailing_zeros() as usize % MOST_LANES;
        if best.take(&way.ray(), &sifted.candidate(index), record.triangle(index)) {
            return true;
        }
    } else if sifted.unclear == 0 && one.is_power_of_two() && options.ignore.is_none() {
        let index = one.trailing_zeros() as usize % MOST_LANES;
        let found = sifted.candidate(index);
        // What was flushed or clamped may be the same for others too.
        let magnitude = (found.t * power_of_two(-way.exponent)).abs();
        if (f32::MIN_POSITIVE..f32::MAX).contains(&magnitude) {
            return best.take(&way.ray(), &found, record.triangle(index));
        }
    }
    test_sifted(way, record, options, query, &sifted, best)
}

/// The rest of [`test`] where more than one triangle counts, or one that is to be looked at closely.
#[inline(never)]
fn test_sifted<T: Triangles>(
    way: &Way,
    record: &T,
    options: &QueryOptions,
    query: Query,
    sifted: &Sifted,
    best: &mut Best,
) -> bool {
    let ray = way.ray();
    // Those that are met first: they may spare the others.
    let mut bits = u64::from(sifted.met) | u64::from(sifted.unclear) << 32;
    let mut better = false;
    while bits != 0 {
        let index = bits.trailing_zeros() as usize % 32;
        bits &= bits - 1;
        let triangle = record.triangle(index);
        if options.ignore == Some(triangle) {
            continue;
        }
        let found = if sifted.met >> index & 1 != 0 {
            sifted.candidate(index)
        } else if sifted.t[index] > best.stop {
            // Decided or not, it cannot come before what has been found meanwhile.
            continue;
        } else {
            let Some(found) = decide(&ray, &record.corners(index), options) else { continue };
            found
        };
        if best.take(&ray, &found, triangle) {
            better = true;
            if query == Query::Any {
                return true;
            }
        }
    }
    better
}

/// A number of each corner. One vector is enough for some blocks, but which is not foreseen.
pub(crate) type Table<S> = [<S as Simd>::Floats; 2];

/// What the triangles' corners have, of a number of each corner.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
pub(crate) unsafe fn of_corners<S: Simd>(
    table: Table<S>,
    places: [S::Places; 3],
) -> [S::Floats; 3] {
    // SAFETY: the caller's contract.
    unsafe {
        let [a, b, c] = places;
        [S::look_up(table, a), S::look_up(table, b), S::look_up(table, c)]
    }
}

/// A number of each corner, in as many vectors as [`Triangles::VECTORS`].
type Vectors<S> = [<S as Simd>::Floats; 3];

/// Triangles whose edges enclose the ray and whose corners reach into its limits. Where there are some,
/// the rest of the reference test follows, but for the triangles seen at too grazing an angle or from
/// too near for interpolation. Of those many are let go as the reference does: the ones that rays
/// start on. The operations are the reference's, in its order; those of a corner are done once for
/// all triangles that share it.
///
/// # Safety
/// As for [`test`].
#[inline(always)]
unsafe fn sift<S: Simd, T: Triangles>(
    ray: &Way,
    record: &T,
    limit: f32,
    culling: Culling,
    any: bool,
    out: &mut Sifted,
) {
    // SAFETY: the caller's contract.
    unsafe {
        let [kx, ky, kz] = ray.axes();
        let (ox, oy, oz) =
            (S::splat(ray.origin[0]), S::splat(ray.origin[1]), S::splat(ray.origin[2]));
        let (sx, sy, sz) = (S::splat(ray.shear[0]), S::splat(ray.shear[1]), S::splat(ray.shear[2]));
        let zero = S::splat(0.0);
        let mut x: Vectors<S> = [zero; 3];
        let (mut y, mut z, mut flat_x, mut flat_y, mut depth) = (x, x, x, x, x);
        for half in 0..T::VECTORS {
            x[half] = S::sub(record.coordinates::<S>(kx, half), ox);
            y[half] = S::sub(record.coordinates::<S>(ky, half), oy);
            z[half] = S::sub(record.coordinates::<S>(kz, half), oz);
            flat_x[half] = S::sub(x[half], S::mul(sx, z[half]));
            flat_y[half] = S::sub(y[half], S::mul(sy, z[half]));
            depth[half] = S::mul(sz, z[half]);
        }
        let places = record.places::<S>();
        let [ax, bx, cx] = T::of_corners::<S>(flat_x, places);
        let [ay, by, cy] = T::of_corners::<S>(flat_y, places);
        let [da, db, dc] = T::of_corners::<S>(depth, places);
        let u = S::sub(S::mul(cx, by), S::mul(cy, bx));
        let v = S::sub(S::mul(ax, cy), S::mul(ay, cx));
        let w = S::sub(S::mul(bx, ay), S::mul(by, ax));
        let least = S::min(u, S::min(v, w));
        let most = S::max(u, S::max(v, w));
        let nearest = S::min(da, S::min(db, dc));
        let farthest = S::max(da, S::max(db, dc));
        let below = S::le(least, S::splat(-EDGE_LEAST));
        let above = S::le(S::splat(EDGE_LEAST), most);
        let reached = S::and(S::le(S::splat(ray.t_min), farthest), S::le(nearest, S::splat(limit)));
        let mut bits = S::bits(reached) & !S::bits(S::and(below, above));
        // Of what follows the last triangle nothing counts.
        bits &= (1u32 << record.count()) - 1;
        if bits == 0 {
            return;
        }
        let (u, v, w) = (counts::<S>(u), counts::<S>(v), counts::<S>(w));
        let det = S::add(S::add(u, v), w);
        // Within the bounds of the sheared corners.
        let least = S::max(S::min(ax, S::min(bx, cx)), S::min(ay, S::min(by, cy)));
        let most = S::min(S::max(ax, S::max(bx, cx)), S::max(ay, S::max(by, cy)));
        bits &= S::bits(S::and(S::le(least, zero), S::le(zero, most)));
        let (not_front, not_back) = (S::bits(S::le(det, zero)), S::bits(S::le(zero, det)));
        bits &= match culling {
            Culling::None => !(not_front & not_back),
            Culling::Back => !not_front,
            Culling::Front => !not_back,
        };
        let sum = S::add(S::add(S::mul(u, da), S::mul(v, db)), S::mul(w, dc));
        let interpolated = S::div(sum, det);
        let (mut reach, mut width) = (x, x);
        for half in 0..T::VECTORS {
            reach[half] = S::magnitude(S::magnitude(x[half], y[half]), z[half]);
            width[half] = S::magnitude(flat_x[half], flat_y[half]);
        }
        let [a, b, c] = T::of_corners::<S>(reach, places);
        let reach = S::max(a, S::max(b, c));
        let [a, b, c] = T::of_corners::<S>(width, places);
        let width = S::max(a, S::max(b, c));
        let disorder = S::mul(S::mul(reach, width), S::sub(farthest, nearest));
        let fine = S::bits(S::le(disorder, S::mul(S::splat(8.0), S::abs(sum))));
        let mut t = S::min(S::max(interpolated, nearest), farthest);
        let kept = S::and(S::le(S::splat(ray.t_min), t), S::le(t, S::splat(limit)));
        out.met = bits & fine & S::bits(kept);
        if bits & !fine != 0 {
            let part = S::div(disorder, S::abs(det));
            let error = S::mul(part, S::splat(INTERPOLATION_ERROR));
            // Less than, and greater than; what is no number stays.
            let (low, high) = (ray.t_min.next_down(), ray.t_max.next_up());
            let early = S::sub(interpolated, error);
            let before = S::bits(S::le(S::add(interpolated, error), S::splat(low)));
            let behind = S::bits(S::le(S::splat(high), early));
            // Nothing is further off than the farthest corner, whatever the error.
            t = S::select(S::mask(fine), t, S::min(farthest, early));
            let late = S::bits(S::le(S::splat(limit.next_up()), t));
            out.unclear = bits & !(fine | before | behind | late);
        }
        out.nearest = if any { out.met } else { out.met & S::least(out.met, t) };
        S::store(out.t.as_mut_ptr(), t);
        S::store(out.v.as_mut_ptr(), v);
        S::store(out.w.as_mut_ptr(), w);
        S::store(out.det.as_mut_ptr(), det);
    }
}

/// 0 for an edge function that counts as 0.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
pub(crate) unsafe fn counts<S: Simd>(x: S::Floats) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe { S::keep(S::le(S::splat(EDGE_LEAST), S::abs(x)), x) }
}

/// 0 for what is below the normal range.
///
/// # Safety
/// The processor must have the set.
#[inline(always)]
pub(crate) unsafe fn snapped<S: Simd>(x: S::Floats) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe { S::keep(S::le(S::splat(f32::MIN_POSITIVE), S::abs(x)), x) }
}

/// Triangles that the fast test accepts, whichever way they face.
///
/// # Safety
/// As for [`test`].
#[inline(always)]
unsafe fn fast<S: Simd, T: Triangles>(way: &Way, record: &T, limit: f32) -> u32 {
    // SAFETY: the caller's contract.
    unsafe {
        let places = record.places::<S>();
        let ray = way.ray();
        let zero = S::splat(0.0);
        let mut o = [zero; 3];
        let (mut d, mut ab, mut ac, mut ao) = (o, o, o, o);
        for axis in 0..3 {
            let mut table: Vectors<S> = [zero; 3];
            for (vector, table) in table.iter_mut().enumerate().take(T::VECTORS) {
                *table = record.coordinates::<S>(axis, vector);
            }
            let [a, b, c] = T::of_corners::<S>(table, places);
            (o[axis], d[axis]) = (S::splat(ray.origin[axis]), S::splat(ray.direction[axis]));
            (ab[axis], ac[axis], ao[axis]) = (S::sub(b, a), S::sub(c, a), S::sub(o[axis], a));
        }
        let p = cross::<S>(d, ac);
        // A zero determinant gives infinities and NaN, which compare false, or passes and is sorted out
        // by the reference test.
        let inverse = S::div(S::splat(1.0), dot::<S>(ab, p));
        let u = S::mul(dot::<S>(ao, p), inverse);
        let q = cross::<S>(ao, ab);
        let v = S::mul(dot::<S>(d, q), inverse);
        let t = S::mul(dot::<S>(ac, q), inverse);
        let inside = S::and(S::le(zero, S::min(u, v)), S::le(S::add(u, v), S::splat(1.0)));
        let reached = S::and(S::le(S::splat(ray.t_min), t), S::le(t, S::splat(limit)));
        S::bits(S::and(inside, reached)) & ((1u32 << record.count()) - 1)
    }
}

/// # Safety
/// The processor must have the set.
#[inline(always)]
pub(crate) unsafe fn cross<S: Simd>(p: [S::Floats; 3], q: [S::Floats; 3]) -> [S::Floats; 3] {
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
#[inline(always)]
pub(crate) unsafe fn dot<S: Simd>(p: [S::Floats; 3], q: [S::Floats; 3]) -> S::Floats {
    // SAFETY: the caller's contract.
    unsafe { S::add(S::add(S::mul(p[0], q[0]), S::mul(p[1], q[1])), S::mul(p[2], q[2])) }
}
