//! Bounds that hold for all rays of a packet: intervals, and which triangles of a block they rule
//! out.

use super::Packet;
use super::packet_block::PacketBlock;
use super::row::{GroupRow, ZERO, store};
use crate::layout::packed_block::PackedBlock;
use crate::simd::{MOST_LANES, Simd};
use crate::trace::triangle_block::{Table, TriangleBlock, WrittenBlock, of_corners};

/// Bounds that hold for all rays of a packet.
#[derive(Clone, Copy, Default)]
pub(super) struct Bounds {
    /// The numbers to subtract from the planes that the rays meet first, and last: the origin, with
    /// slack, that gives the least and the greatest distance.
    pub(super) near: [f32; 3],
    pub(super) far: [f32; 3],
    pub(super) reciprocal: [[f32; 2]; 3],
    /// On the sheared axes.
    pub(super) origin: [[f32; 2]; 3],
    pub(super) shear: [[f32; 2]; 3],
    pub(super) enter: f32,
    pub(super) stop: f32,
}

/// Every second element of two vectors, from the first on and from the second on.
static EVEN: [u8; MOST_LANES] = [0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30];
static ODD: [u8; MOST_LANES] = [1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31];

/// The least number of each row of `lo` and the greatest of each of `hi`, one lane each.
///
/// Rows are folded in pairs: of two neighbouring lanes the least stays, so that a row takes half as
/// many lanes, then a quarter, until it takes one.
///
/// # Safety
/// As for [`super::row::load`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn ranges<S: Simd, const R: usize>(
    lo: [S::Floats; R],
    hi: [S::Floats; R],
) -> [GroupRow; 2] {
    let mut ranges = [ZERO; 2];
    // SAFETY: as above; rows have room for the most lanes.
    unsafe {
        let (even, odd) = (S::places(EVEN.as_ptr()), S::places(ODD.as_ptr()));
        for first in (0..R).step_by(S::N) {
            let mut least = [lo[0]; MOST_LANES];
            let mut most = [hi[0]; MOST_LANES];
            for row in 0..S::N {
                if first + row < R {
                    (least[row], most[row]) = (lo[first + row], hi[first + row]);
                }
            }
            let mut count = S::N / 2;
            while count > 0 {
                for row in 0..count {
                    let pair = [least[2 * row], least[2 * row + 1]];
                    least[row] = S::min(S::look_up(pair, even), S::look_up(pair, odd));
                    let pair = [most[2 * row], most[2 * row + 1]];
                    most[row] = S::max(S::look_up(pair, even), S::look_up(pair, odd));
                }
                count /= 2;
            }
            S::store(ranges[0].0[first..].as_mut_ptr(), least[0]);
            S::store(ranges[1].0[first..].as_mut_ptr(), most[0]);
        }
    }
    ranges
}

/// The greatest lane.
///
/// # Safety
/// As for [`super::row::load`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn greatest<S: Simd>(x: S::Floats) -> f32 {
    let mut row = ZERO;
    // SAFETY: as above.
    unsafe { store::<S>(&mut row, x) };
    let mut most = row.0;
    let mut half = S::N / 2;
    while half > 0 {
        for i in 0..half {
            most[i] = if most[i] > most[i + half] { most[i] } else { most[i + half] };
        }
        half /= 2;
    }
    most[0]
}

/// The least and greatest products of two intervals.
///
/// # Safety
/// As for [`super::row::load`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn products<S: Simd>([a, b]: [f32; 2], [c, d]: [S::Floats; 2]) -> [S::Floats; 2] {
    // SAFETY: as above.
    unsafe {
        let (a, b) = (S::splat(a), S::splat(b));
        let (ac, ad, bc, bd) = (S::mul(a, c), S::mul(a, d), S::mul(b, c), S::mul(b, d));
        let least = S::min(S::min(ac, ad), S::min(bc, bd));
        [least, S::max(S::max(ac, ad), S::max(bc, bd))]
    }
}

/// The least of each triangle's corners.
///
/// # Safety
/// As for [`super::row::load`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn least<S: Simd>(table: Table<S>, places: [S::Places; 3]) -> S::Floats {
    // SAFETY: as above.
    unsafe {
        let [a, b, c] = of_corners::<S>(table, places);
        S::min(a, S::min(b, c))
    }
}

/// The greatest of each triangle's corners.
///
/// # Safety
/// As for [`super::row::load`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn most<S: Simd>(table: Table<S>, places: [S::Places; 3]) -> S::Floats {
    // SAFETY: as above.
    unsafe {
        let [a, b, c] = of_corners::<S>(table, places);
        S::max(a, S::max(b, c))
    }
}

