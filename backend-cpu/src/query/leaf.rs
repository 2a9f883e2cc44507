//! The wide triangle test: which triangles of a block may hold a hit.

use splitplane_core::arithmetic::Strict;
use splitplane_core::intersect::{
    Candidate, EDGE_LEAST, INTERPOLATION_ERROR, PreparedRay, moeller_trumbore, watertight,
};
use splitplane_core::ray::{Accuracy, Culling, QueryOptions};
use splitplane_core::triangle::Triangle;

use super::blocks::{BLOCK, Block};

/// What the processor can do, found at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// Plain Rust.
    Portable,
    /// 8 triangles at once.
    Avx2,
    /// 16 triangles at once, and 16 rays at once.
    Avx512,
}

impl InstructionSet {
    /// The best this processor has. `SPLITPLANE_ISA` (`portable`, `avx2`, `avx512`) lowers it, for
    /// tests and measurements; it never raises it.
    pub fn detect() -> InstructionSet {
        let wanted = match std::env::var("SPLITPLANE_ISA").as_deref() {
            Ok("portable") => InstructionSet::Portable,
            Ok("avx2") => InstructionSet::Avx2,
            _ => InstructionSet::Avx512,
        };
        InstructionSet::available()
            .into_iter()
            .rfind(|&set| set as u32 <= wanted as u32)
            .unwrap_or(InstructionSet::Portable)
    }

    /// All that this processor has, worst first.
    pub fn available() -> Vec<InstructionSet> {
        #[allow(unused_mut, reason = "no other set on other processors")]
        let mut sets = vec![InstructionSet::Portable];
        #[cfg(all(target_arch = "x86_64", not(miri)))]
        {
            let avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("popcnt");
            if avx2 {
                sets.push(InstructionSet::Avx2);
            }
            if avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512vl")
            {
                sets.push(InstructionSet::Avx512);
            }
        }
        sets
    }

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            InstructionSet::Portable => "portable",
            InstructionSet::Avx2 => "avx2",
            InstructionSet::Avx512 => "avx512",
        }
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

/// What the wide test says of the triangles of a block, as bits.
#[repr(C, align(64))]
pub(crate) struct Sifted {
    /// Those that the reference test accepts; the numbers below are what it gives.
    pub met: u32,
    /// Those that it may accept: for it to decide.
    pub unclear: u32,
    /// Inner `t`.
    t: [f32; BLOCK],
    /// Weight of the second corner.
    u: [f32; BLOCK],
    /// Weight of the third corner.
    v: [f32; BLOCK],
}

impl Sifted {
    /// Nothing met.
    #[inline(always)]
    pub fn new() -> Sifted {
        Sifted { met: 0, unclear: 0, t: [0.0; BLOCK], u: [0.0; BLOCK], v: [0.0; BLOCK] }
    }

    /// Where the ray meets a triangle of these, by the reference test or as that would say.
    #[inline(always)]
    pub fn candidate(
        &self,
        ray: &PreparedRay,
        block: &Block<'_>,
        index: usize,
        options: &QueryOptions,
    ) -> Option<Candidate> {
        if self.met >> index & 1 != 0 {
            return Some(Candidate { t: self.t[index], u: self.u[index], v: self.v[index] });
        }
        decide(ray, &block.corners(index), options)
    }
}

/// Tests a block. Of the triangles that the reference test accepts at an inner `t` of at
/// most `limit` none is missing; there are few others. The ray must not be wide.
///
/// # Safety
/// The processor must have `set`.
#[inline(always)]
pub(crate) unsafe fn sift(
    set: InstructionSet,
    ray: &PreparedRay,
    block: &Block<'_>,
    limit: f32,
    options: &QueryOptions,
    out: &mut Sifted,
) {
    (out.met, out.unclear) = (0, 0);
    match (set, options.accuracy) {
        #[cfg(target_arch = "x86_64")]
        (InstructionSet::Avx512, Accuracy::Watertight) => {
            // SAFETY: the caller's contract; a block's words reach 16 behind the start of any row.
            unsafe { x86::watertight_16(ray, block, limit, options.culling, out) }
        }
        #[cfg(target_arch = "x86_64")]
        (InstructionSet::Avx512, Accuracy::Fast) => {
            // SAFETY: as above.
            out.unclear = unsafe { x86::fast_16(ray, block, limit) };
        }
        #[cfg(target_arch = "x86_64")]
        (InstructionSet::Avx2, Accuracy::Watertight) => {
            // SAFETY: as above.
            unsafe { x86::watertight_8(ray, block, limit, options.culling, out) }
        }
        #[cfg(target_arch = "x86_64")]
        (InstructionSet::Avx2, Accuracy::Fast) => {
            // SAFETY: as above.
            out.unclear = unsafe { x86::fast_8(ray, block, limit) };
        }
        _ => out.unclear = portable(ray, block, limit, options.accuracy),
    }
}