impl Packet {
    /// The triangles of a block that rays of the packet may meet: those whose sheared corners
    /// lie, for all rays together, on no side of the ray, and reach into the limits. All operations are
    /// those of the test, on the ends of intervals; since rounding is monotonic, no interval leaves out
    /// what the test computes.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn cull<'b, S: Simd, T: PacketBlock<'b>>(&self, block: &T) -> u32 {
        // SAFETY: the caller's contract.
        unsafe { block.cull::<S>(self, 0.0, [self.bounds.enter, self.bounds.stop]) }
    }

    /// The same for sheared corners that may be off by `slack`, and depths in a range, of a block of shared corners.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn cull_shared<S: Simd>(
        &self,
        block: &PackedBlock<'_>,
        slack: f32,
        [enter, stop]: [f32; 2],
    ) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            let Bounds { origin, shear, .. } = &self.bounds;
            let zero = S::splat(0.0);
            // Flat x, flat y, depth: least and greatest.
            let mut tables = [[[zero; 2]; 2]; 3];
            for half in 0..2 {
                let mut from = [[zero; 2]; 3];
                for axis in 0..3 {
                    let row = block.coordinates(self.axes[axis]).wrapping_add(half * S::N);
                    let x = S::load(row);
                    let [lo, hi] = origin[axis];
                    from[axis] = [S::sub(x, S::splat(hi)), S::sub(x, S::splat(lo))];
                }
                for axis in 0..3 {
                    let [less, more] = products::<S>(shear[axis], from[2]);
                    let [lo, hi] = from[axis];
                    tables[axis][0][half] = if axis < 2 { S::sub(lo, more) } else { less };
                    tables[axis][1][half] = if axis < 2 { S::sub(hi, less) } else { more };
                }
            }
            let places = [
                S::places(block.places(0)),
                S::places(block.places(1)),
                S::places(block.places(2)),
            ];
            let [x, y, depth] = tables;
            let ends = [
                [least::<S>(x[0], places), most::<S>(x[1], places)],
                [least::<S>(y[0], places), most::<S>(y[1], places)],
                [least::<S>(depth[0], places), most::<S>(depth[1], places)],
            ];
            met_within::<S>(ends, slack, [enter, stop])
        }
    }

    /// The same of a block with corners written out.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn cull_written<S: Simd>(
        &self,
        block: &WrittenBlock<'_>,
        slack: f32,
        range: [f32; 2],
    ) -> u32 {
        let Bounds { origin, shear, .. } = &self.bounds;
        // SAFETY: the caller's contract.
        unsafe {
            let zero = S::splat(0.0);
            let mut ends = [[zero; 2]; 3];
            // In the order in which shared corners are compared, so that also what is no number gives the same.
            for corner in [2, 1, 0] {
                let mut from = [[zero; 2]; 3];
                for axis in 0..3 {
                    let x = block.coordinates::<S>(self.axes[axis], corner);
                    let [lo, hi] = origin[axis];
                    from[axis] = [S::sub(x, S::splat(hi)), S::sub(x, S::splat(lo))];
                }
                for axis in 0..3 {
                    let [less, more] = products::<S>(shear[axis], from[2]);
                    let [lo, hi] = from[axis];
                    let lo = if axis < 2 { S::sub(lo, more) } else { less };
                    let hi = if axis < 2 { S::sub(hi, less) } else { more };
                    let [least, most] = &mut ends[axis];
                    let first = corner == 2;
                    *least = if first { lo } else { S::min(lo, *least) };
                    *most = if first { hi } else { S::max(hi, *most) };
                }
            }
            met_within::<S>(ends, slack, range)
        }
    }
}

/// Which triangles are on no side of the ray, nor before or behind the limits: given the least and the greatest of their sheared corners on
/// both flat axes and of their depths.
///
/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn met_within<S: Simd>(
    [x, y, depth]: [[S::Floats; 2]; 3],
    slack: f32,
    [enter, stop]: [f32; 2],
) -> u32 {
    // SAFETY: the caller's contract.
    unsafe {
        let (left, right) = (S::max(x[0], y[0]), S::min(x[1], y[1]));
        let met = S::and(S::le(left, S::splat(slack)), S::le(S::splat(-slack), right));
        // The rays enter the bounds within their limits: so this holds for those too.
        let reached = S::le(S::splat(enter), depth[1]);
        let before = S::le(depth[0], S::splat(stop));
        S::bits(S::and(met, S::and(reached, before)))
    }
}