/// All triangles for the fast test; for the watertight one those whose edges enclose the ray.
fn portable(ray: &PreparedRay, block: &Block<'_>, limit: f32, accuracy: Accuracy) -> u32 {
    if accuracy == Accuracy::Fast {
        return (1 << block.count) - 1;
    }
    let [sx, sy, sz] = ray.shear;
    let origin = ray.axes.map(|axis| ray.origin[axis]);
    let mut bits = 0;
    for i in 0..block.count {
        let from: [[f32; 3]; 3] = core::array::from_fn(|corner| {
            core::array::from_fn(|k| {
                block.words[(corner * 3 + ray.axes[k]) * block.stride + i] - origin[k]
            })
        });
        let [a, b, c] = from.map(|p| [p[0] - sx * p[2], p[1] - sy * p[2]]);
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let below = u <= -EDGE_LEAST || v <= -EDGE_LEAST || w <= -EDGE_LEAST;
        let above = u >= EDGE_LEAST || v >= EDGE_LEAST || w >= EDGE_LEAST;
        let depths = from.map(|p| sz * p[2]);
        let nearest = depths[0].min(depths[1]).min(depths[2]);
        let farthest = depths[0].max(depths[1]).max(depths[2]);
        let hit = !(below && above) && farthest >= ray.t_min && nearest <= limit;
        bits |= u32::from(hit) << i;
    }
    bits
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    //! The same with vector instructions. Products and sums round separately, as the reference's
    //! do: no fused operation may stand here.

    use super::{Block, Culling, EDGE_LEAST, INTERPOLATION_ERROR, PreparedRay, Sifted};
    use core::arch::x86_64::*;

    macro_rules! sieves {
        ($watertight:ident, $fast:ident, $features:literal, $width:literal, $load:path, $set:path,
         $add:path, $sub:path, $mul:path, $div:path, $min:path, $max:path, $store:path, $abs:expr, $magnitudes:expr,
         $where_le:expr, $le:expr, $and:expr, $and_not_bits:expr, $bits:expr) => {
            /// Triangles whose edges enclose the ray and whose corners reach into its limits. Where there
            /// are some, the rest of the reference test follows, but for the triangles seen at too grazing an
            /// angle or from too near for interpolation. Of those many are let go as the reference does: the
            /// ones that rays start on.
            ///
            /// # Safety
            /// The processor must have the instruction set, and a wide load from any row must stay
            /// within the block's words.
            #[target_feature(enable = $features)]
            #[inline]
            pub unsafe fn $watertight(
                ray: &PreparedRay,
                block: &Block<'_>,
                limit: f32,
                culling: Culling,
                out: &mut Sifted,
            ) {
                let [kx, ky, kz] = ray.axes;
                let (ox, oy, oz) =
                    ($set(ray.origin[kx]), $set(ray.origin[ky]), $set(ray.origin[kz]));
                let [sx, sy, sz] = ray.shear.map(|x| $set(x));
                let mut at = 0;
                while at < block.count {
                    let start = block.words.as_ptr();
                    // SAFETY: rows and what follows them are within the words, by contract.
                    let row = |corner: usize, axis: usize| unsafe {
                        $load(start.add((corner * 3 + axis) * block.stride + at))
                    };
                    let from = |corner: usize| {
                        let x = $sub(row(corner, kx), ox);
                        let y = $sub(row(corner, ky), oy);
                        let z = $sub(row(corner, kz), oz);
                        ((x, y, z), $sub(x, $mul(sx, z)), $sub(y, $mul(sy, z)))
                    };
                    let ((a, ax, ay), (b, bx, by), (c, cx, cy)) = (from(0), from(1), from(2));
                    let u = $sub($mul(cx, by), $mul(cy, bx));
                    let v = $sub($mul(ax, cy), $mul(ay, cx));
                    let w = $sub($mul(bx, ay), $mul(by, ax));
                    let least = $min(u, $min(v, w));
                    let most = $max(u, $max(v, w));
                    let (da, db, dc) = ($mul(sz, a.2), $mul(sz, b.2), $mul(sz, c.2));
                    let nearest = $min(da, $min(db, dc));
                    let farthest = $max(da, $max(db, dc));
                    let below = $le(least, $set(-EDGE_LEAST));
                    let above = $le($set(EDGE_LEAST), most);
                    let reached = $and($le($set(ray.t_min), farthest), $le(nearest, $set(limit)));
                    let mut bits: u32 = $and_not_bits($and(below, above), reached);
                    // Of what follows the last triangle nothing counts.
                    bits &= ((1u64 << (block.count - at)) - 1) as u32;
                    if bits != 0 {
                        let zero = $set(0.0);
                        let counts = |x| $where_le($set(EDGE_LEAST), $abs(x), x);
                        let (u, v, w) = (counts(u), counts(v), counts(w));
                        let det = $add($add(u, v), w);
                        // Within the bounds of the sheared corners.
                        let least = $max($min(ax, $min(bx, cx)), $min(ay, $min(by, cy)));
                        let most = $min($max(ax, $max(bx, cx)), $max(ay, $max(by, cy)));
                        bits &= $bits($and($le(least, zero), $le(zero, most)));
                        let (not_front, not_back) = ($bits($le(det, zero)), $bits($le(zero, det)));
                        bits &= match culling {
                            Culling::None => !(not_front & not_back),
                            Culling::Back => !not_front,
                            Culling::Front => !not_back,
                        };
                        let sum = $add($add($mul(u, da), $mul(v, db)), $mul(w, dc));
                        let interpolated = $div(sum, det);
                        let reach = $magnitudes(
                            $magnitudes(
                                $magnitudes($magnitudes(a.0, a.1), $magnitudes(b.0, b.1)),
                                $magnitudes($magnitudes(c.0, c.1), $magnitudes(a.2, b.2)),
                            ),
                            c.2,
                        );
                        let width = $magnitudes(
                            $magnitudes($magnitudes(ax, ay), $magnitudes(bx, by)),
                            $magnitudes(cx, cy),
                        );
                        let disorder = $mul($mul(reach, width), $sub(farthest, nearest));
                        let fine = $bits($le(disorder, $mul($set(8.0), $abs(sum))));
                        let t = $min($max(interpolated, nearest), farthest);
                        let kept = $bits($and($le($set(ray.t_min), t), $le(t, $set(limit))));
                        if bits & !fine != 0 {
                            let error = $mul($div(disorder, $abs(det)), $set(INTERPOLATION_ERROR));
                            // Less than, and greater than; what is no number stays.
                            let (low, high) = (ray.t_min.next_down(), ray.t_max.next_up());
                            let before = $bits($le($add(interpolated, error), $set(low)));
                            let behind = $bits($le($set(high), $sub(interpolated, error)));
                            out.unclear |= (bits & !(fine | before | behind)) << at;
                        }
                        let met = bits & fine & kept;
                        if met != 0 {
                            out.met |= met << at;
                            let normal = $set(f32::MIN_POSITIVE);
                            let snapped = |x| $where_le(normal, $abs(x), x);
                            // SAFETY: rows are as long as a block, a multiple of what is stored.
                            unsafe {
                                $store(out.t.as_mut_ptr().add(at), t);
                                $store(out.u.as_mut_ptr().add(at), snapped($div(v, det)));
                                $store(out.v.as_mut_ptr().add(at), snapped($div(w, det)));
                            }
                        }
                    }
                    at += $width;
                }
            }

            /// Triangles that the fast test accepts, whichever way they face.
            ///
            /// # Safety
            /// As for the watertight one.
            #[target_feature(enable = $features)]
            #[inline]
            pub unsafe fn $fast(ray: &PreparedRay, block: &Block<'_>, limit: f32) -> u32 {
                let o = ray.origin.map(|x| $set(x));
                let d = ray.direction.map(|x| $set(x));
                let (zero, one) = ($set(0.0), $set(1.0));
                let mut all = 0;
                let mut at = 0;
                while at < block.count {
                    let start = block.words.as_ptr();
                    // SAFETY: rows and what follows them are within the words, by contract.
                    let row = |corner: usize, axis: usize| unsafe {
                        $load(start.add((corner * 3 + axis) * block.stride + at))
                    };
                    let a = [row(0, 0), row(0, 1), row(0, 2)];
                    let ab = [$sub(row(1, 0), a[0]), $sub(row(1, 1), a[1]), $sub(row(1, 2), a[2])];
                    let ac = [$sub(row(2, 0), a[0]), $sub(row(2, 1), a[1]), $sub(row(2, 2), a[2])];
                    let ao = [$sub(o[0], a[0]), $sub(o[1], a[1]), $sub(o[2], a[2])];
                    macro_rules! cross {
                        ($p:expr, $q:expr) => {
                            [
                                $sub($mul($p[1], $q[2]), $mul($p[2], $q[1])),
                                $sub($mul($p[2], $q[0]), $mul($p[0], $q[2])),
                                $sub($mul($p[0], $q[1]), $mul($p[1], $q[0])),
                            ]
                        };
                    }
                    macro_rules! dot {
                        ($p:expr, $q:expr) => {
                            $add($add($mul($p[0], $q[0]), $mul($p[1], $q[1])), $mul($p[2], $q[2]))
                        };
                    }
                    let p = cross!(d, ac);
                    // A zero determinant gives infinities and NaN, which compare false, or passes
                    // and is sorted out by the reference test.
                    let inverse = $div(one, dot!(ab, p));
                    let u = $mul(dot!(ao, p), inverse);
                    let q = cross!(ao, ab);
                    let v = $mul(dot!(d, q), inverse);
                    let t = $mul(dot!(ac, q), inverse);
                    let inside = $and($le(zero, $min(u, v)), $le($add(u, v), one));
                    let reached = $and($le($set(ray.t_min), t), $le(t, $set(limit)));
                    let bits: u32 = $bits($and(inside, reached));
                    all |= bits << at;
                    at += $width;
                }
                all & (((1u64 << block.count) - 1) as u32)
            }
        };
    }

    sieves!(
        watertight_16,
        fast_16,
        "avx512f,avx512dq",
        16,
        _mm512_loadu_ps,
        _mm512_set1_ps,
        _mm512_add_ps,
        _mm512_sub_ps,
        _mm512_mul_ps,
        _mm512_div_ps,
        _mm512_min_ps,
        _mm512_max_ps,
        _mm512_storeu_ps,
        |x| _mm512_abs_ps(x),
        // The greater of two magnitudes.
        |x, y| _mm512_range_ps::<0b1011>(x, y),
        |a, b, x| _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b), x),
        |a, b| _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b),
        |a: u16, b: u16| a & b,
        |a: u16, b: u16| u32::from(!a & b),
        |a: u16| u32::from(a)
    );

    sieves!(
        watertight_8,
        fast_8,
        "avx2",
        8,
        _mm256_loadu_ps,
        _mm256_set1_ps,
        _mm256_add_ps,
        _mm256_sub_ps,
        _mm256_mul_ps,
        _mm256_div_ps,
        _mm256_min_ps,
        _mm256_max_ps,
        _mm256_storeu_ps,
        |x| _mm256_andnot_ps(_mm256_set1_ps(-0.0), x),
        |x, y| {
            let sign = _mm256_set1_ps(-0.0);
            _mm256_max_ps(_mm256_andnot_ps(sign, x), _mm256_andnot_ps(sign, y))
        },
        |a, b, x| _mm256_and_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b), x),
        |a, b| _mm256_cmp_ps::<_CMP_LE_OQ>(a, b),
        |a, b| _mm256_and_ps(a, b),
        |a, b| _mm256_movemask_ps(_mm256_andnot_ps(a, b)) as u32,
        |a| _mm256_movemask_ps(a) as u32
    );
}
